"""Which of the obstacles the operator means, and which one it is in the next measurement."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from common.geometry.rotation import Array, wrap_angle
from common.messages import Command, Obstacle, People
from onboard.approach.config import ApproachConfig

_DIRECTION_RAD = math.radians(15.0)
_POINT_M = 1.5
_VELOCITY_SHARE = 0.3  # of each measured velocity; depth points jump by a few cm between the sectors of one body
_FASTEST_M_S = 3.0


class SelectError(ValueError):
    """Nothing there is what the operator asked for; the text says what is."""


@dataclass(frozen=True)
class Sighting:
    """One obstacle at its place."""

    ned_p_m: Array
    """Nearest point (3,), from home, NED, m."""
    ned_v_m_s: Array
    """Velocity (3,) as its source says, NED, m/s."""
    label: str
    """Its name, or empty."""


@dataclass(frozen=True)
class Target:
    """The thing that is approached."""

    ned_p_m: Array
    """Nearest point (3,), when it was last seen, from home, NED, m."""
    ned_v_m_s: Array
    """Velocity (3,), NED, m/s."""
    label: str
    """Its name, or empty."""
    seen_ns: int
    """When it was last seen (vehicle clock), ns."""

    def at(self, t_ns: int) -> Array:
        """Where (3,) it should be at a time, m; it is not carried on for more than half a second."""
        ahead_s = min(max((t_ns - self.seen_ns) / 1e9, 0.0), 0.5)
        return self.ned_p_m + ahead_s * self.ned_v_m_s


def sightings(obstacles: Sequence[Obstacle], ned_p_vehicle_m: Array) -> list[Sighting]:
    """Obstacles as points from home, seen from a vehicle (3,) at its place at their capture time."""
    return [
        Sighting(ned_p_vehicle_m + o.distance_m * np.asarray(o.ned_direction), np.asarray(o.ned_v_m_s), o.label)
        for o in obstacles
    ]


def remembered(people: People) -> list[Sighting]:
    """People who are believed, as standing points where they were last seen."""
    return [
        Sighting(np.asarray(person.ned_p_m), np.zeros(3), person.label)
        for person in people.people
        if person.ned_p_m is not None and person.state in ("seen", "away")
    ]


def choose(
    seen: Sequence[Sighting],
    command: Command,
    ned_p_vehicle_m: Array,
    yaw_rad: float,
    t_ns: int,
    config: ApproachConfig,
) -> Target:
    """The thing that a command names: by label, by a point, by a direction from the nose, or the nearest ahead.

    Args:
        seen: what is there now.
        command: argument of `approach/do/select`.
        ned_p_vehicle_m: the vehicle's place (3,), m.
        yaw_rad: its heading, rad.
        t_ns: when that was seen, ns.
        config: what counts as ahead.

    Raises:
        SelectError: nothing there is meant.
    """

    def distance(s: Sighting) -> float:
        return float(np.linalg.norm(s.ned_p_m - ned_p_vehicle_m))

    def off(s: Sighting, bearing_rad: float) -> float:
        north, east, _ = s.ned_p_m - ned_p_vehicle_m
        return abs(wrap_angle(math.atan2(east, north) - yaw_rad - bearing_rad))

    def level(s: Sighting) -> bool:
        north, east, down = s.ned_p_m - ned_p_vehicle_m
        return abs(math.atan2(down, math.hypot(north, east))) <= config.level_rad

    def nearest(fits: Callable[[Sighting], bool], otherwise: str) -> Sighting:
        fitting = [s for s in seen if fits(s)]
        if not fitting:
            raise SelectError(f"{otherwise}; {_there(seen, ned_p_vehicle_m)}")
        return min(fitting, key=distance)

    if command.label:
        chosen = nearest(lambda s: s.label == command.label, f"label: got {command.label!r}, which is not seen")
    elif command.ned_p_m is not None:
        point = np.asarray(command.ned_p_m)
        chosen = nearest(
            lambda s: float(np.linalg.norm(s.ned_p_m - point)) <= _POINT_M,
            f"nothing is seen within {_POINT_M:g} m of the point",
        )
    elif command.bearing_rad is not None:
        bearing = command.bearing_rad
        chosen = nearest(
            lambda s: level(s) and off(s, bearing) <= _DIRECTION_RAD,
            f"nothing is seen within {math.degrees(_DIRECTION_RAD):.0f} degrees of {math.degrees(bearing):.0f} degrees "
            "from the nose",
        )
    else:
        chosen = nearest(lambda s: level(s) and off(s, 0.0) <= config.ahead_rad, "nothing is seen ahead")
    return Target(chosen.ned_p_m, chosen.ned_v_m_s, chosen.label, t_ns)


def _there(seen: Sequence[Sighting], ned_p_vehicle_m: Array) -> str:
    names = sorted({s.label for s in seen if s.label})
    if names:
        return f"named things that are seen: {', '.join(names)}"
    if not seen:
        return "nothing is seen at all; is the depth camera running?"
    nearest_m = min(float(np.linalg.norm(s.ned_p_m - ned_p_vehicle_m)) for s in seen)
    return f"the nearest of {len(seen)} points is {nearest_m:.1f} m away"


def follow(
    target: Target, seen: Sequence[Sighting], ned_p_vehicle_m: Array, t_ns: int, config: ApproachConfig
) -> Target:
    """The target after a measurement; unchanged when it is not in it.

    A named thing is recognised by its name. Of the others the one nearest to where it should be counts, within a gate
    that grows while nothing is seen; of the points around that one, the one nearest to the vehicle is approached.

    Args:
        target: as it was.
        seen: one source's measurement.
        ned_p_vehicle_m: the vehicle's place (3,) at that time, m.
        t_ns: capture time, ns.
        config: gates.
    """
    gap_s = (t_ns - target.seen_ns) / 1e9
    if gap_s < 0.0:
        return target
    if target.label and (same := [s for s in seen if s.label == target.label]):
        found = min(same, key=lambda s: float(np.linalg.norm(s.ned_p_m - ned_p_vehicle_m)))
        return replace(target, ned_p_m=found.ned_p_m, ned_v_m_s=found.ned_v_m_s, seen_ns=t_ns)
    if gap_s > config.forget_after_s:
        return target
    expected = target.at(t_ns)
    gate_m = min(config.gate_m + config.gate_growth_m_s * gap_s, 2.0 * config.gate_m)
    # A named thing next to it is another one.
    others = [s for s in seen if not s.label]
    near = [s for s in others if float(np.linalg.norm(s.ned_p_m - expected)) <= gate_m]
    if not near:
        return target
    heart = min(near, key=lambda s: float(np.linalg.norm(s.ned_p_m - expected))).ned_p_m
    body = [s for s in others if float(np.linalg.norm(s.ned_p_m - heart)) <= config.spread_m]
    found = min(body, key=lambda s: float(np.linalg.norm(s.ned_p_m - ned_p_vehicle_m)))
    velocity = target.ned_v_m_s
    if 0.02 < gap_s <= config.lost_after_s:
        measured = (found.ned_p_m - target.ned_p_m) / gap_s
        velocity = velocity + _VELOCITY_SHARE * (measured - velocity)
        velocity = velocity * min(1.0, _FASTEST_M_S / max(float(np.linalg.norm(velocity)), 1e-9))
    return replace(target, ned_p_m=found.ned_p_m, ned_v_m_s=velocity, seen_ns=t_ns)
