"""Ways in the scenario file: corners with speeds, rounded, driven or walked for ever."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import msgspec

from common.config import ConfigError, NonNegative, Positive, Section


class WaypointConfig(Section, frozen=True, kw_only=True):
    """One corner of a path; the path rounds it."""

    north_m: float
    """Position, north, m."""
    east_m: float
    """Position, east, m."""
    speed_m_s: Annotated[float, msgspec.Meta(gt=0, le=2.5)] = 1.0
    """Speed wanted from here to the next waypoint, m/s."""
    stop_s: NonNegative = 0.0
    """How long it stands here, s; 0: it passes through."""


class PathConfig(Section, frozen=True, kw_only=True):
    """Way of a car or a person: a rounded polyline, followed for ever. Without waypoints it stands at its place."""

    waypoints: tuple[WaypointConfig, ...] = ()
    """Corners in driving order; a loop returns to the first one."""
    mode: Literal["loop", "ping_pong"] = "loop"
    """`loop`: round and round. `ping_pong`: to the last waypoint, and back in reverse."""
    turn_radius_m: Positive = 1.2
    """Radius of the rounded corners, m; less where the segments are too short."""
    acceleration_m_s2: Positive = 1.0
    """Largest change of speed, m/s²."""
    lateral_acceleration_m_s2: Positive = 1.0
    """Largest sideways acceleration in a turn, m/s²."""
    turn_rate_rad_s: Positive = 1.0
    """Largest heading rate, rad/s."""
    speed_scale: Positive = 1.0
    """Factor on all speeds; 2.5 m/s is kept as the limit."""
    start_delay_s: NonNegative = 0.0
    """How long it stands at the first waypoint before it moves, s."""

    def check(self) -> None:
        """Refuse a path of too few points, equal neighbours, and a turn back on the spot."""
        loop = self.mode == "loop"
        count, least = len(self.waypoints), 3 if loop else 2
        if 0 < count < least:
            raise ConfigError(f"waypoints: got {count}, expected none (parked) or at least {least} for a {self.mode}")
        points = [(w.north_m, w.east_m) for w in self.waypoints]
        for i in range(count if loop else count - 1):
            if math.dist(points[i], points[(i + 1) % count]) < 0.05:
                raise ConfigError(
                    f"waypoints[{i}]: got {points[i]}, the same place as the next one; remove one of them"
                )
        for i in range(0 if loop else 1, count if loop else count - 1):
            (n0, e0), (n1, e1), (n2, e2) = points[i - 1], points[i], points[(i + 1) % count]
            turn = math.atan2(e2 - e1, n2 - n1) - math.atan2(e1 - e0, n1 - n0)
            if abs(math.degrees(math.remainder(turn, math.tau))) > 170:
                raise ConfigError(
                    f"waypoints[{i}]: got a turn of more than 170 degrees at {points[i]}; "
                    "put another waypoint beside it"
                )
