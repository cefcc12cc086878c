"""The router of a side, as a process: the bus of everything on that machine, and the one link to the other."""

from __future__ import annotations

import logging
import threading
import time

from common.bus import Bus
from common.config import Config
from common.heartbeat import beat
from common.messages import Session
from common.session import BusConfig, open_router

log = logging.getLogger(__name__)
_PERIOD_S = 1.0
_SAY_WHY_AFTER_S = (3.0, 30.0, 300.0)


def run_onboard(config: Config, stop: threading.Event) -> int:
    """The vehicle's router; also publishes the session message that maps the vehicle clock to UTC.

    Raises:
        ConfigError: the endpoint cannot be bound.
    """
    bus_config = config.section(BusConfig)
    router = open_router(bus_config, "onboard")
    outside = f" and {bus_config.tls.listen}" if bus_config.tls.folder else ""
    log.info("vehicle %s, listening on %s%s", bus_config.vehicle, bus_config.onboard_router, outside)
    bus = Bus(bus_config, "onboard", "router-onboard", stop=stop)
    bus.announce()
    while not stop.wait(_PERIOD_S):
        bus.publish(
            "session", Session(vehicle=bus_config.vehicle, monotonic_ns=time.monotonic_ns(), utc_ns=time.time_ns())
        )
        beat()
    bus.close()
    router.close()
    return 0


def run_ground(config: Config, stop: threading.Event) -> int:
    """The ground station's router; says when the link to the vehicle comes and goes.

    Raises:
        ConfigError: the endpoint cannot be bound.
    """
    bus_config = config.section(BusConfig)
    router = open_router(bus_config, "ground")
    log.info("listening on %s, link to the vehicle at %s", bus_config.ground_router, bus_config.link)
    linked = False
    waiting_s = 0.0
    while not stop.wait(_PERIOD_S):
        now_linked = bool(router.info.routers_zid())
        if now_linked != linked:
            log.log(
                logging.INFO if now_linked else logging.WARNING,
                "link to the vehicle %s",
                "is up" if now_linked else "is lost",
            )
            linked, waiting_s = now_linked, 0.0
        waiting_s += _PERIOD_S
        if bus_config.tls.folder and not linked and waiting_s in _SAY_WHY_AFTER_S:
            _say_why(bus_config)
        beat()
    router.close()
    return 0


def _say_why(bus_config: BusConfig) -> None:
    """Log why the vehicle's router cannot be reached; the library keeps trying without a word."""
    from common.credentials import why_no_link

    if why := why_no_link(bus_config.link, bus_config.tls.folder):
        log.warning("no link to the vehicle at %s: %s", bus_config.link, why)
