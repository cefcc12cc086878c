"""Zenoh sessions: where the routers are, a router a side, clients that wait for theirs.

Topology and settings follow measurements: no multicast, short retries, a short lease, and loopback unless an endpoint
says otherwise.
"""

from __future__ import annotations

import json
import logging
import threading
import time
from typing import Any, Literal

import zenoh

from common import topics
from common.config import ConfigError, Section
from common.heartbeat import beat

log = logging.getLogger(__name__)

Side = Literal["onboard", "ground", "sim"]
_LEASE_MS = 2000
_OPEN_ATTEMPT_MS = 400


class BusConfig(Section, frozen=True, kw_only=True):
    """Where the routers are."""

    vehicle: str = "kite"
    """Name of the vehicle: the second segment of every key."""
    onboard_router: str = "tcp/127.0.0.1:7447"
    """Endpoint on which the vehicle's router listens; the vehicle's nodes and the simulated world connect to it."""
    ground_router: str = "tcp/127.0.0.1:7448"
    """Endpoint on which the ground station's router listens; the ground's nodes connect to it."""
    link: str = "tcp/127.0.0.1:7447"
    """Endpoint to which the ground station's router connects: the vehicle's router as seen over the radio."""

    def check(self) -> None:
        """Refuse a vehicle name that is no single key segment, and endpoints without protocol and address."""
        if not self.vehicle or any(c in self.vehicle for c in "/*$?#"):
            raise ConfigError(f"vehicle: got {self.vehicle!r}, expected a name without / * $ ? #")
        for name in ("onboard_router", "ground_router", "link"):
            endpoint = getattr(self, name)
            protocol, _, address = endpoint.partition("/")
            if protocol not in ("tcp", "tls", "quic", "ws") or ":" not in address:
                raise ConfigError(f"{name}: got {endpoint!r}, expected protocol/host:port such as tcp/127.0.0.1:7447")

    def router_of(self, side: Side) -> str:
        """Endpoint of the router that nodes of a side use; the simulated world hangs on the vehicle's."""
        return self.ground_router if side == "ground" else self.onboard_router


def _zenoh_config(settings: dict[str, Any]) -> zenoh.Config:
    common_settings = {
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "connect/retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 1.5},
        "transport/link/tx/lease": _LEASE_MS,
        "transport/link/tx/queue/size/data": 16,
        "transport/link/tx/queue/size/data_low": 16,
    }
    config = zenoh.Config()
    for path, value in {**common_settings, **settings}.items():
        config.insert_json5(path, json.dumps(value))
    return config


def open_router(config: BusConfig, side: Side) -> zenoh.Session:
    """Router session of a side; the ground's keeps a link to the vehicle's.

    Raises:
        ConfigError: the endpoint is taken or cannot be bound.
    """
    endpoint = config.router_of(side)
    settings: dict[str, Any] = {
        "mode": "router",
        "listen/endpoints": [endpoint],
        "listen/exit_on_failure": True,
        "listen/timeout_ms": 0,
    }
    if side == "ground":
        settings["connect/endpoints"] = [config.link]
        settings["connect/timeout_ms"] = -1
        settings["connect/exit_on_failure"] = False
        settings["access_control"] = _keep_local_streams_off_the_link()
    try:
        return zenoh.open(_zenoh_config(settings))
    except zenoh.ZError as error:
        raise ConfigError(
            f"router of the {side} side: cannot listen on {endpoint!r} ({str(error).splitlines()[0][:160]}); "
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


def open_client(endpoint: str, wait_s: float | None, stop: threading.Event | None) -> zenoh.Session:
    """Client session, opened as soon as the router is there.

    In client mode the library's own open blocks until a router comes and cannot be interrupted, or gives up at once;
    so it is tried in short attempts. Once open, the session finds a restarted router again by itself.
    """
    deadline = None if wait_s is None else time.monotonic() + wait_s
    told = False
    while True:
        try:
            return zenoh.open(
                _zenoh_config(
                    {
                        "mode": "client",
                        "connect/endpoints": [endpoint],
                        "connect/timeout_ms": _OPEN_ATTEMPT_MS,
                        "connect/exit_on_failure": True,
                    }
                )
            )
        except zenoh.ZError:
            if (deadline is not None and time.monotonic() >= deadline) or (stop is not None and stop.is_set()):
                raise RouterAbsent(
                    f"no Zenoh router answers at {endpoint}; start `outrider onboard` (or `outrider "
                    f"ground`), or correct the [bus] section"
                ) from None
        if not told:
            log.info("waiting for the router at %s", endpoint)
            told = True
        beat()
