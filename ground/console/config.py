"""Settings of the operator console (`[console]` of the ground station's file)."""

from __future__ import annotations

import ipaddress
from typing import Annotated
from urllib.parse import urlsplit

import msgspec

from common.config import ConfigError, Fraction, NonNegative, Port, Positive, Section
from common.topics import CAMERAS


def is_loopback(host: str) -> bool:
    """Whether a server on this address can be reached from its own machine alone."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


class ConsoleConfig(Section, frozen=True, kw_only=True):
    """Where the console listens, what it shows and when it warns."""

    host: str = "127.0.0.1"
    """Address on which the page is served. One that others can reach needs `password_file`."""
    password_file: str = ""
    """File with the password's hash, made by `outrider console-password`; empty: no password, on loopback only."""
    origins: tuple[str, ...] = ()
    """Origins of pages that may connect besides the console's own: a reverse proxy's, `https://console.example`."""
    tls_certificate: str = ""
    """PEM file with the certificate (chain) of the page; empty: plain HTTP."""
    tls_key: str = ""
    """PEM file with the certificate's key."""
    port: Port = 8080
    """TCP port of the page."""
    camera: str = "down"
    """Camera of the vehicle that the page shows first; the operator may choose another."""
    picture_rate_hz: Annotated[float, msgspec.Meta(gt=0, le=15)] = 15.0
    """Pictures a second that go to each browser, Hz, up to 15."""
    jpeg_quality: Annotated[int, msgspec.Meta(ge=10, le=95)] = 75
    """Quality of the pictures that go to the browser, 10 to 95."""
    picture_age_alarm_ms: Positive = 1000.0
    """Age of the newest picture above which the operator is alarmed, ms. It is marked as old well before."""
    takeoff_height_m: Annotated[float, msgspec.Meta(ge=1, le=30)] = 5.0
    """Height that the page offers for the take-off, m above home, 1 to 30; helm has limits of its own."""
    stick_speed_m_s: Positive = 1.0
    """Speed at full deflection of the stick that the page begins with, m/s."""
    stick_speed_max_m_s: Positive = 3.0
    """Greatest speed that the page offers, m/s; helm's containment and limiter have the last word."""
    stick_climb_m_s: Positive = 0.7
    """Climb and sink rate at full deflection, m/s."""
    stick_turn_rad_s: Positive = 0.6
    """Heading rate at full deflection, rad/s."""
    battery_low_fraction: Fraction = 0.3
    """Remaining charge below which the operator is told to return, 0 to 1."""
    battery_empty_fraction: Fraction = 0.15
    """Remaining charge below which the operator is told to land, 0 to 1."""
    history_s: Positive = 30.0
    """Time span of the error plot, s."""
    trail_s: NonNegative = 120.0
    """Time span of the flown path in the 3-D view, s."""
    nodes: tuple[str, ...] = (
        "camera",
        "proximity",
        "people",
        "approach",
        "follow",
        "helm",
        "pursuit",
        "recorder",
        "world",
    )
    """Nodes whose life and health are shown."""
    essential_nodes: tuple[str, ...] = ("camera", "helm", "pursuit")
    """Nodes whose absence is an alarm."""

    def check(self) -> None:
        """Refuse a console open to others, values in the wrong order, and essential nodes that are not shown."""
        self._check_access()
        if self.camera not in CAMERAS:
            raise ConfigError(f"camera: got {self.camera!r}, expected one of {', '.join(CAMERAS)}")
        if self.battery_empty_fraction > self.battery_low_fraction:
            raise ConfigError(
                f"battery_empty_fraction: got {self.battery_empty_fraction}, expected at most "
                f"battery_low_fraction = {self.battery_low_fraction}"
            )
        if self.stick_speed_m_s > self.stick_speed_max_m_s:
            raise ConfigError(
                f"stick_speed_m_s: got {self.stick_speed_m_s}, expected at most "
                f"stick_speed_max_m_s = {self.stick_speed_max_m_s}"
            )
        for name in self.nodes:
            if not name or "/" in name:
                raise ConfigError(f"nodes: got {name!r}, expected names without '/'")
        unknown = [name for name in self.essential_nodes if name not in self.nodes]
        if unknown:
            raise ConfigError(f"essential_nodes: got {unknown[0]!r}, expected some of nodes = {', '.join(self.nodes)}")

    def _check_access(self) -> None:
        if not self.host.strip():
            raise ConfigError("host: got an empty address, expected one such as 127.0.0.1")
        if not is_loopback(self.host) and not self.password_file:
            raise ConfigError(
                f"host: got {self.host!r}, which others can reach, without a password; make one with "
                f"`outrider console-password FILE` and set console.password_file, or use 127.0.0.1"
            )
        if bool(self.tls_certificate) != bool(self.tls_key):
            raise ConfigError("tls_certificate: got one of tls_certificate and tls_key, expected both or neither")
        for origin in self.origins:
            parts = urlsplit(origin)
            whole = parts.netloc and origin == f"{parts.scheme}://{parts.netloc}"
            if parts.scheme not in ("http", "https") or not whole:
                raise ConfigError(f"origins: got {origin!r}, expected one such as https://console.example, no path")
