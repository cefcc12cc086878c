"""How fast people walk: a line through their places of the last second."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

import numpy as np

from common.geometry.rotation import Array

_SPAN_S = 1.2
_LEAST_SPAN_S = 0.5
_LEAST_PLACES = 4
_STANDING_M_S = 0.25
"""A slower fit is the noise of one who stands or lies: a limb that comes into view shifts the middle."""
_FASTEST_M_S = 4.0


class Walks:
    """Places of each person of late."""

    def __init__(self) -> None:
        self._places: dict[int, deque[tuple[int, Array]]] = {}

    def add(self, number: int, t_ns: int, ned_p_m: Array) -> None:
        """Note where (3,) a person was, NED, m."""
        places = self._places.setdefault(number, deque())
        places.append((t_ns, ned_p_m))
        while (t_ns - places[0][0]) / 1e9 > _SPAN_S:
            places.popleft()

    def walked(self, number: int) -> bool:
        """Whether a person walked when they were last seen."""
        places = self._places.get(number)
        return bool(places) and bool(self.ned_v_m_s(number, places[-1][0]).any())

    def keep(self, numbers: Iterable[int]) -> None:
        """Forget everybody else."""
        kept = set(numbers)
        self._places = {number: places for number, places in self._places.items() if number in kept}

    def ned_v_m_s(self, number: int, t_ns: int) -> Array:
        """Velocity over ground (3,), NED, m/s, by least squares; zero for one who stands or was not seen for long."""
        places = self._places.get(number)
        if not places or len(places) < _LEAST_PLACES or (t_ns - places[-1][0]) / 1e9 > _LEAST_SPAN_S:
            return np.zeros(3)
        seconds = np.array([(stamp_ns - places[-1][0]) / 1e9 for stamp_ns, _ in places])
        if np.ptp(seconds) < _LEAST_SPAN_S:
            return np.zeros(3)
        centred = seconds - seconds.mean()
        velocity = centred @ np.array([place for _, place in places]) / float(centred @ centred)
        velocity[2] = 0.0  # people stay on the ground; the middle of what is seen rises and falls with their limbs
        speed = float(np.linalg.norm(velocity))
        return velocity if _STANDING_M_S <= speed <= _FASTEST_M_S else np.zeros(3)
