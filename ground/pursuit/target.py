"""Velocity of the target: a Kalman filter on its position, with a velocity that turns as the target does."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_LONGEST_STEP_S = 3.5


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

    def update(self, position_m: Array, t_ns: int, turn_rad_s: float = 0.0) -> TargetEstimate:
        """Estimate after a measured position (2,), m, NED plane, at a capture time, ns, of a target that turns."""
        dt_s = (t_ns - self._t_ns) / 1e9
        if self._state is None or not 0.0 <= dt_s <= _LONGEST_STEP_S:
            self._state = np.vstack((position_m, np.zeros(2)))
            self._covariance = np.diag([self.measurement_m**2, 1.0])
        else:
            self._predict(dt_s, turn_rad_s)
            self._correct(position_m)
        self._t_ns = t_ns
        return TargetEstimate(self._state[0].copy(), self._state[1].copy())

    def predict(self, t_ns: int, turn_rad_s: float = 0.0) -> TargetEstimate | None:
        """Estimate at a later time, at most 3.5 s on, without a measurement; None before the first one.

        Args:
            t_ns: that time, ns.
            turn_rad_s: mean rate at which the target turns until then, clockwise, rad/s.
        """
        if self._state is None:
            return None
        ahead_s = min(max(0.0, (t_ns - self._t_ns) / 1e9), _LONGEST_STEP_S)
        chord, turned = _arc(self._state[1], ahead_s, turn_rad_s)
        return TargetEstimate(self._state[0] + chord, turned)

    def carry(self, t_ns: int, turn_rad_s: float) -> None:
        """Move the estimate on to a later time, ns, without a measurement, turning at a rate, clockwise, rad/s."""
        if self._state is not None and t_ns > self._t_ns:
            self._predict((t_ns - self._t_ns) / 1e9, turn_rad_s)
            self._t_ns = t_ns

    def _predict(self, dt_s: float, turn_rad_s: float) -> None:
        transition = np.array([[1.0, dt_s], [0.0, 1.0]])
        noise = self.process_m_s2**2 * np.array([[dt_s**3 / 3, dt_s**2 / 2], [dt_s**2 / 2, dt_s]])
        if self._state is not None:
            chord, turned = _arc(self._state[1], dt_s, turn_rad_s)
            self._state = np.vstack((self._state[0] + chord, turned))
        self._covariance = transition @ self._covariance @ transition.T + noise

    def _correct(self, position_m: Array) -> None:
        if self._state is None:
            return
        gain = self._covariance[:, 0] / (self._covariance[0, 0] + self.measurement_m**2)
        self._state = self._state + np.outer(gain, position_m - self._state[0])
        shrink = np.eye(2) - np.outer(gain, [1.0, 0.0])
        # Joseph's form keeps the covariance symmetric and positive.
        self._covariance = shrink @ self._covariance @ shrink.T + self.measurement_m**2 * np.outer(gain, gain)


def _arc(velocity_m_s: Array, t_s: float, turn_rad_s: float) -> tuple[Array, Array]:
    """Way along an arc (2,), m, and the velocity at its end (2,), m/s."""
    angle_rad = turn_rad_s * t_s
    chord = t_s * np.sinc(angle_rad / (2.0 * np.pi)) * turned_by(velocity_m_s, angle_rad / 2.0)
    return chord, turned_by(velocity_m_s, angle_rad)


def turned_by(vector: Array, angle_rad: float) -> Array:
    """A vector (2,), north and east, turned clockwise."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])
