"""The pan-tilt head: one PID for each axis keeps the target in the middle of the picture (Echeverri 2016, 4.4.1)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from common.config import ConfigError, NonNegative, Positive, Section
from onboard.follow.gains import PidGains, pid_gains

_LONGEST_STEP_S = 0.2
"""Longest time that one step turns for, s: after a gap the servos do not jump."""


class PanTiltConfig(Section, frozen=True, kw_only=True):
    """Poles of the loop and what the servos can do.

    The thesis's gains (35, 3.4, 8) are in steps of its servos. Here the servo is a lag behind a commanded position,
    whose rate the PID asks for; its poles are chosen well below the inverse of the pictures' delay.
    """

    natural_rad_s: Positive = 6.0
    """Natural frequency of the wanted poles, rad/s."""
    damping: Positive = 0.9
    """Their damping."""
    slow_1_s: Positive = 1.0
    """Pole of the integral, 1/s."""
    lag_s: Positive = 0.06
    """Lag of the servo behind the commanded position, s."""
    rate_rad_s: Positive = 2.0
    """Fastest turn that is asked for, rad/s."""
    pan_limit_rad: Positive = 2.6
    """Furthest pan to either side, rad."""
    tilt_limit_rad: Positive = 0.9
    """Furthest tilt up or down, rad."""
    rate_memory_s: Positive = 0.05
    """Time constant of the error's differentiation, s."""
    coast_s: NonNegative = 1.5
    """For how long an unseen target is turned after on its last rate, s."""
    unseen_memory_s: Positive = 0.7
    """Time constant with which that rate is believed ever less, s."""

    def check(self) -> None:
        """Raise ConfigError when a limit is no angle of a head."""
        if self.pan_limit_rad > math.pi or self.tilt_limit_rad > math.pi / 2:
            raise ConfigError(
                f"pan_limit_rad, tilt_limit_rad: got {self.pan_limit_rad} and {self.tilt_limit_rad}, expected at most "
                "pi and pi/2"
            )


@dataclass
class Pid:
    """One axis: rate asked for from an error, with its integral held while the rate or the axis is at its limit."""

    gains: PidGains
    """Gains."""
    rate_rad_s: float
    """Largest rate, rad/s."""
    memory_s: float
    """Time constant of the differentiation, s."""
    integral: float = 0.0
    """Integrated error, rad s."""
    _error_rad: float | None = None
    _error_rate: float = 0.0

    def ask(self, error_rad: float, dt_s: float, held: bool) -> float:
        """Rate, rad/s, for an error, rad, after a time, s.

        Args:
            error_rad: direction of the target less that of the camera.
            dt_s: time since the last call.
            held: the axis is at its end: the integral stays.
        """
        if self._error_rad is not None and dt_s > 0.0:
            share = -math.expm1(-dt_s / self.memory_s)
            self._error_rate += share * ((error_rad - self._error_rad) / dt_s - self._error_rate)
        self._error_rad = error_rad
        wound = self.integral + error_rad * dt_s
        wanted = self.gains.kp_1_s * error_rad + self.gains.ki_1_s2 * wound + self.gains.kd * self._error_rate
        limited = min(max(wanted, -self.rate_rad_s), self.rate_rad_s)
        if not held and (limited == wanted or wanted * error_rad < 0.0):
            self.integral = wound
        return limited


class PanTiltLaw:
    """Positions of both servos from the target's place in the picture.

    Args:
        config: parameters.
    """

    def __init__(self, config: PanTiltConfig):
        gains = pid_gains(config.natural_rad_s, config.damping, config.slow_1_s, config.lag_s)
        self._config = config
        self._pan = Pid(gains, config.rate_rad_s, config.rate_memory_s)
        self._tilt = Pid(gains, config.rate_rad_s, config.rate_memory_s)
        self.pan_rad = self.tilt_rad = 0.0
        """Commanded positions, rad: pan clockwise from above, tilt upwards."""

    def step(self, right_rad: float, up_rad: float, dt_s: float) -> tuple[float, float]:
        """Commanded pan and tilt, rad, for a target that is so far to the right of and above the middle, rad.

        Raises:
            ValueError: an error that is not finite, or a time that is negative.
        """
        if not (math.isfinite(right_rad) and math.isfinite(up_rad) and dt_s >= 0.0):
            raise ValueError(
                f"pan-tilt: got errors {right_rad}, {up_rad} after {dt_s} s, expected finite, and 0 or more"
            )
        dt_s = min(dt_s, _LONGEST_STEP_S)
        limits = self._config.pan_limit_rad, self._config.tilt_limit_rad
        self.pan_rad = _moved(self._pan, self.pan_rad, right_rad, dt_s, limits[0])
        self.tilt_rad = _moved(self._tilt, self.tilt_rad, up_rad, dt_s, limits[1])
        return self.pan_rad, self.tilt_rad


def _moved(pid: Pid, position_rad: float, error_rad: float, dt_s: float, limit_rad: float) -> float:
    """Where one servo is commanded to next, rad, within its limit."""
    held = abs(position_rad) >= limit_rad and position_rad * error_rad > 0.0
    return min(max(position_rad + dt_s * pid.ask(error_rad, dt_s, held), -limit_rad), limit_rad)
