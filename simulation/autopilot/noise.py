"""Coloured noise for wind and estimates."""

from __future__ import annotations

import math
import random


class GaussMarkov:
    """First-order Gauss-Markov process: zero mean, a standard deviation, an exponential correlation; one float.

    Args:
        std: standard deviation in the steady state, in the unit of the quantity.
        time_s: correlation time, s.
        dt_s: time between updates, s.
        rng: source of randomness; drawn from only when `std` is not zero.
    """

    def __init__(self, std: float, time_s: float, dt_s: float, rng: random.Random):
        self._keep = math.exp(-dt_s / time_s)
        self._kick = std * math.sqrt(1.0 - self._keep * self._keep)
        self._rng = rng
        self.value = rng.gauss(0.0, std) if std > 0.0 else 0.0
        """The present value, in the unit of `std`."""

    def update(self) -> float:
        """The value one update later."""
        if self._kick > 0.0:
            self.value = self._keep * self.value + self._rng.gauss(0.0, self._kick)
        return self.value


class Wind:
    """The air around the vehicle: a mean velocity and coloured gusts, half as strong vertically.

    Args:
        mean_ned_m_s: mean velocity of the air, NED, m/s.
        gust_std_m_s: standard deviation of the gusts along north and east, m/s.
        gust_time_s: their correlation time, s.
        dt_s: time between updates, s.
        seed: of the gusts.
    """

    def __init__(
        self,
        mean_ned_m_s: tuple[float, float, float],
        gust_std_m_s: float,
        gust_time_s: float,
        dt_s: float,
        seed: int,
    ):
        self._mean = mean_ned_m_s
        stds = (gust_std_m_s, gust_std_m_s, gust_std_m_s / 2)
        self._gusts = [
            GaussMarkov(std, gust_time_s, dt_s, random.Random(f"{seed}/gust{i}")) for i, std in enumerate(stds)
        ]

    def update(self) -> tuple[float, float, float]:
        """Velocity of the air one update later, NED, m/s."""
        n, e, d = (gust.update() for gust in self._gusts)
        return self._mean[0] + n, self._mean[1] + e, self._mean[2] + d
