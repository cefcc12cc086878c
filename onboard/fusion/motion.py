"""The random-acceleration model in real time, and a Kalman filter on it (Echeverri 2016, eqs 3.1 to 3.10, 4.1).

The filter is filterpy's. Its components share neither noise nor motion, so every matrix of it is diagonal in each of
its four quarters, and eqs 3.4 to 3.10 are written for the diagonals: the same numbers (a test holds both side by side)
in a third of the time, and a covariance that is symmetric by construction.
"""

from __future__ import annotations

import numpy as np
from filterpy.kalman import KalmanFilter


class ComponentFilter(KalmanFilter):
    """filterpy's filter of N values, which are measured, above their N rates, with its steps written for diagonals.

    Args:
        state: values and rates, (2N,).
        variance: of each, (2N,); they begin independent.
    """

    def __init__(self, state: np.ndarray, variance: np.ndarray):
        size = len(state) // 2
        super().__init__(dim_x=2 * size, dim_z=size)
        self.x, self.P, self.H = state.reshape(-1, 1).copy(), np.diag(variance), np.eye(size, 2 * size)
        # Views of what is not zero: they follow x and P, which are changed in place.
        self.values, self.rates = self.x[:size, 0], self.x[size:, 0]
        quarters = np.einsum("aibi->abi", self.P.reshape(2, size, 2, size))
        self.value_variance, self.rate_variance = quarters[0, 0], quarters[1, 1]
        self._shared, self._transposed = quarters[0, 1], quarters[1, 0]

    def advance(self, dt_s: float, density: np.ndarray, control: np.ndarray | None) -> None:
        """What filterpy's `predict` does with A, R_ww and B of a time, s (eqs 3.1 to 3.5).

        The noise is that of the continuous model, so two short steps add what one long step adds; the thesis's
        diag(0, q) is its leading term. Where eq. 3.3 adds k·u to the rates once a frame, here the time counts.

        Args:
            dt_s: how far, s.
            density: spectral density of the white acceleration, (N,), units²/s³.
            control: known acceleration, (N,), units/s²; None: none.
        """
        self.values += self.rates * dt_s
        if control is not None:
            self.values += control * (dt_s**2 / 2)
            self.rates += control * dt_s
        added, shared = density * dt_s, self.rate_variance * dt_s
        self.value_variance += (self._shared * 2.0 + shared + added * (dt_s / 3)) * dt_s
        self._shared += shared + added * (dt_s / 2)
        self._transposed[:] = self._shared
        self.rate_variance += added

    def measure(self, value: np.ndarray, variance: np.ndarray) -> None:
        """What filterpy's `update` does with a value, (N,), and a diagonal R, (N,) (eqs 3.6 to 3.10)."""
        residual, total = value - self.values, self.value_variance + variance  # e, R_ee
        kept, rate_gain = variance / total, self._shared / total
        self.values += (self.value_variance / total) * residual
        self.rates += rate_gain * residual
        self.rate_variance -= rate_gain * self._shared
        self.value_variance *= kept
        self._shared *= kept
        self._transposed[:] = self._shared


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
        state = np.concatenate([value, np.zeros(self.size)])
        self._filter = ComponentFilter(state, np.concatenate([noise, start_rate]) ** 2)

    @property
    def state(self) -> np.ndarray:
        """Values and rates, (2N,): a view, which follows the filter."""
        return self._filter.x[:, 0]

    @property
    def value(self) -> np.ndarray:
        """Values, (N,): a view, which follows the filter."""
        return self._filter.values

    @property
    def rate(self) -> np.ndarray:
        """Rates, (N,), units/s: a view, which follows the filter."""
        return self._filter.rates

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the state, (2N, 2N), symmetric: a view, which follows the filter."""
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
        self._filter.advance(dt_s, density, control)
        self.t_ns = t_ns

    def innovation(self, value: np.ndarray, variance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Innovation (N,) of a measurement and the diagonal (N,) of its covariance R_ee (eqs 3.6, 3.7)."""
        return value - self._filter.values, self._filter.value_variance + variance

    def update(self, value: np.ndarray, variance: np.ndarray) -> None:
        """Take in a measurement (N,) with the variances (N,) of independent errors (eqs 3.6 to 3.10)."""
        self._filter.measure(value, variance)

    def move(self, value: np.ndarray) -> None:
        """Put the values at (N,), after a jump that no model foresees; rates and covariance are kept."""
        self._filter.values[:] = value

    def value_at(self, t_ns: int) -> np.ndarray:
        """Values (N,) predicted for a stamp; for one before the filter's own, as they are. Nothing changes."""
        return self.value + max(0.0, (t_ns - self.t_ns) * 1e-9) * self.rate

    def ahead(self, t_ns: int, density: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values (N,) predicted for a stamp, and the variance (N,) that the time until then adds; nothing changes."""
        dt_s = max(0.0, (t_ns - self.t_ns) * 1e-9)
        return self.value_at(t_ns), dt_s**2 * self._filter.rate_variance + density * (dt_s**3 / 3)
