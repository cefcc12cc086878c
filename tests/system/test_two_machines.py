"""The set-up of two machines with mutual TLS, in network namespaces: it flies, and strangers stay outside."""

from __future__ import annotations

import datetime
import json
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec

from benchmarks.sample_video import sample_video
from common.cli import main
from tests.system.namespaces import Machines, inside_user_namespace, rerun_in_user_namespace

STRANGER = Path(__file__).parent / "stranger.py"
LINK_PORT, OPEN_PORT = 7449, 7447


class TwoMachines:
    """Vehicle, ground station and a stranger, each on a machine of its own.

    Args:
        folder: for keys and logs.
    """

    def __init__(self, folder: Path):
        self.folder = folder
        self.machines = Machines(["vehicle", "ground", "stranger"])
        self.vehicle = self.machines.address["vehicle"]
        self.settings: list[str] = []
        self._sides: dict[str, subprocess.Popen[bytes]] = {}

    def words(self, machine: str, *words: str) -> list[str]:
        """Words of an `outrider` command on a machine."""
        settings = [part for text in self.settings for part in ("--set", text)]
        return self.machines.command(machine, sys.executable, "-m", "common.cli", *words, *settings)

    def start(self, machine: str, side: str, *words: str) -> None:
        """Start a side."""
        with (self.folder / f"{side}.log").open("ab") as log:
            self._sides[side] = subprocess.Popen(
                self.words(machine, side, *words), stdin=subprocess.DEVNULL, stdout=log, stderr=log
            )

    def outrider(self, machine: str, *words: str) -> subprocess.CompletedProcess[str]:
        """Run an `outrider` command to its end."""
        return subprocess.run(self.words(machine, *words), capture_output=True, text=True, timeout=60)

    def rates_hz(self, machine: str, side: str, *names: str, seconds: float = 2.0) -> dict[str, float]:
        """Rates of streams as `outrider topics hz` prints them; 0 for none."""
        result = self.outrider(machine, "topics", "hz", *names, "--seconds", str(seconds), "--side", side)
        rows = [line.split() for line in result.stdout.splitlines()]
        return {row[0]: 0.0 if row[1] == "-" else float(row[1]) for row in rows if row and row[0] in names}

    def stranger(self, ways: list[dict[str, Any]]) -> subprocess.Popen[str]:
        """Start the stranger's attempts."""
        words = self.machines.command("stranger", sys.executable, str(STRANGER), json.dumps(ways))
        return subprocess.Popen(words, stdout=subprocess.PIPE, text=True)

    def end_sides(self) -> None:
        """End all sides as Ctrl-C does."""
        for process in self._sides.values():
            process.send_signal(signal.SIGINT)
        for process in self._sides.values():
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        self._sides.clear()

    def logs(self) -> str:
        """The end of every log."""
        return "\n".join(f"--- {p.name}\n{p.read_text(errors='replace')[-3000:]}" for p in self.folder.glob("*.log"))


@pytest.fixture
def two(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[TwoMachines]:
    """Three machines; gone after the test."""
    made = TwoMachines(tmp_path)
    yield made
    made.end_sides()
    made.machines.remove()


def secure(two: TwoMachines) -> None:
    """Make keys, give each machine its own, and set both up for TLS."""
    keys = two.folder / "keys"
    assert main(["keys", "--folder", str(keys), "--vehicle-host", two.vehicle]) == 0
    shutil.move(keys / "ca", two.folder / "offline")
    two.settings = [
        f"bus.link=tls/{two.vehicle}:{LINK_PORT}",
        f"bus.tls.listen=tls/0.0.0.0:{LINK_PORT}",
        f"bus.tls.folder={keys}",
        "world.scenario=calm",
        f"recorder.folder={two.folder / 'recordings'}",
    ]


def forge(folder: Path, issuer: str) -> None:
    """A ground station's certificate with all the right names, signed with its own key in the name of an issuer."""
    folder.mkdir()
    now = datetime.datetime.now(datetime.UTC)
    key = ec.generate_private_key(ec.SECP256R1())
    made = (
        x509.CertificateBuilder()
        .subject_name(x509.Name.from_rfc4514_string("CN=ground.kite"))
        .issuer_name(x509.Name.from_rfc4514_string(issuer))
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(days=1))
        .not_valid_after(now + datetime.timedelta(days=30))
        .add_extension(x509.SubjectAlternativeName([x509.DNSName("localhost")]), critical=False)
        .sign(key, hashes.SHA256())
    )
    (folder / "router.pem").write_bytes(made.public_bytes(serialization.Encoding.PEM))
    (folder / "router.key").write_bytes(
        key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    )


