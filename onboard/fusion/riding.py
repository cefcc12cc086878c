"""Whether what is in a tracker's box moves as the box does, and not as the ground: then it is on a thing of its own.

Of a target that turns away to sides which nobody knows, its look says nothing. That the content of the box goes along
over the ground, and that the tracker has not let go of it, does.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from common.tracking.appearance import upright_patch
from common.tracking.base import Box, center_of, size_of

_REACH_S = 0.4
"""Greatest time between the two pictures that are compared."""
_LEAST_SHARE = 0.1
"""How far the box must have moved over the ground between them to be told from it, box sizes."""
_MEMORY_S = 0.4
"""Time constant with which the preference for the box's motion is averaged: another thing may pass before it, s."""
_RIDES = 0.1
"""Least preference, difference of correlations."""


@dataclass(frozen=True)
class _Seen:
    """A picture of late."""

    t_ns: int
    grey: np.ndarray
    place: np.ndarray
    """Where the camera has moved it, (2,), px."""
    boxes: Mapping[str, Box]


class Stretch(NamedTuple):
    """For how long a tracker has seen the target without a break, and on what."""

    since_ns: int
    """Stamp of the first picture in which it did."""
    rides: bool
    """Whether the content of its box moved with it over the ground when it last moved."""


class Riding:
    """Boxes of late, and how long each tracker has seen the target without a break."""

    def __init__(self) -> None:
        self._seen: deque[_Seen] = deque()
        self._since: dict[str, int] = {}
        self._preference: dict[str, tuple[int, float]] = {}
        """When each was looked at last, ns, and its preference."""

    def hear(self, name: str, t_ns: int, *, sees: bool) -> None:
        """A tracker has said of a picture, t_ns, whether it sees the target."""
        if sees:
            self._since.setdefault(name, t_ns)
        else:
            self.moved(name)

    def moved(self, name: str) -> None:
        """A tracker does not see the target, or was put somewhere: what it sees from now on is another stretch."""
        self._since.pop(name, None)
        self._preference.pop(name, None)

    def look(self, grey: np.ndarray, t_ns: int, place: np.ndarray, boxes: Mapping[str, Box]) -> dict[str, Stretch]:
        """Since when each tracker has followed, and whether the content of its box moves with it over the ground.

        Args:
            grey: the picture, (H, W) uint8.
            t_ns: its stamp, ns.
            place: where the camera's motion has moved the picture, (2,), px.
            boxes: of each tracker that sees the target in it, px.
        """
        now = _Seen(t_ns, grey, place.copy(), dict(boxes))
        while self._seen and t_ns - self._seen[0].t_ns > _REACH_S * 1e9:
            self._seen.popleft()
        self._seen.append(now)
        for name in boxes:
            found = self._preferred(name, now)
            if found is not None:
                before_ns, preference = self._preference.get(name, (t_ns, found))
                preference -= math.expm1(-(t_ns - before_ns) * 1e-9 / _MEMORY_S) * (found - preference)
                self._preference[name] = (t_ns, preference)
        return {n: Stretch(self._since[n], self._rides(n)) for n in boxes if n in self._since}

    def _rides(self, name: str) -> bool:
        return name in self._preference and self._preference[name][1] > _RIDES

    def _preferred(self, name: str, now: _Seen) -> float | None:
        """How much better a box's content is explained by its own motion than by the ground's, -2 to 2.

        By the newest picture since which the box has moved far enough; None where there is none.
        """
        box = now.boxes[name]
        for before in reversed(self._seen):
            if name not in before.boxes or before.t_ns < self._since.get(name, now.t_ns):
                continue
            was = before.boxes[name]
            moved = np.subtract(center_of(box), now.place) - np.subtract(center_of(was), before.place)
            if float(np.hypot(*moved)) >= _LEAST_SHARE * size_of(box):
                look = upright_patch(now.grey, box)
                ground: Box = (*(np.array(box[:2]) + before.place - now.place).tolist(), *box[2:])
                with_it, with_ground = upright_patch(before.grey, was), upright_patch(before.grey, ground)
                return float(look @ (with_it - with_ground))
        return None
