"""The certificate of a side's router: checked at its start, handed to Zenoh, and tried out when no link comes."""

from __future__ import annotations

import datetime
import logging
import socket
import ssl
from pathlib import Path
from typing import Any

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import serialization
from cryptography.x509.oid import NameOID

from common.access import LINK_USER, RouterSide, certificate_name
from common.config import ConfigError
from common.key_folder import SideFiles, read, read_password, read_private, side_files

log = logging.getLogger(__name__)

RENEW_BEFORE_DAYS = 30
"""A certificate that ends sooner is reported at each start."""
_PROBE_S = 1.0


def check_router(folder: str, side: RouterSide, vehicle: str, now: datetime.datetime) -> datetime.datetime:
    """Time until which the router of a side can be used, after a check of all its files.

    Args:
        folder: what `outrider keys` made.
        side: whose router.
        vehicle: name of the vehicle.
        now: the time, UTC.

    Raises:
        ConfigError: a file is missing, unreadable or readable by others; the certificate is of another authority, side
            or vehicle, does not fit its key, has expired or is not yet valid.
    """
    files = side_files(folder, side)
    authority = _read_certificate(files.authority)
    certificate = _read_certificate(files.certificate)
    key = serialization.load_pem_private_key(read_private(files.key), None)
    read_private(files.users)
    if key.public_key() != certificate.public_key():
        raise ConfigError(
            f"{files.key}: is not the key of {files.certificate.name}; copy both from one `outrider keys`"
        )
    name = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)[0].value
    if name != certificate_name(side, vehicle):
        raise ConfigError(
            f"{files.certificate}: is for {name!r}, expected {certificate_name(side, vehicle)!r}; "
            f"copy the folder of this side and vehicle, or correct bus.vehicle"
        )
    try:
        certificate.verify_directly_issued_by(authority)
    except (ValueError, TypeError, InvalidSignature):
        raise ConfigError(
            f"{files.certificate}: was not signed by the authority of {files.authority.name}; "
            f"copy both from one `outrider keys`"
        ) from None
    _check_time(files.authority, authority, now)
    _check_time(files.certificate, certificate, now)
    until = min(authority.not_valid_after_utc, certificate.not_valid_after_utc)
    days = (until - now).days
    if days < RENEW_BEFORE_DAYS:
        log.warning("the certificate expires on %s, in %d days: run `outrider keys --renew`", until.date(), days)
    return until


def _check_time(path: Path, certificate: x509.Certificate, now: datetime.datetime) -> None:
    if now < certificate.not_valid_before_utc:
        raise ConfigError(
            f"{path}: valid from {certificate.not_valid_before_utc:%Y-%m-%d %H:%M} UTC, and this machine's clock says "
            f"{now:%Y-%m-%d %H:%M}; set the clock (a companion computer without a battery forgets it)"
        )
    if now > certificate.not_valid_after_utc:
        raise ConfigError(
            f"{path}: expired on {certificate.not_valid_after_utc:%Y-%m-%d %H:%M} UTC (this machine's clock says "
            f"{now:%Y-%m-%d %H:%M}); run `outrider keys --renew` where the authority's key is, and copy the new files"
        )


def _read_certificate(path: Path) -> x509.Certificate:
    data = read(path)
    try:
        return x509.load_pem_x509_certificate(data)
    except ValueError:
        raise ConfigError(f"{path}: is no certificate in PEM; make it anew with `outrider keys`") from None


def tls_settings(places: SideFiles) -> dict[str, Any]:
    """Zenoh's `transport/link/tls` section: certificates wanted and verified on both ends of the link."""
    return {
        "root_ca_certificate": str(places.authority),
        "listen_certificate": str(places.certificate),
        "listen_private_key": str(places.key),
        "connect_certificate": str(places.certificate),
        "connect_private_key": str(places.key),
        "enable_mtls": True,
        "verify_name_on_connect": True,
        "close_link_on_expiration": True,
    }


def login_settings(places: SideFiles, link_password: str | None) -> dict[str, Any]:
    """Zenoh's `transport/auth/usrpwd` section of a router: whom it lets in, and how the ground's logs in itself."""
    settings = {"dictionary_file": str(places.users)}
    if link_password is not None:
        settings |= {"user": LINK_USER, "password": link_password}
    return settings


def secured_settings(folder: str, side: RouterSide) -> dict[str, Any]:
    """Zenoh settings, by path, of a router whose link is TLS and whose neighbours log in."""
    password = read_password(folder, "ground", LINK_USER)[1] if side == "ground" else None
    places = SideFiles(side_files(folder, side).folder.resolve())
    return {
        "transport/link/tls": tls_settings(places),
        "transport/auth/usrpwd": login_settings(places, password),
    }


def why_no_link(link: str, folder: str) -> str:
    """Why the ground's router gets no TLS connection to the vehicle's, in words; empty when it would get one."""
    files = side_files(folder, "ground")
    host, _, port = link.partition("/")[2].rpartition(":")
    host = host.strip("[]")
    context = ssl.create_default_context(cafile=str(files.authority))
    context.load_cert_chain(files.certificate, files.key)
    try:
        plain = socket.create_connection((host, int(port)), _PROBE_S)
    except OSError as error:
        return f"no connection to {host}:{port} ({error})"
    try:
        with plain, context.wrap_socket(plain, server_hostname=host) as secured:
            # The vehicle judges our certificate after our half of the handshake is done; a refusal is an alert.
            secured.recv(1)
    except TimeoutError:
        return ""
    except ssl.SSLCertVerificationError as error:
        return f"the vehicle's certificate is not accepted here: {error.verify_message}"
    except (ssl.SSLError, OSError) as error:
        return f"the vehicle does not accept this certificate, or speaks no TLS at {host}:{port} ({error})"
    return ""
