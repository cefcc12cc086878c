"""`outrider keys`: an authority, certificates of the two routers, and the passwords of all processes, in one folder.

keys/ca/       the authority: its key signs, and is needed only to renew; keep it offline
keys/onboard/  what the vehicle's computer needs, and nothing else
keys/ground/   what the ground station's computer needs, and nothing else
"""

from __future__ import annotations

import argparse
import datetime
import ipaddress
import json
import secrets
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import msgspec
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from common.access import IDENTITIES, LINK_USER, RouterSide, certificate_name
from common.config import ConfigError
from common.credentials import check_router, login_settings, tls_settings
from common.key_folder import read, read_private, side_files
from common.processes import load_config
from common.session import BusConfig, TlsConfig, router_settings, zenoh_settings

_AUTHORITY_DAYS = 3650
# Companion computers start with a clock some minutes off until the network or the GNSS has set it.
_CLOCK_TOLERANCE = datetime.timedelta(hours=1)
_SIDES: tuple[RouterSide, RouterSide] = ("onboard", "ground")
_LONGEST_NAME = 64  # of a common name, X.520

_ETC = Path("/etc") / "outrider" / "keys"
_ZENOHD_HEADER = """\
// Router of the {side} side of vehicle {vehicle}, for `zenohd --config FILE` in place of Outrider's own router.
// Made by `outrider keys --zenohd`: change the vehicle file or common/topics.py and make it again, not this file.
// The `session` stream, which maps the vehicle's clock to UTC, comes from Outrider's own router alone.
"""

PrivateKey = ec.EllipticCurvePrivateKey
Authority = tuple[x509.Certificate, PrivateKey]


