"""The random-acceleration model in real time, and a Kalman filter on it (Echeverri 2016, eqs 3.1 to 3.10, 4.1)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from filterpy.kalman import KalmanFilter


@lru_cache(maxsize=64)
def transition(size: int, dt_s: float) -> np.ndarray:
    """Transition A, (2N, 2N), of N values above their N rates over a time (eq. 4.1, where it is one frame)."""
    matrix = np.eye(2 * size) + dt_s * np.eye(2 * size, k=size)
    matrix.flags.writeable = False
    return matrix


@lru_cache(maxsize=64)
def _noise_pattern(size: int, dt_s: float) -> np.ndarray:
    """What white acceleration of density one adds to the covariance over a time, (2N, 2N)."""
    pattern = np.zeros((2 * size, 2 * size))
    each = np.arange(size)
    pattern[each, each] = dt_s**3 / 3
    pattern[each, each + size] = pattern[each + size, each] = dt_s**2 / 2
    pattern[each + size, each + size] = dt_s
    pattern.flags.writeable = False
    return pattern


def process_noise(density: np.ndarray, dt_s: float) -> np.ndarray:
    """Covariance R_ww, (2N, 2N), that white acceleration of a spectral density (N,), units²/s³, adds over a time.

    It is that of the continuous model, so two short steps add what one long step adds; the thesis's diag(0, q) is its
    leading term.
    """
    return _noise_pattern(len(density), dt_s) * np.concatenate([density, density])


def control_matrix(size: int, dt_s: float) -> np.ndarray:
    """Control B, (2N, N), of a known acceleration over a time; eq. 3.3 adds k·u to the rates once a frame."""
    return np.vstack([np.eye(size) * (dt_s**2 / 2), np.eye(size) * dt_s])


class MotionFilter:
    """Kalman filter of a vector and its rates, measured directly, with stamps instead of frames.

    Args:
        value: first measurement, (N,).
        t_ns: its stamp, ns.
        noise: standard deviation of the measurement, (N,), units.
        start_rate: standard deviation of the rates at the start, (N,), units/s.
    """

    def __init__(self, value: np.ndarray, t_ns: int, noise: np.ndarray, start_rate: np.ndarray):
        self.size = len(value)
        self.t_ns = t_ns
        self._filter = KalmanFilter(dim_x=2 * self.size, dim_z=self.size)
        self._filter.x = np.concatenate([value, np.zeros(self.size)]).reshape(-1, 1)
        self._filter.P = np.diag(np.concatenate([noise, start_rate]) ** 2)
        self._filter.H = np.eye(self.size, 2 * self.size)
        self._filter.inv = _inverse  # pyright: ignore[reportAttributeAccessIssue]

    @property
    def state(self) -> np.ndarray:
        """Values and rates, (2N,)."""
        return self._filter.x[:, 0]

    @property
    def value(self) -> np.ndarray:
        """Values, (N,)."""
        return self._filter.x[: self.size, 0]

    @property
    def rate(self) -> np.ndarray:
        """Rates, (N,), units/s."""
        return self._filter.x[self.size :, 0]

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the state, (2N, 2N), symmetric."""
        return self._filter.P

    def predict(self, t_ns: int, density: np.ndarray, control: np.ndarray | None = None) -> None:
        """Go to a stamp (eqs 3.4, 3.5).

        Args:
            t_ns: not before the filter's own.
            density: spectral density of the acceleration, (N,), units²/s³.
            control: known acceleration, (N,), units/s².
        """
        dt_s = (t_ns - self.t_ns) * 1e-9
        if dt_s == 0.0:
            return
        inputs = {} if control is None else {"u": control.reshape(-1, 1), "B": control_matrix(self.size, dt_s)}
        self._filter.predict(F=transition(self.size, dt_s), Q=process_noise(density, dt_s), **inputs)
        self.t_ns = t_ns

    def innovation(self, value: np.ndarray, variance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Innovation (N,) of a measurement and the diagonal (N,) of its covariance R_ee (eqs 3.6, 3.7)."""
        return value - self.value, self._filter.P.diagonal()[: self.size] + variance

    def update(self, value: np.ndarray, variance: np.ndarray) -> None:
        """Take in a measurement (N,) with the variances (N,) of independent errors (eqs 3.6 to 3.10)."""
        noise = np.zeros((self.size, self.size))
        noise.ravel()[:: self.size + 1] = variance
        self._filter.update(value.reshape(-1, 1), R=noise)
        # Rounding alone makes the two halves differ; over hours that would grow.
        self._filter.P = (self._filter.P + self._filter.P.T) / 2

    def move(self, value: np.ndarray) -> None:
        """Put the values at (N,), after a jump that no model foresees; rates and covariance are kept."""
        self._filter.x[: self.size, 0] = value

    def ahead(self, t_ns: int, density: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values (N,) predicted for a stamp, and the variance (N,) that the time until then adds; nothing changes."""
        dt_s = max(0.0, (t_ns - self.t_ns) * 1e-9)
        if dt_s == 0.0:
            return self.value, np.zeros(self.size)
        variance = dt_s**2 * self._filter.P.diagonal()[self.size :] + density * (dt_s**3 / 3)
        return self.value + dt_s * self.rate, variance


def _inverse(diagonal: np.ndarray) -> np.ndarray:
    """Inverse (N, N) of R_ee, which is diagonal: the components share neither noise nor motion."""
    inverse = np.zeros(diagonal.shape)
    inverse.ravel()[:: len(diagonal) + 1] = 1.0 / diagonal.diagonal()
    return inverse
