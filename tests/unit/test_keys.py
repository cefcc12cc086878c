"""`outrider keys`: chain, roles, times, modes, and what a router says of a folder that it cannot use."""

from __future__ import annotations

import datetime
import shutil
import stat
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID

from common import topics
from common.access import IDENTITIES, LINK_USER, RouterSide, access_control
from common.cli import main
from common.config import ConfigError, build, deploy_dir
from common.credentials import check_router, why_no_link
from common.key_folder import read_password, side_files
from common.session import BusConfig

SIDES: tuple[RouterSide, RouterSide] = ("onboard", "ground")
NOW = datetime.datetime.now(datetime.UTC)
YEAR = datetime.timedelta(days=365)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A fresh folder of keys, as the command makes it."""
    assert main(["keys", "--folder", str(tmp_path / "keys"), "--vehicle-host", "10.1.2.3"]) == 0
    return tmp_path / "keys"


def certificate(folder: Path, side: RouterSide) -> x509.Certificate:
    """Certificate of a side's router."""
    return x509.load_pem_x509_certificate(side_files(folder, side).certificate.read_bytes())


def test_certificates_are_signed_for_their_roles_hosts_and_time(folder: Path) -> None:
    authority = x509.load_pem_x509_certificate((folder / "ca/ca.pem").read_bytes())
    for side in SIDES:
        made = certificate(folder, side)
        made.verify_directly_issued_by(authority)
        uses = made.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
        assert set(uses) == {ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH}
        assert made.subject.rfc4514_string() == f"CN={side}.kite"
        assert not made.extensions.get_extension_for_class(x509.BasicConstraints).value.ca
        assert check_router(str(folder), side, "kite", NOW) - NOW == pytest.approx(
            YEAR, abs=datetime.timedelta(hours=1)
        )
    hosts = certificate(folder, "onboard").extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert "10.1.2.3" in {str(host.value) for host in hosts}


def test_only_certificates_are_readable_by_others_and_each_side_has_its_own_secrets(folder: Path) -> None:
    files = [path for path in folder.rglob("*") if path.is_file()]
    for path in files:
        assert stat.S_IMODE(path.stat().st_mode) == (0o644 if path.suffix == ".pem" else 0o600), path
    assert {p.name for p in (folder / "ca").iterdir()} == {"ca.pem", "ca.key"}
    secrets = {
        side: {p.read_bytes() for p in (folder / side).rglob("*") if p.suffix != ".pem" and p.is_file()}
        for side in SIDES
    }
    assert not secrets["onboard"] & secrets["ground"]
    for side in SIDES:
        listed = dict(line.split(":") for line in side_files(folder, side).users.read_text().splitlines())
        assert set(listed) - {LINK_USER} == set(IDENTITIES[side])
        for identity in IDENTITIES[side]:
            assert read_password(str(folder), side, identity) == (identity, listed[identity])
    lets_in = dict(line.split(":") for line in side_files(folder, "onboard").users.read_text().splitlines())
    assert read_password(str(folder), "ground", LINK_USER)[1] == lets_in[LINK_USER]
    assert read_password(str(folder), "ground", "demo")[0] == "cli"


def test_nothing_is_overwritten_unless_told(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()}

    assert main(["keys", "--folder", str(folder)]) == 2
    assert "--renew" in capsys.readouterr().err
    assert {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()} == before

    assert main(["keys", "--folder", str(folder), "--renew", "--days", "90"]) == 0
    changed = {p.name for p in before if p.read_bytes() != before[p]}
    assert changed == {"router.pem", "router.key"}, "authority and passwords stay"
    hosts = certificate(folder, "onboard").extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert "10.1.2.3" in {str(host.value) for host in hosts}, "the hosts stay as well"

    assert main(["keys", "--folder", str(folder), "--force"]) == 0
    assert all(p.read_bytes() != before[p] for p in before), "everything is new"


def test_a_second_vehicle_shares_the_authority(folder: Path, tmp_path: Path) -> None:
    second = str(tmp_path / "heron")

    assert main(["keys", "--folder", second, "--ca", str(folder / "ca"), "--set", "bus.vehicle=heron"]) == 0
    assert check_router(second, "ground", "heron", NOW)
    assert not (tmp_path / "heron/ca").exists(), "the authority's key is in one place"
    with pytest.raises(ConfigError, match=r"is for 'onboard.heron', expected 'onboard.kite'; copy the folder"):
        check_router(second, "onboard", "kite", NOW)