def make_authority(vehicle: str, now: datetime.datetime) -> Authority:
    """A new authority: self-signed certificate, valid ten years, and its key (P-256)."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, f"Outrider {vehicle} {secrets.token_hex(4)}")])
    usage = x509.KeyUsage(
        digital_signature=False,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=True,
        crl_sign=True,
        encipher_only=False,
        decipher_only=False,
    )
    certificate = (
        _unsigned(name, name, key, now, _AUTHORITY_DAYS)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(usage, critical=True)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
        .sign(key, hashes.SHA256())
    )
    return certificate, key


def make_certificate(
    authority: Authority, name: str, hosts: Iterable[str], now: datetime.datetime, days: int
) -> tuple[x509.Certificate, PrivateKey]:
    """Certificate of a router, for both ends of a TLS connection, and its key (P-256).

    Args:
        authority: who signs.
        name: common name, which access control goes by.
        hosts: names and addresses under which the router is reached.
        now: time of the making, UTC.
        days: how long it is valid.
    """
    issuer, issuer_key = authority
    key = ec.generate_private_key(ec.SECP256R1())
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    uses = x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH])
    certificate = (
        _unsigned(subject, issuer.subject, key, now, days)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(uses, critical=False)
        .add_extension(x509.SubjectAlternativeName([_host(h) for h in dict.fromkeys(hosts)]), critical=False)
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(issuer_key.public_key()), critical=False)
        .sign(issuer_key, hashes.SHA256())
    )
    return certificate, key


def _unsigned(
    subject: x509.Name, issuer: x509.Name, key: PrivateKey, now: datetime.datetime, days: int
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - _CLOCK_TOLERANCE)
        .not_valid_after(now + datetime.timedelta(days=days))
    )


def _host(text: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(text))
    except ValueError:
        pass
    try:
        return x509.DNSName(text)
    except ValueError:
        raise ConfigError(f"keys: got host {text!r}, expected a host name or an IP address") from None


def _pem(item: x509.Certificate | PrivateKey) -> bytes:
    if isinstance(item, x509.Certificate):
        return item.public_bytes(serialization.Encoding.PEM)
    return item.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )


Files = dict[Path, bytes]


def router_files(
    folder: Path, authority: Authority, vehicle: str, hosts: dict[RouterSide, list[str]], days: int
) -> Files:
    """Certificates and keys of both routers, by path."""
    now = datetime.datetime.now(datetime.UTC)
    files: Files = {}
    for side in _SIDES:
        certificate, key = make_certificate(authority, certificate_name(side, vehicle), hosts[side], now, days)
        places = side_files(folder, side)
        files |= {places.authority: _pem(authority[0]), places.certificate: _pem(certificate), places.key: _pem(key)}
    return files


def password_files(folder: Path) -> Files:
    """A password for every process of both machines, and the lists that the routers let in, by path."""
    files: Files = {}
    link = secrets.token_urlsafe(24)
    for side in _SIDES:
        places = side_files(folder, side)
        passwords = {identity: secrets.token_urlsafe(24) for identity in IDENTITIES[side]}
        files |= {places.password(identity): f"{text}\n".encode() for identity, text in passwords.items()}
        if side == "onboard":
            passwords[LINK_USER] = link  # the ground's router logs in here
        else:
            files[places.password(LINK_USER)] = f"{link}\n".encode()
        files[places.users] = "".join(f"{name}:{text}\n" for name, text in passwords.items()).encode()
    return files


def write(files: Files) -> None:
    """Write files, each whole or not at all; certificates readable by all, everything else (0600) by the owner."""
    for path, data in files.items():
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        fresh = path.with_name(f".{path.name}.new")
        fresh.unlink(missing_ok=True)
        fresh.touch(mode=0o644 if path.suffix == ".pem" else 0o600, exist_ok=False)
        fresh.write_bytes(data)
        fresh.replace(path)


def _read_authority(folder: Path) -> Authority:
    certificate = x509.load_pem_x509_certificate(read(folder / "ca.pem"))
    key = serialization.load_pem_private_key(read_private(folder / "ca.key"), None)
    if not isinstance(key, ec.EllipticCurvePrivateKey) or key.public_key() != certificate.public_key():
        raise ConfigError(f"{folder}: ca.key is not the key of ca.pem")
    return certificate, key


def _hosts(args: argparse.Namespace, bus: BusConfig, folder: Path) -> dict[RouterSide, list[str]]:
    """Names and addresses for each certificate: those asked for, the link's, and on renewal those of the old one."""
    link_host = bus.link.partition("/")[2].rpartition(":")[0].strip("[]")
    hosts: dict[RouterSide, list[str]] = {"onboard": [*args.vehicle_host, link_host], "ground": [*args.ground_host]}
    for side in _SIDES:
        old = side_files(folder, side).certificate
        if args.renew and old.exists():
            names = x509.load_pem_x509_certificate(read(old)).extensions.get_extension_for_class(
                x509.SubjectAlternativeName
            )
            hosts[side] += [str(name.value) for name in names.value]
        hosts[side] += ["localhost", "127.0.0.1"]
    return hosts


def make(args: argparse.Namespace, bus: BusConfig) -> Path:
    """Make or renew the folder that the arguments name; returns it.

    Raises:
        ConfigError: it is there already, the authority's key is not, or a host or vehicle name cannot stand in a
            certificate.
    """
    folder = Path(args.folder)
    if len(certificate_name("onboard", bus.vehicle)) > _LONGEST_NAME:
        raise ConfigError(f"bus.vehicle: got {len(bus.vehicle)} characters, too many for a certificate")
    own = folder / "ca"
    there = [side_files(folder, side).key for side in _SIDES] + [own / "ca.key"]
    present = [str(path) for path in there if path.exists()]
    if present and not (args.force or args.renew):
        raise ConfigError(
            f"keys: {', '.join(present)} exists; --renew makes new certificates of the same authority, "
            f"--force makes everything anew (both machines then need their folders again)"
        )
    files: Files = {}
    if args.renew or args.ca:
        authority = _read_authority(Path(args.ca) if args.ca else own)
    else:
        authority = make_authority(bus.vehicle, datetime.datetime.now(datetime.UTC))
        files |= {own / "ca.pem": _pem(authority[0]), own / "ca.key": _pem(authority[1])}
    files |= router_files(folder, authority, bus.vehicle, _hosts(args, bus, folder), args.days)
    if not args.renew:
        files |= password_files(folder)
    write(files)
    return folder


