"""Flight after a target as velocity and heading-rate requests: PD on its place in the picture and on its size.

Echeverri 2016, 4.4.2 asks the AR.Drone for tilts, from pixels. Here the picture's error is first brought to metres with
the attitude taken out (the picture's geometry), and what is asked for is a velocity, whose answer is known: the gains
follow from poles (`gains`). The target's own velocity comes on top, so that nothing is left of a steady motion.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.geometry.rotation import wrap_angle
from common.messages import Request
from onboard.follow.config import FollowConfig
from onboard.follow.gains import pd_gains

Array = NDArray[np.float64]
_LEAST_LEVEL_M = 0.3
"""Level distance below which there is no direction to face the target in, m."""
_FIRST_STEP_S, _LONGEST_STEP_S = 0.05, 0.2
"""Time that the first request has for its change of velocity, a picture's period, and the most that any has, s."""


@dataclass(frozen=True)
class Vehicle:
    """The vehicle at one instant."""

    ned_p_m: Array
    """Position (3,), NED, m."""
    ned_v_m_s: Array
    """Velocity (3,), NED, m/s."""
    yaw_rad: float
    """Heading, rad from north, clockwise."""
    yaw_rate_rad_s: float
    """Its rate, rad/s."""


@dataclass(frozen=True)
class TargetState:
    """The target at the same instant."""

    ned_p_m: Array
    """Place (3,), NED, m."""
    ned_v_m_s: Array
    """Velocity (3,), NED, m/s."""


class FollowLaw:
    """Keeps the vehicle above a target, or before it, as it was when the target was chosen.

    Args:
        config: poles and limits.
        ahead: the camera looks ahead: face the target and keep its distance; else stay above it.
    """

    def __init__(self, config: FollowConfig, ahead: bool):
        self._config = config
        self._ahead = ahead
        self._place = pd_gains(config.natural_rad_s, config.damping, config.lag_s)
        self._heading = pd_gains(config.yaw_rad_s, config.damping, config.yaw_lag_s)
        self.reset()

    def reset(self) -> None:
        """Forget set-points and the last request."""
        self.least_m = 0.0
        """Facing it: least distance that is kept, m, where it is nearer at first."""
        self._distance_m: float | None = None
        self._drop_m: float | None = None
        self._course_offset_rad: float | None = None
        self._asked: Array | None = None
        self._asked_ns = 0

    def restart(self, ned_v_m_s: Array | None = None, t_ns: int = 0) -> None:
        """The last request was not flown: the next one begins at what was, or at the vehicle's own velocity.

        Args:
            ned_v_m_s: velocity that was asked of the vehicle instead, (3,), NED, m/s; None: nobody knows.
            t_ns: when, ns.
        """
        self._asked, self._asked_ns = (None if ned_v_m_s is None else ned_v_m_s[:2].copy()), t_ns

    def ask(self, target: TargetState, vehicle: Vehicle, t_ns: int) -> Request:
        """Velocity, NED, and heading rate; the first call's distance and height difference are the set-points.

        Facing it, a first distance below `least_m` is opened to that.

        Args:
            target: where it is and how it moves.
            vehicle: at the same instant.
            t_ns: that instant, ns.

        Raises:
            ValueError: a place or velocity that is not finite.
        """
        given = np.concatenate([target.ned_p_m, target.ned_v_m_s, vehicle.ned_p_m, vehicle.ned_v_m_s])
        if not np.isfinite(given).all() or not math.isfinite(vehicle.yaw_rad + vehicle.yaw_rate_rad_s):
            raise ValueError(f"follow: got target {target} from {vehicle}, expected finite numbers")
        apart = target.ned_p_m - vehicle.ned_p_m
        opening = target.ned_v_m_s - vehicle.ned_v_m_s
        if self._distance_m is None or self._drop_m is None:
            self._distance_m, self._drop_m = max(self.least_m, float(np.hypot(*apart[:2]))), float(apart[2])
        down = 0.0
        if self._config.height == "scale":
            down = self._place.rate(float(apart[2]) - self._drop_m, float(opening[2]), float(target.ned_v_m_s[2]))
            down = min(max(down, -self._config.climb_m_s), self._config.climb_m_s)
        if self._ahead:
            level, turn = self._facing(apart, opening, target, vehicle)
        else:
            level = target.ned_v_m_s[:2] + self._place.kp_1_s * apart[:2] + self._place.kd * opening[:2]
            turn = self._with_course(target, vehicle)
        north, east = self._slewed(level, vehicle, t_ns)
        most = self._config.yaw_rate_rad_s
        return Request(frame="ned", vector=(north, east, down), yaw_rate_rad_s=min(max(turn, -most), most))

    def _facing(self, apart: Array, opening: Array, target: TargetState, vehicle: Vehicle) -> tuple[Array, float]:
        """Velocity along the line to the target (2,), m/s, and the turn that faces it, rad/s."""
        level_m = float(np.hypot(*apart[:2]))
        if level_m < _LEAST_LEVEL_M or self._distance_m is None:
            return np.zeros(2), 0.0
        towards = apart[:2] / level_m
        bearing = wrap_angle(math.atan2(apart[1], apart[0]) - vehicle.yaw_rad)
        # θ' = (r_n r_e' - r_e r_n') / r²
        swing = float(apart[0] * opening[1] - apart[1] * opening[0]) / level_m**2
        turn = self._heading.rate(bearing, swing - vehicle.yaw_rate_rad_s, swing)
        if abs(bearing) > self._config.facing_rad:
            return np.zeros(2), turn
        speed = self._place.rate(
            level_m - self._distance_m, float(opening[:2] @ towards), float(target.ned_v_m_s[:2] @ towards)
        )
        return towards * (speed * math.cos(bearing) ** 2), turn

    def _with_course(self, target: TargetState, vehicle: Vehicle) -> float:
        """Turn that keeps the angle between the target's course and the nose as it was at first, rad/s.

        Seen from above a target turns in the picture as its course does; trackers of upright boxes see that as change.
        """
        north, east = target.ned_v_m_s[:2]
        if math.hypot(north, east) < self._config.course_m_s:
            return 0.0
        off = wrap_angle(math.atan2(east, north) - vehicle.yaw_rad)
        if self._course_offset_rad is None:
            self._course_offset_rad = off
        return self._heading.kp_1_s * wrap_angle(off - self._course_offset_rad)

    def _slewed(self, level: Array, vehicle: Vehicle, t_ns: int) -> tuple[float, float]:
        """The velocity (2,) within speed and slew; the first begins at the vehicle's own."""
        config = self._config
        last = vehicle.ned_v_m_s[:2] if self._asked is None else self._asked
        dt_s = _FIRST_STEP_S if self._asked is None else min(max((t_ns - self._asked_ns) / 1e9, 0.0), _LONGEST_STEP_S)
        self._asked = last + _capped(_capped(level, config.speed_m_s) - last, config.slew_m_s2 * dt_s)
        self._asked_ns = t_ns
        return float(self._asked[0]), float(self._asked[1])


def _capped(vector: Array, length: float) -> Array:
    norm = float(np.linalg.norm(vector))
    return vector if norm <= length else vector * (length / norm)
