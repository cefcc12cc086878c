"""Zenoh sessions: where the routers are, a router a side, clients that wait for theirs.

Topology and settings follow measurements: no multicast, short retries, a short lease, and loopback unless an endpoint
says otherwise.
"""

from __future__ import annotations

import datetime
import json
import logging
import threading
import time
from typing import Any, Literal

import zenoh

from common import topics
from common.access import RouterSide, access_control
from common.config import ConfigError, Section
from common.heartbeat import beat
from common.key_folder import read_password

log = logging.getLogger(__name__)

Side = Literal["onboard", "ground", "sim"]
_LEASE_MS = 2000
_OPEN_ATTEMPT_MS = 400


_LOCAL_HOSTS = ("localhost", "[::1]")


class TlsConfig(Section, frozen=True, kw_only=True):
    """Certificates, passwords and access control: who is let in, and what for."""

    folder: str = ""
    """Folder that `outrider keys` made; a machine needs only its own side's part of it. Empty: everybody is let in."""
    listen: str = "tls/0.0.0.0:7449"
    """Endpoint on which the vehicle's router awaits the ground station's; the only one that others can reach."""


class BusConfig(Section, frozen=True, kw_only=True):
    """Where the routers are, and who may talk to them."""

    vehicle: str = "kite"
    """Name of the vehicle: the second segment of every key."""
    onboard_router: str = "tcp/127.0.0.1:7447"
    """Endpoint on which the vehicle's router listens; the vehicle's nodes and the simulated world connect to it."""
    ground_router: str = "tcp/127.0.0.1:7448"
    """Endpoint on which the ground station's router listens; the ground's nodes connect to it."""
    link: str = "tcp/127.0.0.1:7447"
    """Endpoint to which the ground station's router connects: the vehicle's router as seen over the radio."""
    tls: TlsConfig = TlsConfig()
    """Security of the link and of the routers."""

    def check(self) -> None:
        """Refuse a vehicle name that is no single key segment, and endpoints without protocol and address."""
        if not self.vehicle or any(c in self.vehicle for c in "/*$?#"):
            raise ConfigError(f"vehicle: got {self.vehicle!r}, expected a name without / * $ ? #")
        for name in ("onboard_router", "ground_router", "link"):
            endpoint = getattr(self, name)
            protocol, _, address = endpoint.partition("/")
            if protocol not in ("tcp", "tls", "quic", "ws") or ":" not in address:
                raise ConfigError(f"{name}: got {endpoint!r}, expected protocol/host:port such as tcp/127.0.0.1:7447")
        if self.tls.folder:
            self._check_secured()

    def _check_secured(self) -> None:
        """Refuse a locked door with an open one beside it."""
        for name in ("onboard_router", "ground_router"):
            endpoint = getattr(self, name)
            if not endpoint.startswith("tcp/") or not is_local(endpoint):
                raise ConfigError(
                    f"{name}: got {endpoint!r}, expected tcp/127.0.0.1:PORT while tls.folder is set: other machines "
                    f"come in by tls.listen alone"
                )
        for name, endpoint in (("link", self.link), ("tls.listen", self.tls.listen)):
            if not endpoint.startswith("tls/") or not endpoint.rpartition(":")[2].isdigit():
                raise ConfigError(f"{name}: got {endpoint!r}, expected tls/host:port while tls.folder is set")

    def router_of(self, side: Side) -> str:
        """Endpoint of the router that nodes of a side use; the simulated world hangs on the vehicle's."""
        return self.ground_router if side == "ground" else self.onboard_router


def is_local(endpoint: str) -> bool:
    """Whether an endpoint is on loopback, out of other machines' reach."""
    host = endpoint.partition("/")[2].rpartition(":")[0]
    return host in _LOCAL_HOSTS or host.startswith("127.")


def zenoh_settings(settings: dict[str, Any]) -> dict[str, Any]:
    """Settings of a session, by path, with those that every session of ours has."""
    common_settings = {
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "connect/retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 1.5},
        "transport/link/tx/lease": _LEASE_MS,
        "transport/link/tx/queue/size/data": 16,
        "transport/link/tx/queue/size/data_low": 16,
    }
    return {**common_settings, **settings}


def _zenoh_config(settings: dict[str, Any]) -> zenoh.Config:
    config = zenoh.Config()
    for path, value in zenoh_settings(settings).items():
        config.insert_json5(path, json.dumps(value))
    return config