def zenohd_file(bus: BusConfig, side: RouterSide) -> str:
    """Configuration file (JSON5) with which a plain `zenohd` does what our router of a side does.

    Paths are those of a machine that keeps its part of the folder of `outrider keys` as `/etc/outrider/keys/<side>`.
    """
    places = side_files(_ETC, side)
    password = f"the line in {places.password(LINK_USER)}" if side == "ground" else None
    settings = zenoh_settings(
        {
            **router_settings(bus, side),
            "transport/link/tls": tls_settings(places),
            "transport/auth/usrpwd": login_settings(places, password),
        }
    )
    nested: dict[str, Any] = {}
    for path, value in settings.items():
        *parents, last = path.split("/")
        table = nested
        for parent in parents:
            table = table.setdefault(parent, {})
        table[last] = value
    return f"{_ZENOHD_HEADER.format(side=side, vehicle=bus.vehicle)}{json.dumps(nested, indent=2)}\n"


def write_zenohd(folder: Path, bus: BusConfig) -> list[Path]:
    """Write the `zenohd` files of both sides; returns their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for side in _SIDES:
        paths.append(folder / f"{side}.json5")
        paths[-1].write_text(zenohd_file(bus, side), encoding="utf-8")
    return paths


def run(args: argparse.Namespace) -> int:
    """Do what `outrider keys` was asked for; returns the exit code."""
    bus = load_config(args.config, args.overrides).section(BusConfig)
    if args.zenohd:
        for path in write_zenohd(Path(args.zenohd), _secured(bus)):
            print(path)
        return 0
    if args.check:
        return _check(Path(args.folder), bus)
    folder = make(args, bus)
    until = check_router(str(folder), "onboard", bus.vehicle, datetime.datetime.now(datetime.UTC))
    check_router(str(folder), "ground", bus.vehicle, datetime.datetime.now(datetime.UTC))
    print(f"vehicle {bus.vehicle}: certificates valid until {until.date()}, then: outrider keys --renew")
    print(f"  {folder}/onboard  to the vehicle's computer")
    print(f"  {folder}/ground   to the ground station's computer")
    if not args.ca:
        print(f"  {folder}/ca       keep offline: whoever has ca.key can let anybody in; needed only to renew")
    print(f'In the vehicle file, on both:\n  [bus.tls]\n  folder = "{folder}"')
    return 0


def _secured(bus: BusConfig) -> BusConfig:
    """The bus as it would be with security on: a vehicle file need not have it yet when `zenohd` files are made."""
    link = bus.link if bus.link.startswith("tls/") else "tls/" + bus.link.partition("/")[2].rpartition(":")[0] + ":7449"
    secured = msgspec.structs.replace(
        bus, link=link, tls=TlsConfig(folder=bus.tls.folder or "keys", listen=bus.tls.listen)
    )
    secured.check()
    return secured


def _check(folder: Path, bus: BusConfig) -> int:
    """Print what the router of each side in the folder would say at its start; 0 when all is well."""
    now = datetime.datetime.now(datetime.UTC)
    present: list[RouterSide] = [side for side in _SIDES if (folder / side).is_dir()]
    if not present:
        raise ConfigError(f"keys: got folder {str(folder)!r}, expected one with {' or '.join(_SIDES)} in it")
    wrong = 0
    for side in present:
        try:
            until = check_router(str(folder), side, bus.vehicle, now)
            print(f"{side:8} good until {until:%Y-%m-%d %H:%M} UTC, {(until - now).days} days")
        except ConfigError as error:
            print(f"{side:8} {error}")
            wrong += 1
    return 1 if wrong else 0
