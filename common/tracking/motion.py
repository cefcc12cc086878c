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
        self._covariance = np.zeros((4, 2, 2))  # of (value, rate), for each of the four
        self._covariance[:, 0, 0] = noise.measured**2
        self._covariance[:, 1, 1] = noise.start**2

    @property
    def rate_std(self) -> np.ndarray:
        """Standard deviation of the rates, (4,), 1/s."""
        return np.sqrt(self._covariance[:, 1, 1])

    def predict(self, dt_s: float) -> None:
        """Move on by a time, s."""
        memory = np.exp(-dt_s / self._noise.memory_s)
        self.value = self.value + self.rate * dt_s
        self.value[2] = wrap_angle(self.value[2])
        self.rate = self.rate * memory
        transition = np.zeros((4, 2, 2))
        transition[:, 0, 0], transition[:, 0, 1], transition[:, 1, 1] = 1.0, dt_s, memory
        growth = np.array([[dt_s**3 / 3, dt_s**2 / 2], [dt_s**2 / 2, dt_s]])  # white-noise acceleration
        self._covariance = transition @ self._covariance @ transition.transpose(0, 2, 1)
        self._covariance += (self._noise.walk**2)[:, None, None] * growth

    def correct(self, value: np.ndarray, confidence: float) -> None:
        """Take in the estimate of a picture, (4,); confidence in (0, 1] widens its noise."""
        variance = (self._noise.measured / confidence) ** 2
        residual = value - self.value
        residual[2] = wrap_angle(residual[2])
        gain = self._covariance[:, :, 0] / (self._covariance[:, 0, 0] + variance)[:, None]
        self.value = self.value + gain[:, 0] * residual
        self.value[2] = wrap_angle(self.value[2])
        self.rate = self.rate + gain[:, 1] * residual
        self._covariance = self._covariance - gain[:, :, None] * self._covariance[:, None, 0, :]