def ways_in(two: TwoMachines) -> dict[str, dict[str, Any]]:
    """What strangers try. They even know the password of the link: certificates alone must keep them out."""
    ours, other = two.folder / "keys/ground", two.folder / "other"
    assert main(["keys", "--folder", str(other), "--vehicle-host", two.vehicle]) == 0
    authority = x509.load_pem_x509_certificate((ours / "ca.pem").read_bytes())
    forge(two.folder / "self-signed", "CN=ground.kite")
    forge(two.folder / "forged", authority.subject.rfc4514_string())
    login = {"user": "link", "password": (ours / "passwords/link").read_text().strip()}
    link, plain = f"tls/{two.vehicle}:{LINK_PORT}", f"tcp/{two.vehicle}"

    def way(endpoint: str, folder: Path | None = None) -> dict[str, Any]:
        tls: dict[str, Any] = {"root_ca_certificate": str(ours / "ca.pem"), "enable_mtls": folder is not None}
        if folder is not None:
            tls["connect_certificate"] = str(folder / "router.pem")
            tls["connect_private_key"] = str(folder / "router.key")
        return {"endpoint": endpoint, "settings": {"transport/link/tls": tls, "transport/auth/usrpwd": login}}

    return {
        "no certificate": way(link),
        "a certificate of another authority": way(link, other / "ground"),
        "a self-signed certificate with the right names": way(link, two.folder / "self-signed"),
        "a certificate in our authority's name": way(link, two.folder / "forged"),
        "plain tcp at the TLS port": way(f"{plain}:{LINK_PORT}"),
        "plain tcp at the port of the vehicle's own processes": way(f"{plain}:{OPEN_PORT}"),
        "the ground's own certificate": way(link, ours),
    }


def rerun(test: str) -> None:
    """As a normal user: the same test as root of a user namespace."""
    result = rerun_in_user_namespace(f"{__file__}::{test}")
    assert result.returncode == 0, result.stdout + result.stderr


@pytest.mark.slow
def test_two_machines_fly_over_tls_and_strangers_stay_outside(request: pytest.FixtureRequest) -> None:
    if not inside_user_namespace():
        rerun(request.node.name)
        return
    two: TwoMachines = request.getfixturevalue("two")
    secure(two)
    two.start("vehicle", "onboard")
    two.start("vehicle", "sim")
    two.start("ground", "ground", "--without", "console")

    took_off = None
    deadline = time.monotonic() + 60
    while took_off is None or took_off.returncode:
        took_off = two.outrider("ground", "do", "takeoff", "--height", "3")
        assert time.monotonic() < deadline, f"{took_off}; {two.logs()}"
    names = ("camera/down/jpeg", "camera/down/raw", "sim/camera/down", "helm/status", "truth")
    rates = two.rates_hz("ground", "ground", *names)
    health = two.outrider("ground", "topics", "echo", "health/pursuit", "--count", "1")

    assert took_off.stdout.startswith("takeoff: done")
    assert rates["camera/down/jpeg"] > 5 and rates["helm/status"] > 2, two.logs()
    assert json.loads(health.stdout)["message"]["input_age_ms"]["camera/down/jpeg"] < 500, health.stdout
    assert rates["camera/down/raw"] == rates["sim/camera/down"] == rates["truth"] == 0, "these never cross"

    ways = ways_in(two)
    stranger = two.stranger(list(ways.values()))
    results = dict(zip(ways, map(json.loads, stranger.communicate(timeout=60)[0].splitlines()), strict=True))
    insider = results.pop("the ground's own certificate")
    for what, result in results.items():
        assert not result["opened"] and not result["frames"] and not result["answers"], f"{what}: {result}"
    assert insider["opened"] and insider["frames"] > 5 and insider["answers"], insider
    assert "camera/down/raw" not in str(insider["streams"]) and "truth" not in str(insider["streams"]), insider


@pytest.mark.slow
def test_without_keys_the_same_stranger_reads_and_writes(request: pytest.FixtureRequest) -> None:
    """The other test can fail: with security off the stranger gets all that it is kept from there."""
    if not inside_user_namespace():
        rerun(request.node.name)
        return
    two: TwoMachines = request.getfixturevalue("two")
    two.settings = [f"bus.onboard_router=tcp/0.0.0.0:{OPEN_PORT}"]
    two.start("vehicle", "onboard", "--source", str(sample_video()))
    deadline = time.monotonic() + 30
    while not two.rates_hz("vehicle", "onboard", "camera/down/jpeg", seconds=1.0).get("camera/down/jpeg"):
        assert time.monotonic() < deadline, two.logs()

    stranger = two.stranger([{"endpoint": f"tcp/{two.vehicle}:{OPEN_PORT}", "settings": {}}])
    result = json.loads(stranger.communicate(timeout=30)[0])

    assert result["opened"] and result["frames"] > 5, f"{result}; {two.logs()}"
    assert result["answers"] == 1, f"helm answers a stranger's command: {result}; {two.logs()}"
    assert "refused a message" in two.logs(), "helm got the stranger's request, if only to find it no request"
    assert "open to everybody who reaches it" in two.logs()
