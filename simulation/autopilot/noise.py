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
