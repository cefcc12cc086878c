"""How the target turns: a Kalman filter on its heading and turn rate.

A target on wheels moves where it heads, so its velocity turns as it does: the turn rate gives the sideways acceleration
before the positions show it, and it needs neither a front nor a heading that is right, only one that turns along.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from common.geometry.rotation import wrap_angle

Array = NDArray[np.float64]
_LONGEST_STEP_S = 3.5


@dataclass
class HeadingFilter:
    """Heading and turn rate; the rate fades with a memory, and wanders by the agility."""

    memory_s: float
    """Time constant with which an unseen turn ends, s."""
    agility_rad_s2: float
    """Spectral density of the angular acceleration, as a standard deviation over one second, rad/s²."""
    measurement_rad: float
    """Standard deviation of a measured heading, rad."""
    _state: Array | None = field(default=None, init=False)  # heading, rate
    _covariance: Array = field(default_factory=lambda: np.zeros((2, 2)), init=False)
    _t_ns: int = field(default=0, init=False)

    def reset(self) -> None:
        """Forget the heading."""
        self._state = None

    @property
    def known(self) -> bool:
        """Whether a heading was measured since the last reset."""
        return self._state is not None

    def update(self, heading_rad: float, t_ns: int) -> None:
        """Take in a heading that was seen at a capture time."""
        dt_s = (t_ns - self._t_ns) / 1e9
        if self._state is None or not 0.0 <= dt_s <= _LONGEST_STEP_S:
            self._state = np.array([heading_rad, 0.0])
            self._covariance = np.diag([self.measurement_rad**2, 0.3])
        else:
            self._advance(dt_s)
            variance = self.measurement_rad**2
            gain = self._covariance[:, 0] / (self._covariance[0, 0] + variance)
            self._state = self._state + gain * wrap_angle(heading_rad - self._state[0])
            shrink = np.eye(2) - np.outer(gain, [1.0, 0.0])
            self._covariance = shrink @ self._covariance @ shrink.T + variance * np.outer(gain, gain)
        self._t_ns = t_ns

    def predict(self, t_ns: int) -> tuple[float, float]:
        """Heading, rad, and turn rate, rad/s, at a later time; no turn before the first measurement."""
        if self._state is None:
            return 0.0, 0.0
        ahead_s = min(max(0.0, (t_ns - self._t_ns) / 1e9), _LONGEST_STEP_S)
        fade = math.exp(-ahead_s / self.memory_s)
        turned = self.memory_s * (1.0 - fade) * float(self._state[1])
        return wrap_angle(float(self._state[0]) + turned), fade * float(self._state[1])

    def mean_rate(self, t_ns: int) -> float:
        """Mean turn rate from the last measurement until a later time, rad/s."""
        ahead_s = (t_ns - self._t_ns) / 1e9
        if self._state is None or ahead_s <= 0.0:
            return self.predict(t_ns)[1]
        ahead_s = min(ahead_s, _LONGEST_STEP_S)
        return self.memory_s * (1.0 - math.exp(-ahead_s / self.memory_s)) * float(self._state[1]) / ahead_s

    def _advance(self, dt_s: float) -> None:
        fade = math.exp(-dt_s / self.memory_s)
        transition = np.array([[1.0, self.memory_s * (1.0 - fade)], [0.0, fade]])
        noise = self.agility_rad_s2**2 * np.array([[dt_s**3 / 3, dt_s**2 / 2], [dt_s**2 / 2, dt_s]])
        if self._state is not None:
            self._state = transition @ self._state
        self._covariance = transition @ self._covariance @ transition.T + noise