@pytest.mark.parametrize(
    ("spoil", "later", "said"),
    [
        (lambda f: (f / "onboard/router.key").unlink(), None, r"router.key: missing; make it with `outrider keys`"),
        (lambda f: (f / "onboard/ca.pem").unlink(), None, r"ca.pem: missing; make it with `outrider keys`"),
        (lambda f: (f / "onboard/router.key").chmod(0o644), None, r"mode 644 lets others read it.*chmod 600"),
        (lambda f: (f / "onboard/users.txt").chmod(0o640), None, r"users.txt: mode 640 lets others read it"),
        (lambda f: shutil.copy(f / "ground/router.pem", f / "onboard"), None, r"is not the key of router.pem"),
        (lambda f: (f / "onboard/router.pem").write_text("x"), None, r"is no certificate in PEM"),
        (lambda f: None, YEAR * 1.1, r"router.pem: expired on .*outrider keys --renew"),
        (lambda f: None, -YEAR, r"valid from .* this machine's clock says .*set the clock"),
    ],
    ids=[
        "missing key",
        "missing authority",
        "readable key",
        "readable passwords",
        "wrong key",
        "no certificate",
        "expired",
        "clock",
    ],
)
def test_a_router_says_what_is_wrong_with_its_folder(folder: Path, spoil, later, said: str) -> None:
    spoil(folder)

    with pytest.raises(ConfigError, match=said):
        check_router(str(folder), "onboard", "kite", NOW + (later or datetime.timedelta()))
    check_router(str(folder), "ground", "kite", NOW)


def test_a_side_does_not_start_with_what_its_router_cannot_use(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = ("bus.link=tls/127.0.0.1:7449", f"bus.tls.folder={tmp_path / 'none'}")

    assert main(["onboard", *(part for text in settings for part in ("--set", text))]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert line.startswith("outrider: ") and "ca.pem: missing; make it with `outrider keys`" in line


def test_another_authority_is_named(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["keys", "--folder", str(tmp_path / "other")]) == 0
    shutil.copy(tmp_path / "other/ca/ca.pem", folder / "ground/ca.pem")

    with pytest.raises(ConfigError, match=r"was not signed by the authority of ca.pem"):
        check_router(str(folder), "ground", "kite", NOW)
    assert main(["keys", "--check", "--folder", str(folder)]) == 1
    assert "onboard  good until" in capsys.readouterr().out


def test_a_certificate_that_ends_soon_is_reported(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    check_router(str(folder), "onboard", "kite", NOW + YEAR - datetime.timedelta(days=10))

    assert "in 9 days: run `outrider keys --renew`" in caplog.text or "in 10 days" in caplog.text


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"onboard_router": "tcp/0.0.0.0:7447"}, r"onboard_router: got 'tcp/0.0.0.0:7447', expected tcp/127.0.0.1"),
        ({"ground_router": "tcp/10.0.0.1:7447"}, r"ground_router: .*come in by tls.listen alone"),
        ({"link": "tcp/10.0.0.1:7449"}, r"link: got 'tcp/10.0.0.1:7449', expected tls/host:port"),
        ({"tls": {"folder": "keys", "listen": "tcp/0.0.0.0:1"}}, r"tls.listen: got .* expected tls/host:port"),
        ({"tls": {"foldr": "keys"}}, r"unknown key 'foldr'; did you mean 'folder'"),
    ],
)
def test_no_open_door_beside_the_locked_one(settings: dict, said: str) -> None:
    secured = {"link": "tls/10.0.0.1:7449", "tls": {"folder": "keys"}}

    assert build(BusConfig, secured, "test").tls.folder == "keys"
    with pytest.raises(ConfigError, match=said):
        build(BusConfig, secured | settings, "test")


def test_a_link_that_does_not_come_is_explained(folder: Path) -> None:
    assert "no connection to 127.0.0.1:1" in why_no_link("tls/127.0.0.1:1", str(folder))


def test_the_zenohd_files_in_deploy_are_those_of_the_code(tmp_path: Path) -> None:
    assert main(["keys", "--zenohd", str(tmp_path)]) == 0

    for side in SIDES:
        shipped = deploy_dir() / "zenoh" / f"{side}.json5"
        made = (tmp_path / f"{side}.json5").read_text()
        assert shipped.read_text() == made, "run: outrider keys --zenohd deploy/zenoh"
        for rule in access_control(side, "kite")["rules"]:
            assert f'"{rule["id"]}"' in made
    assert topics.key("kite", "camera/down/jpeg") in made


def test_zenoh_reads_the_zenohd_files() -> None:
    import zenoh

    for side in SIDES:
        config = zenoh.Config.from_file(str(deploy_dir() / "zenoh" / f"{side}.json5"))
        assert '"default_permission":"deny"' in config.get_json("access_control")
