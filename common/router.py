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


def run_onboard(config: Config, stop: threading.Event) -> int:
    """The vehicle's router; also publishes the session message that maps the vehicle clock to UTC.

    Raises:
        ConfigError: the endpoint cannot be bound.
    """
    bus_config = config.section(BusConfig)
    router = open_router(bus_config, "onboard")
    log.info("vehicle %s, listening on %s", bus_config.vehicle, bus_config.onboard_router)
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
    while not stop.wait(_PERIOD_S):
        now_linked = bool(router.info.routers_zid())
        if now_linked != linked:
            log.log(
                logging.INFO if now_linked else logging.WARNING,
                "link to the vehicle %s",
                "is up" if now_linked else "is lost",
            )
            linked = now_linked
        beat()
    router.close()
    return 0
