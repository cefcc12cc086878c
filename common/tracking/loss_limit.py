"""Up to which distance a target counts as seen (Teulière 2011, section II-D), and how sure a picture is of it.

d_lim = 1.3 d_min, d_min being the smallest distance of a healthy picture: the median of the first ones, and then what
it becomes, slowly, while the target is seen.
"""

from __future__ import annotations

import math

import numpy as np

from common.tracking.config import ParticleFilterConfig

_FOUND_FACTOR, _RELIT_FACTOR = 1.3, 1.1
"""Largest distance of what a search finds, over that of a healthy picture, in the light in force and under another."""
_FOUND_FLOOR = 0.4
"""Lower bound of that: noise, sampling and a turn reach 0.3 on a target in full view."""
_LEAST_CONFIDENCE = 0.05


class LossLimit:
    """d_lim and what follows from it; distances are 0 to 1 (eq. 4).

    Args:
        config: factor, bounds, memory, and over how many pictures it begins.
    """

    def __init__(self, config: ParticleFilterConfig):
        self._config = config
        self._first: list[float] = []
        self._healthy = config.limit_ceiling / config.limit_factor

    @property
    def value(self) -> float:
        """d_lim, within its bounds."""
        limit = self._config.limit_factor * self._healthy
        return min(max(limit, self._config.limit_floor), self._config.limit_ceiling)

    def begin(self, smallest: float) -> None:
        """Take the smallest distance of a picture, seen or not, while it is one of the first."""
        if len(self._first) < self._config.limit_frames:
            self._first.append(smallest)
            self._healthy = float(np.median(self._first))

    def follow(self, smallest: float, dt_s: float) -> None:
        """Take the smallest distance of a picture with the target, a time after the last one, s."""
        self._healthy += (1 - math.exp(-dt_s / self._config.limit_memory_s)) * (smallest - self._healthy)

    def confidence(self, smallest: float) -> float:
        """How far a picture with a smallest distance is to be believed, 0.05 to 1.

        While an occluder slides over the target the rectangle clings to the visible rest: the velocity must not learn
        from that, so the closer to the limit, the less it does.
        """
        margin = max(self.value - self._healthy, 1e-6)
        return min(1.0, max(_LEAST_CONFIDENCE, 1.0 - (smallest - self._healthy) / margin))

    def of_found(self, relit: bool) -> float:
        """Largest distance of a place that a search may start on: the best of so many has to look as it used to.

        Args:
            relit: whether it was searched under another light than the one in force.
        """
        factor = _RELIT_FACTOR if relit else _FOUND_FACTOR
        return min(self.value, max(_FOUND_FLOOR, factor * self._healthy))
