"""The ground robot: turn or drive, whichever error is larger (Echeverri 2016, 3.5), for a unicycle."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from common.config import Fraction, NonNegative, Positive, Section
from onboard.follow.gains import pd_gains

Axis = Literal["turn", "drive"]
_MOST_ASIDE_RAD = 1.5
"""Bearing that is still a column, rad: the tangent has no end at a right angle."""


class UnicycleConfig(Section, frozen=True, kw_only=True):
    """Poles, ranges that make both errors comparable, and limits.

    The thesis drives by Kp = 0.82 on metres and turns by Kp = 0.4, Kd = 0.03 on its normalised column, found by trial.
    """

    lag_s: Positive = 0.25
    """Lag of both wheels behind what is asked, s."""
    drive_rad_s: Positive = 1.8
    """Natural frequency of the distance's poles, rad/s (0.81 1/s with that lag: the thesis's 0.82)."""
    turn_rad_s: Positive = 2.8
    """Natural frequency of the bearing's poles, rad/s."""
    damping: Positive = 0.9
    """Damping of either."""
    column_range: Positive = 0.5
    """Error of the column that counts as 1, as a share of the picture's width: its edge."""
    distance_range_m: Positive = 1.0
    """Error of the distance that counts as 1, m."""
    change_over: Fraction = 0.02
    """How much larger the other error has to be before it is its turn: 0 is the thesis's rule, which chatters."""
    speed_m_s: Positive = 0.5
    """Fastest drive, m/s (iRobot Create 2)."""
    turn_rate_rad_s: Positive = 2.0
    """Fastest turn, rad/s."""
    still: NonNegative = 0.01
    """With both errors below this neither is acted on."""
    coast_s: NonNegative = 1.5
    """For how long an unseen target is driven after on its last velocity over ground, s."""


@dataclass(frozen=True)
class Drive:
    """What the robot is asked for."""

    speed_m_s: float
    """Forward, m/s."""
    turn_rad_s: float
    """Clockwise seen from above, rad/s."""
    axis: Axis | None
    """Which controller acts; None: neither, and the target's own motion is all that is followed."""


class UnicycleLaw:
    """The rule of 3.5: the larger normalised error is acted on.

    The other axis goes on as the target itself moves. With the thesis's standstill there, a robot that has to turn
    again and again drives half of the time only: 0.3 m behind a bin at 0.37 m/s, instead of 0.05 m, by true boxes.

    Args:
        config: parameters.
        distance_m: set-point of the distance, the first one measured.
        half_field_rad: angle from the middle of the picture to its left or right edge, rad.
    """

    def __init__(self, config: UnicycleConfig, distance_m: float, half_field_rad: float):
        if not (math.isfinite(distance_m) and distance_m > 0.0 and 0.0 < half_field_rad < math.pi / 2):
            raise ValueError(
                f"unicycle: got distance {distance_m} m, half field {half_field_rad} rad, expected above 0, and an "
                "angle of a picture"
            )
        self._config = config
        self._distance_m = distance_m
        self._edge = math.tan(half_field_rad)
        self._turn = pd_gains(config.turn_rad_s, config.damping, config.lag_s)
        self._drive = pd_gains(config.drive_rad_s, config.damping, config.lag_s)
        self.axis: Axis | None = None
        """Which controller acts."""

    def step(
        self,
        bearing_rad: float,
        bearing_rate_rad_s: float,
        distance_m: float,
        closing_m_s: float,
        own: tuple[float, float] = (0.0, 0.0),
    ) -> Drive:
        """What to ask for.

        Args:
            bearing_rad: target to the right of the middle, rad.
            bearing_rate_rad_s: how fast that grows, rad/s.
            distance_m: to the target, m.
            closing_m_s: how fast that shrinks, m/s.
            own: the robot's own speed, m/s, and turn, rad/s, by its wheels: with them the target's own motion is fed
                forward on both axes, which the thesis's controllers lack.

        Raises:
            ValueError: an input that is not finite.
        """
        given = (bearing_rad, bearing_rate_rad_s, distance_m, closing_m_s, *own)
        if not all(map(math.isfinite, given)):
            raise ValueError(f"unicycle: got {given}, expected finite bearing, distance and rates")
        config = self._config
        # As a share of the picture's width: its edge is half of it.
        column = 0.5 * math.tan(min(max(bearing_rad, -_MOST_ASIDE_RAD), _MOST_ASIDE_RAD)) / self._edge
        aside = column / config.column_range
        away = (distance_m - self._distance_m) / config.distance_range_m
        self.axis = self._chosen(min(abs(aside), 1.0), min(abs(away), 1.0))
        turn, speed = own[1] + bearing_rate_rad_s, own[0] - closing_m_s  # the target's own
        if self.axis == "turn":
            turn = self._turn.rate(bearing_rad, bearing_rate_rad_s, turn)
        elif self.axis == "drive":
            speed = self._drive.rate(distance_m - self._distance_m, -closing_m_s, speed)
        return Drive(
            min(max(speed, -config.speed_m_s), config.speed_m_s),
            min(max(turn, -config.turn_rate_rad_s), config.turn_rate_rad_s),
            self.axis,
        )

    def _chosen(self, aside: float, away: float) -> Axis | None:
        if max(aside, away) < self._config.still:
            return None
        margin = self._config.change_over
        if self.axis == "turn":
            return "drive" if away > aside + margin else "turn"
        if self.axis == "drive":
            return "turn" if aside > away + margin else "drive"
        return "turn" if aside >= away else "drive"
