"""What sources see around the vehicle, and what the limiter makes of it."""

from __future__ import annotations

import math
from typing import Literal

from common.messages.base import Message, MessageError, Quat, Vec3, check_direction, check_quaternion, check_range

SECTORS = 72
"""Sectors of 5 degrees around the vehicle, in `LimiterStatus` and in MAVLink's OBSTACLE_DISTANCE."""


class Obstacle(Message, frozen=True, kw_only=True):
    """An obstacle near the vehicle."""

    distance_m: float
    """Distance from the vehicle's centre to the nearest point, m."""
    ned_direction: Vec3
    """Unit vector from the vehicle to that point, NED."""
    ned_v_m_s: Vec3 = (0.0, 0.0, 0.0)
    """Velocity of the obstacle, NED, m/s."""
    label: str = ""
    """Name of a thing that an operator may select (`person 3`); empty for a bare point."""

    def check(self) -> None:
        """Refuse what the field docs rule out."""
        super().check()
        check_range("distance_m", self.distance_m, 0.0, 1e4)
        check_direction("ned_direction", self.ned_direction)


class View(Message, frozen=True, kw_only=True):
    """The region in which a source would have seen an obstacle, in equal angular cells.

    A direction with sensor coordinates (x, y, z) lies at azimuth atan2(x, z) and elevation atan2(y, hypot(x, z)), rad.
    Columns run over azimuth from -half_width to half_width, rows over elevation from -half_height to half_height.
    """

    ned_q_sensor: Quat
    """Attitude of the sensor; its axes are those of a camera's optical frame (x right, y down, z forward)."""
    half_width_rad: float
    """Half the width of the view, rad; pi for a sensor that looks all around."""
    half_height_rad: float
    """Half the height of the view, rad."""
    range_m: float
    """Within this distance of the vehicle's centre an obstacle would have been seen, m."""
    columns: int
    """Cells across."""
    rows: int
    """Cells down."""
    seen: tuple[bool, ...]
    """For each cell, row by row from the top left, whether it had a usable measurement."""

    def check(self) -> None:
        """Refuse what the field docs rule out."""
        super().check()
        check_quaternion("ned_q_sensor", self.ned_q_sensor)
        check_range("half_width_rad", self.half_width_rad, 1e-3, math.pi)
        check_range("half_height_rad", self.half_height_rad, 1e-3, math.pi / 2)
        check_range("range_m", self.range_m, 0.0, 1e4)
        check_range("columns", self.columns, 1, 1024)
        check_range("rows", self.rows, 1, 1024)
        if len(self.seen) != self.columns * self.rows:
            raise MessageError(
                f"seen: got {len(self.seen)} cells, expected {self.columns * self.rows} = {self.columns} columns x "
                f"{self.rows} rows"
            )


class Obstacles(Message, frozen=True, kw_only=True):
    """All obstacles that a source sees at its capture time; an empty list says that its views are free."""

    obstacles: tuple[Obstacle, ...]
    """The obstacles, in no order."""
    views: tuple[View, ...] = ()
    """Where the source would have seen one; a source without views adds obstacles and frees no space."""


class LimiterStatus(Message, frozen=True, kw_only=True):
    """What the limiter does, and the distances that it defends."""

    zone: Literal["safe", "warning", "transition", "collision", "blind"]
    """Zone of the nearest obstacle (Al-Kaff 2019, section 5.1.1); `blind` without obstacle data."""
    distance_m: float
    """Distance of the nearest obstacle, m; -1 when there is none."""
    ned_direction: Vec3
    """Unit vector towards it, NED; zero when there is none."""
    asked_m_s: float
    """Speed asked, m/s."""
    allowed_m_s: float
    """Speed that goes to the autopilot, m/s."""
    why: Literal["clear", "curve", "bound", "blind", "floor", "ceiling", "fence", "push-back", "no data"]
    """What took the most away: the comfortable curve, the braking bound, unseen space, an edge of the flight volume;
    `push-back`: backs away; `no data`: stands because nothing is known; `clear`: nothing was taken away."""
    source: str = ""
    """Topic whose obstacle limits (or is nearest, when nothing does); empty when none does."""
    label: str = ""
    """Name of that obstacle, when it has one."""
    h_min_m: float
    """Collision zone below this distance, m."""
    h_desired_m: float
    """Where the vehicle stops, m."""
    h_mid_m: float
    """Transition zone below this distance, m."""
    h_max_m: float
    """Safe zone above this distance, m."""
    push_back_m_s: float = 0.0
    """Fastest retreat from what is nearer than `h_desired_m`, m/s; 0: off, by configuration or by the operator."""
    sectors_m: tuple[float, ...]
    """Nearest distance in each of 72 sectors of 5 degrees, from north clockwise, m; -1 where nothing is known; the
    range of the source where it sees nothing."""
    seen: tuple[bool, ...]
    """Whether each sector was looked at of late and so is free up to its distance; an obstacle in one that was not is
    remembered, and what lies before it is unknown."""

    def check(self) -> None:
        """Refuse what the field docs rule out."""
        super().check()
        if len(self.sectors_m) != SECTORS:
            raise MessageError(f"sectors_m: got {len(self.sectors_m)} sectors, expected {SECTORS}")
        if len(self.seen) != SECTORS:
            raise MessageError(f"seen: got {len(self.seen)} sectors, expected {SECTORS}")
