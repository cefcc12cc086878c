"""All checks, in the order in which they run."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

from common.config import ConfigError, unknown_key_text
from simulation.conformance.checks import attitude, ending, ground, motion, sticks, stream
from simulation.conformance.judge import Judge
from simulation.conformance.vehicle import Vehicle

Place = Literal["ground", "air", "landing"]


@dataclass(frozen=True)
class Check:
    """One check."""

    name: str
    """Name on the command line and in the table."""
    run: Callable[[Vehicle, Judge], None]
    """Looks and compares."""
    place: Place = "ground"
    """Where it begins: on the ground, in the air (OFFBOARD, at rest, 5 m), or in the air and ending on the ground."""
    quick: bool = True
    """Whether a quick run has it."""
    commands: bool = False
    """On the ground: whether it spins the motors or restarts the autopilot."""

    @property
    def doc(self) -> str:
        """What PX4 does, in one line."""
        return (self.run.__doc__ or "").strip().splitlines()[0]

    @property
    def moves(self) -> bool:
        """Whether it needs leave to arm: in the air, or motors on the ground."""
        return self.place != "ground" or self.commands


CHECKS: dict[str, Check] = {
    check.name: check
    for check in (
        Check("connect", ground.connect),
        Check("rates", ground.rates),
        Check("health", ground.health),
        Check("home", ground.home),
        Check("parameters", ground.parameters),
        Check("return-altitude", ground.return_altitude),
        Check("signing", ground.signing),
        Check("offboard-refused", ground.offboard_refused),
        Check("arming", ground.arming, commands=True),
        Check("refusal-texts", ground.refusal_texts, quick=False, commands=True),
        Check("takeoff", motion.takeoff, "air"),
        Check("step", motion.step, "air"),  # first: what other checks leave in the integrators bends it
        Check("velocity", motion.velocity, "air"),
        Check("acceleration", motion.acceleration, "air"),
        Check("yaw-rate", motion.yaw_rate, "air", quick=False),
        Check("body-velocity", motion.body_velocity, "air", quick=False),
        Check("position", motion.position, "air"),
        Check("yaw-step", motion.yaw_step, "air", quick=False),
        Check("climb-step", motion.climb_step, "air", quick=False),
        Check("stream-1.1", stream.slow_stream, "air", quick=False),
        Check("stream-0.9", stream.too_slow_stream, "air", quick=False),
        Check("loss-0", stream.loss(0), "air", quick=False),
        Check("loss-3", stream.loss(3), "air", quick=False),
        Check("loss-4", stream.loss(4), "air"),
        Check("loss-5", stream.loss(5), "air"),
        Check("yielding", stream.yielding, "air"),
        Check("mode-latency", stream.mode_latency, "air", quick=False),
        Check("attitude", attitude.attitude, "air", quick=False),
        Check("thrust", attitude.thrust, "air", quick=False),
        Check("fence", sticks.fence, "air", quick=False),
        Check("altitude-sticks", sticks.altitude_sticks, "air", quick=False),
        Check("position-sticks", sticks.position_sticks, "air", quick=False),
        Check("land", ending.land, "landing"),
        Check("reboot", ending.reboot, quick=False, commands=True),
    )
}


def select(names: Iterable[str], quick: bool) -> list[Check]:
    """The checks of these names, or all, or the quick ones, in order.

    Raises:
        ConfigError: an unknown name.
    """
    wanted = set(names)
    for name in sorted(wanted - set(CHECKS)):
        raise ConfigError(f"conformance --only: {unknown_key_text(name, CHECKS)}")
    return [c for c in CHECKS.values() if (c.name in wanted if wanted else c.quick or not quick)]