def router_settings(config: BusConfig, side: RouterSide) -> dict[str, Any]:
    """Zenoh settings of a side's router, by path; certificates and passwords are left to the caller."""
    settings: dict[str, Any] = {
        "mode": "router",
        "listen/endpoints": [config.router_of(side)],
        "listen/exit_on_failure": True,
        "listen/timeout_ms": 0,
    }
    if side == "ground":
        settings["connect/endpoints"] = [config.link]
        settings["connect/timeout_ms"] = -1
        settings["connect/exit_on_failure"] = False
        settings["access_control"] = _keep_local_streams_off_the_link()
    elif config.tls.folder:
        settings["listen/endpoints"].append(config.tls.listen)
    if config.tls.folder:
        settings["access_control"] = access_control(side, config.vehicle)
    return settings


def check_keys(config: BusConfig, side: Side) -> datetime.date | None:
    """Date until which the certificate of a side's router is valid; None where there is nothing to check.

    Raises:
        ConfigError: the files of `outrider keys` are not usable.
    """
    if not config.tls.folder or side == "sim":
        return None
    # Imported where it is needed: no other process has to read certificates.
    from common.credentials import check_router

    return check_router(config.tls.folder, side, config.vehicle, datetime.datetime.now(datetime.UTC)).date()


def open_router(config: BusConfig, side: RouterSide) -> zenoh.Session:
    """Router session of a side; the ground's keeps a link to the vehicle's.

    Raises:
        ConfigError: the endpoint is taken or cannot be bound, or certificates or passwords are not usable.
    """
    settings = router_settings(config, side)
    if config.tls.folder:
        from common.credentials import secured_settings

        log.info("certificate of the %s side valid until %s", side, check_keys(config, side))
        settings |= secured_settings(config.tls.folder, side)
    elif not is_local(config.router_of(side)):
        log.warning("%s is open to everybody who reaches it; see `outrider keys`", config.router_of(side))
    try:
        return zenoh.open(_zenoh_config(settings))
    except zenoh.ZError as error:
        endpoints = " and ".join(settings["listen/endpoints"])
        raise ConfigError(
            f"router of the {side} side: cannot listen on {endpoints} ({str(error).splitlines()[0][:160]}); "
            f"is another one running? Stop it, or set bus.{side}_router to a free port"
        ) from None


def _keep_local_streams_off_the_link() -> dict[str, Any]:
    """Access rules of the ground's router: streams that stay on the vehicle are neither asked for nor let through."""
    local = [topics.key("*", t.name) for t in topics.TOPICS.values() if not t.crosses_link]
    return {
        "enabled": True,
        "default_permission": "allow",
        "rules": [
            {
                "id": "local-streams",
                "permission": "deny",
                "messages": ["put", "declare_subscriber"],
                "flows": ["ingress", "egress"],
                "key_exprs": local,
            }
        ],
        "subjects": [{"id": "everyone"}],
        "policies": [{"rules": ["local-streams"], "subjects": ["everyone"]}],
    }


class RouterAbsent(ConfigError):
    """No router answered in the time that the caller was ready to wait."""


def open_client(
    config: BusConfig, side: Side, source: str, wait_s: float | None, stop: threading.Event | None
) -> zenoh.Session:
    """Client session of a process, opened as soon as its side's router is there.

    In client mode the library's own open blocks until a router comes and cannot be interrupted, or gives up at once;
    so it is tried in short attempts. Once open, the session finds a restarted router again by itself.

    Raises:
        ConfigError: the router wants a password, and there is none to read.
        RouterAbsent: no router within `wait_s`, or told to stop.
    """
    endpoint = config.router_of(side)
    settings: dict[str, Any] = {
        "mode": "client",
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": _OPEN_ATTEMPT_MS,
        "connect/exit_on_failure": True,
    }
    or_refuses = ""
    if config.tls.folder:
        user, password = read_password(config.tls.folder, "ground" if side == "ground" else "onboard", source)
        settings["transport/auth/usrpwd"] = {"user": user, "password": password}
        or_refuses = f" (or it refuses the password of {user!r}: is it of the same `outrider keys`?)"
    deadline = None if wait_s is None else time.monotonic() + wait_s
    told = False
    while True:
        try:
            return zenoh.open(_zenoh_config(settings))
        except zenoh.ZError:
            if (deadline is not None and time.monotonic() >= deadline) or (stop is not None and stop.is_set()):
                raise RouterAbsent(
                    f"no Zenoh router answers at {endpoint}{or_refuses}; start `outrider onboard` (or `outrider "
                    f"ground`), or correct the [bus] section"
                ) from None
        if not told:
            log.info("waiting for the router at %s%s", endpoint, or_refuses)
            told = True
        beat()
