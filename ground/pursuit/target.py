"""Velocity of the target: a Kalman filter with constant velocity on its position in the NED plane."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_LONGEST_STEP_S = 2.0


@dataclass(frozen=True)
class TargetEstimate:
    """Where the target is and how it moves, at one time."""

    position_m: Array
    """North and east, m, shape (2,)."""
    velocity_m_s: Array
    """North and east, m/s, shape (2,)."""


@dataclass
class TargetFilter:
    """Nearly-constant-velocity Kalman filter; north and east are independent and share one covariance.

    The process noise is white acceleration (Bar-Shalom, Li, Kirubarajan 2001, section 6.2.2), with the real time
    between pictures.
    """

    process_m_s2: float
    """Spectral density of the acceleration, as a standard deviation over one second, m/s²."""
    measurement_m: float
    """Standard deviation of a measured position, m."""
    _state: Array | None = field(default=None, init=False)  # (2, 2): rows position and velocity, columns north and east
    _covariance: Array = field(default_factory=lambda: np.zeros((2, 2)), init=False)
    _t_ns: int = field(default=0, init=False)

    def reset(self) -> None:
        """Forget the target."""
        self._state = None

    def update(self, position_m: Array, t_ns: int) -> TargetEstimate:
        """Estimate after a measured position (2,), m, NED plane, at a capture time, ns."""
        dt_s = (t_ns - self._t_ns) / 1e9
        if self._state is None or not 0.0 <= dt_s <= _LONGEST_STEP_S:
            self._state = np.vstack((position_m, np.zeros(2)))
            self._covariance = np.diag([self.measurement_m**2, 1.0])
        else:
            self._predict(dt_s)
            self._correct(position_m)
        self._t_ns = t_ns
        return TargetEstimate(self._state[0].copy(), self._state[1].copy())

    def predict(self, t_ns: int) -> TargetEstimate | None:
        """Estimate at a later time, at most 2 s on, without a measurement; None before the first one."""
        if self._state is None:
            return None
        ahead_s = min(max(0.0, (t_ns - self._t_ns) / 1e9), _LONGEST_STEP_S)
        return TargetEstimate(self._state[0] + ahead_s * self._state[1], self._state[1].copy())

    def _predict(self, dt_s: float) -> None:
        transition = np.array([[1.0, dt_s], [0.0, 1.0]])
        noise = self.process_m_s2**2 * np.array([[dt_s**3 / 3, dt_s**2 / 2], [dt_s**2 / 2, dt_s]])
        self._state = transition @ self._state
        self._covariance = transition @ self._covariance @ transition.T + noise

    def _correct(self, position_m: Array) -> None:
        if self._state is None:
            return
        gain = self._covariance[:, 0] / (self._covariance[0, 0] + self.measurement_m**2)
        self._state = self._state + np.outer(gain, position_m - self._state[0])
        shrink = np.eye(2) - np.outer(gain, [1.0, 0.0])
        # Joseph's form keeps the covariance symmetric and positive.
        self._covariance = shrink @ self._covariance @ shrink.T + self.measurement_m**2 * np.outer(gain, gain)
