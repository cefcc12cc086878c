"""The operator's stick on the command line: a velocity for a bounded time, as the console's stick asks for it."""

from __future__ import annotations

import argparse
import math
import sys
import time
from dataclasses import dataclass

from common.bus import Bus
from common.config import ConfigError
from common.header import Received
from common.messages import HelmStatus, Request, VehicleState

NAME = "stick"
"""Word on the command line."""
DOC = "hold the operator's stick for a time: --forward, --right, --up, --turn, --for"
"""One line for help texts."""
LONGEST_S = 60.0
"""Longest time for which one command may hold the stick, s."""
_PERIOD_S = 0.05
_STATE_WAIT_S = 2.0
_HOVER_S = 0.3


@dataclass(frozen=True)
class Push:
    """What to ask for, and for how long."""

    request: Request
    """Velocity in the `heading` frame."""
    duration_s: float
    """For so long, s."""


def add(sub: argparse._SubParsersAction) -> argparse.ArgumentParser:
    """Add the command to the command line; returns its parser."""
    parser = sub.add_parser(
        NAME,
        help="Fly by the operator's stick for a time",
        description="Ask for a velocity, seen from the vehicle, 20 times a second and for a bounded time; then hover. "
        "Helm obeys in hold, operator, return and during any task, which it ends; containment and limiter apply. "
        "Exit code 0 when helm obeyed to the end, 1 otherwise. Ctrl-C lets go.",
    )
    add_options(parser)
    parser.add_argument("--side", choices=("onboard", "ground"), default="ground", help="whose router to use")
    return parser


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the axes and the time to a parser."""
    group = parser.add_argument_group("stick")
    for axis, unit, doc in (
        ("forward", "M_S", "velocity along the heading, m/s"),
        ("right", "M_S", "velocity to the right, m/s"),
        ("up", "M_S", "climb rate, m/s"),
        ("turn", "RAD_S", "heading rate, clockwise, rad/s"),
    ):
        group.add_argument(f"--{axis}", type=float, default=0.0, metavar=unit, help=doc)
    group.add_argument(
        "--for",
        dest="duration_s",
        type=float,
        default=1.0,
        metavar="S",
        help=f"how long, s, up to {LONGEST_S:g} (default: 1)",
    )


def push_of(args: argparse.Namespace) -> Push:
    """What the options ask for.

    Raises:
        ConfigError: a number is not finite, all are zero, or the time is not above 0 and at most a minute.
    """
    values = {name: getattr(args, name) for name in ("forward", "right", "up", "turn")}
    for name, value in values.items():
        if not math.isfinite(value):
            raise ConfigError(f"stick --{name}: got {value}, expected a finite number")
    if not any(values.values()):
        raise ConfigError("stick: got no motion, expected at least one of --forward, --right, --up, --turn")
    if not 0.0 < args.duration_s <= LONGEST_S:
        raise ConfigError(f"stick --for: got {args.duration_s:g}, expected above 0 and at most {LONGEST_S:g} s")
    vector = (values["forward"], values["right"], -values["up"])
    return Push(Request(frame="heading", vector=vector, yaw_rate_rad_s=values["turn"]), args.duration_s)


class _Ears:
    """Newest word of helm."""

    def __init__(self, bus: Bus):
        self.state: Received[VehicleState] | None = None
        self.status: HelmStatus | None = None
        bus.subscribe("helm/state", self._on_state)
        bus.subscribe("helm/status", self._on_status)

    def _on_state(self, received: Received[VehicleState]) -> None:
        self.state = received

    def _on_status(self, received: Received[HelmStatus]) -> None:
        self.status = received.message


def hold(bus: Bus, push: Push) -> int:
    """Hold the stick, then let go; prints what helm made of it and returns the exit code.

    Args:
        bus: a session of an identity that may write the operator's requests.
        push: what, and for how long.
    """
    ears = _Ears(bus)
    deadline = time.monotonic() + _STATE_WAIT_S
    while ears.state is None or ears.status is None:
        if time.monotonic() > deadline:
            print("stick: refused: no word from helm; is the onboard side running?", file=sys.stderr)
            return 1
        time.sleep(0.02)
    end, obeyed = time.monotonic() + push.duration_s, False
    try:
        while (now := time.monotonic()) < end:
            # Stamped with the newest state: a link that falls silent makes the request stale, and the vehicle hovers.
            bus.publish("helm/request/operator", push.request, ears.state.header.capture_ns)
            obeyed |= ears.status.state == "operator"
            time.sleep(max(0.0, min(now + _PERIOD_S, end) - time.monotonic()))
        held = ears.status.state == "operator"
    finally:
        _let_go(bus, ears)
    if held:
        print(f"stick: done: held for {push.duration_s:g} s")
        return 0
    word = "helm stopped obeying" if obeyed else "helm did not obey"
    print(f"stick: {'failed' if obeyed else 'refused'}: {word}; it is {ears.status.state} ({ears.status.reason})")
    return 1


def _let_go(bus: Bus, ears: _Ears) -> None:
    """An explicit hover, so that the vehicle need not wait for the last request to grow stale."""
    end = time.monotonic() + _HOVER_S
    while time.monotonic() < end and ears.state is not None:
        bus.publish(
            "helm/request/operator", Request(frame="heading", vector=(0.0, 0.0, 0.0)), ears.state.header.capture_ns
        )
        time.sleep(_PERIOD_S)
