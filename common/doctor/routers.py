"""Checks of the running system over its routers: who lives, whether the link is up, how the clocks stand."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator, Sequence
from typing import Any

from common.bus import Bus
from common.config import Config
from common.doctor.finding import Finding, fault, ok, warning
from common.doctor.ports import holders, tcp_port
from common.header import Received
from common.messages import Health, Session
from common.processes import side_processes
from common.session import BusConfig, RouterAbsent, Side

_OPEN_S = 1.0
_SILENT = ("router-ground", "autopilot")  # they have no liveliness token
_OFFSET_S = 0.5
_DRIFT = 0.04


@contextlib.contextmanager
def visit(config: Config, side: Side) -> Iterator[Bus | None]:
    """A session on the router of a side; None when no router answers."""
    try:
        bus = Bus(config.section(BusConfig), side, "doctor", wait_s=_OPEN_S)
    except RouterAbsent:
        yield None
        return
    with bus:
        yield bus


def hear(bus: Bus, names: Sequence[str], seconds: float) -> dict[str, list[Received[Any]]]:
    """What arrives on some topics; returns as soon as each has brought two messages, or the time is over."""
    heard: dict[str, list[Received[Any]]] = {name: [] for name in names}
    changed = threading.Condition()

    def receive(name: str, received: Received[Any]) -> None:
        with changed:
            heard[name].append(received)
            changed.notify()

    for name in names:
        bus.subscribe(name, lambda r, n=name: receive(n, r))
    with changed:
        changed.wait_for(lambda: all(len(messages) >= 2 for messages in heard.values()), seconds)
    return heard


def routers(config: Config, sides: tuple[Side, ...]) -> Iterator[Finding]:
    """Whether the routers answer, which nodes live on them, and whether the link between them is up."""
    bus_config = config.section(BusConfig)
    asked: tuple[Side, ...] = ("onboard", "ground")
    for side in asked:
        if not {"onboard": {"onboard", "sim"}, "ground": {"ground"}}[side] & set(sides):
            continue
        endpoint, name = bus_config.router_of(side), f"router-{side}"
        with visit(config, side) as bus:
            if bus is None:
                yield _absent(side, endpoint)
                continue
            yield ok(name, f"answers at {endpoint}")
            alive = bus.alive()
        here = [s for s in ("onboard", "sim", "ground") if s in sides and (s == "ground") == (side == "ground")]
        yield from _nodes(side, here, alive)
        if side == "ground" and "router-onboard" not in alive:
            yield fault(
                "link to the vehicle",
                f"down: {bus_config.link} does not answer the ground's router",
                "start `outrider onboard`, check the radio, or set bus.link to the vehicle's router",
            )
        elif side == "ground":
            yield ok("link to the vehicle", f"up, {bus_config.link}")


def _absent(side: str, endpoint: str) -> Finding:
    if holders("tcp", tcp_port(endpoint)):
        return fault(
            f"router-{side}",
            f"something listens at {endpoint} and is no router of ours",
            f"end it, or set bus.{side}_router to a free port",
        )
    return warning(f"router-{side}", f"not running: nobody answers at {endpoint}", f"start `outrider {side}`")


def _nodes(side: str, here: Sequence[Any], alive: dict[str, list[int]]) -> Iterator[Finding]:
    expected = [p.name for s in here for p in side_processes(s) if p.name not in _SILENT]
    yield ok(f"nodes seen by the {side} router", ", ".join(sorted(alive)) or "none")
    for name, boots in sorted(alive.items()):
        if len(boots) > 1:
            yield fault(f"node {name}", f"runs {len(boots)} times", "end all but one")
    missing = [name for name in expected if name not in alive]
    if missing:
        yield warning(
            "nodes",
            f"not running: {', '.join(missing)}",
            f"`outrider node {missing[0]}` shows why, unless it was left out on purpose",
        )


def clocks(config: Config, sides: tuple[Side, ...]) -> Iterator[Finding]:
    """How the vehicle's UTC and the autopilot's clock stand against this machine, when the system runs."""
    side: Side = "ground" if "ground" in sides else "onboard"
    with visit(config, side) as bus:
        if bus is None:
            return
        heard = hear(bus, ("session", "health/helm"), 2.6)
        for received in heard["session"][-1:] if side == "ground" else ():
            session: Session = received.message
            now_utc_ns = time.time_ns() - (time.monotonic_ns() - received.received_ns)
            offset_s = (now_utc_ns - session.utc_ns) / 1e9
            subject, text = "UTC of vehicle and ground", f"{offset_s * 1e3:+.0f} ms apart, transport included"
            if abs(offset_s) > _OFFSET_S:
                yield warning(subject, text, "run a time service on both machines")
            else:
                yield ok(subject, text)
        for received in heard["health/helm"][-1:]:
            health: Health = received.message
            drift = health.metrics.get("clock_drift", 0.0)
            if drift == 0.0:
                continue  # not measured: no autopilot, or one of less than two seconds
            text = f"this machine gains {drift:+.1%} on it, which helm corrects"
            if abs(drift) > _DRIFT:
                yield warning("autopilot's clock", text + " up to 5 %", "look for what slows the autopilot down")
            else:
                yield ok("autopilot's clock", text)
