"""Constant-velocity motion of the target's state: one small Kalman filter, and the spread that it leaves."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


def wrap_angle(angle_rad: float) -> float:
    """The same angle in [-pi, pi), rad."""
    return (angle_rad + math.pi) % (2 * math.pi) - math.pi


@dataclass(frozen=True)
class MotionNoise:
    """What the motion filter assumes; every array is (4,), in the units of the state: x, y, psi, 1/sqrt(A)."""

    start: np.ndarray
    """Standard deviation of the rates at the start, 1/s."""
    walk: np.ndarray
    """Random walk of the rates, 1/s/sqrt(s)."""
    measured: np.ndarray
    """Standard deviation of the estimate of one picture."""
    memory_s: np.ndarray
    """Time constants with which the rates return to zero, s."""


class ConstantVelocity:
    """Position and rate of x, y, psi and 1/sqrt(A), each filtered by itself from the estimates picture by picture.

    With 200 particles a rate of its own for each particle is mostly noise: the cloud is spread over eight dimensions
    and the mean rate wanders by half of its value. One filtered rate for all particles needs four dimensions, and its
    variance says how far the particles' rates may differ once there is nothing to see.

    Args:
        value: (4,) first state.
        noise: what it assumes.
    """

    def __init__(self, value: np.ndarray, noise: MotionNoise):
        self.value = value.copy()
        self.rate = np.zeros(4)
        self._noise = noise
        # Variances of value and rate, and their covariance, for each of the four: (4,).
        self._of_value, self._of_both, self._of_rate = noise.measured**2, np.zeros(4), noise.start**2

    @property
    def rate_std(self) -> np.ndarray:
        """Standard deviation of the rates, (4,), 1/s."""
        return np.sqrt(self._of_rate)

    def kept(self, dt_s: float) -> np.ndarray:
        """What is left of the rates after a time, s: factors (4,)."""
        return np.exp(-dt_s / self._noise.memory_s)

    def predict(self, dt_s: float) -> None:
        """Move on by a time, s."""
        memory, walk = self.kept(dt_s), self._noise.walk**2  # white-noise acceleration
        self.value = self.value + self.rate * dt_s
        self.value[2] = wrap_angle(self.value[2])
        self.rate = self.rate * memory
        carried = self._of_both + dt_s * self._of_rate
        self._of_value = self._of_value + dt_s * (self._of_both + carried) + walk * (dt_s**3 / 3)
        self._of_both = memory * carried + walk * (dt_s**2 / 2)
        self._of_rate = memory**2 * self._of_rate + walk * dt_s

    def correct(self, value: np.ndarray, confidence: float) -> None:
        """Take in the estimate of a picture, (4,); confidence in (0, 1] widens its noise."""
        residual = value - self.value
        residual[2] = wrap_angle(residual[2])
        total = self._of_value + (self._noise.measured / confidence) ** 2
        of_value, of_rate = self._of_value / total, self._of_both / total
        self.value = self.value + of_value * residual
        self.value[2] = wrap_angle(self.value[2])
        self.rate = self.rate + of_rate * residual
        self._of_rate = self._of_rate - of_rate * self._of_both
        self._of_both = self._of_both - of_value * self._of_both
        self._of_value = self._of_value - of_value * self._of_value
