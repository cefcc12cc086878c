"""The target as a depth camera shows it: what stands free of the floor at its distance, whatever it looks like.

Beyond the thesis, whose time-of-flight sensor gives a distance alone. Trackers know the target by its look; who leans,
or turns a side that nobody has seen, is still as large as before, where he was expected and as far away.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from common.tracking.base import Box
from onboard.follow.things import DepthView, Mask, Thing
from onboard.fusion.foreseen import Foreseen

Array = NDArray[np.float64]
_DEEP_M = 0.6
"""Greatest depth of a thing, m, between its nearest and its farthest tenth: floor and walls go on."""
_COVERS = 0.2
"""Share of a thing that is as near as what covers the target from which it is that: the side of a screen is deeper."""
_LEAST_SHARE = 0.2
"""Least area of a thing over that of the foreseen box, were he as far away as he can be."""
_TALLER, _LARGER = 0.35, 0.25
"""By how much its height and the root of its area may differ from the target's, logarithm: who leans is as large."""
_CLEARER_M = 0.4
"""How much nearer to the foreseen place than any other one it must be, m."""
_MEMORY_S, _KNOWN_S = 1.0, 0.5
"""Time constant with which the relation of box and thing is learned, s, and after how much of that it is known."""
_LONGEST_STEP_S = 0.1
_FREE_S = 3.0
"""For how long a target that stood free of floor and walls is believed not to be found in them, s."""


class Solid:
    """Finds the target in depth pictures, once its trackers' box has shown which part of a thing it is.

    Args:
        view: finds things in depth pictures.
    """

    def __init__(self, view: DepthView):
        self._view = view
        self._relation = np.zeros(4)
        """The box's middle against the thing's, in the thing's sides, and the thing's height, m, and area, m²,
        logarithms: boxes grow."""
        self._learned_s = 0.0
        self._t_ns = self._learned_ns = 0

    def learn(self, t_ns: int, box: Box, free: Mask, foreseen: Foreseen) -> None:
        """Note what part of a thing the target's box is, (x, y, width, height), px; nothing where it is on none.

        Args:
            t_ns: capture stamp, ns.
            box: of the target.
            free: which pixels of the depth picture stand free of the floor, (h, w).
            foreseen: how far the target is, and the depth picture.
        """
        step_s = min(max(t_ns - self._t_ns, 0) * 1e-9, _LONGEST_STEP_S)
        self._t_ns = t_ns
        things = [thing for thing in self.things(free, replace(foreseen, box=box)) if _holds(thing.box, box)]
        if len(things) != 1:
            return
        self._learned_s += step_s
        self._learned_ns = t_ns
        share = max(-math.expm1(-step_s / _MEMORY_S), step_s / self._learned_s)
        self._relation += share * (self._relation_of(box, things[0]) - self._relation)

    def find(self, free: Mask, foreseen: Foreseen, reach_m: float) -> Box | None:
        """The target's box by the thing at its place; None where there is none, more than one, or nothing is known yet.

        It is as large as foreseen, for the thing's distance: the box around who leans is no box of any tracker.

        Args:
            free: which pixels of the depth picture stand free of the floor, (h, w).
            foreseen: where the target is expected, how far, and the depth picture.
            reach_m: how far aside of that it may be, m.
        """
        if self._learned_s < _KNOWN_S or foreseen.outside:
            return None
        like = [thing for thing in self.things(free, foreseen) if self._is_like(thing)]
        if not like:
            return None
        like.sort(key=lambda thing: self._off_m(thing, foreseen))
        off_m = [self._off_m(thing, foreseen) for thing in like]
        clear = len(like) == 1 or off_m[1] - off_m[0] > _CLEARER_M
        if not clear or off_m[0] > reach_m:
            return None
        return _applied(self._relation, like[0].box, _at(foreseen, like[0].distance_m))

    def things(self, free: Mask, foreseen: Foreseen) -> list[Thing]:
        """What stands free of the floor at the target's distance, near its place."""
        depth_m = foreseen.depth_m
        if depth_m is None or not math.isfinite(foreseen.distance_m):
            return []
        window = self._window(depth_m.shape, foreseen)
        if not depth_m[window].size:
            return []
        as_far, of_cover = foreseen.things(depth_m)
        near = np.zeros(depth_m.shape, bool)
        near[window] = (free & (as_far | of_cover))[window]
        if foreseen.others is not None:
            near &= ~foreseen.others
        farther = 1.0 + foreseen.reach_m / foreseen.distance_m
        least_px = _LEAST_SHARE * foreseen.box[2] * foreseen.box[3] / farther**2
        return [
            thing
            for thing in self._view.things(depth_m, near, least_px)
            if thing.share(of_cover) <= _COVERS and thing.farthest_m - thing.nearest_m <= _DEEP_M
        ]

    def stands_free(self, t_ns: int) -> bool:
        """Whether the target has stood free of floor and walls of late: then the floor is where it is thought to be."""
        return self._learned_s >= _KNOWN_S and t_ns - self._learned_ns < _FREE_S * 1e9

    def _window(self, shape: tuple[int, ...], foreseen: Foreseen) -> tuple[slice, slice]:
        """Rows and columns of the depth picture in which the target can be, and its like beside it."""
        x, y, width, height = foreseen.box
        scale = shape[1] / self._view.camera.width
        around = height / 2 + self._view.camera.fx_px * (foreseen.reach_m + 1.0) / foreseen.distance_m
        left, right = ((x + width / 2 - around) * scale, (x + width / 2 + around) * scale)
        top, bottom = ((y - height / 2) * scale, (y + 1.5 * height) * scale)
        return slice(max(0, int(top)), max(0, int(bottom))), slice(max(0, int(left)), max(0, int(right)))

    def _is_like(self, thing: Thing) -> bool:
        """Whether it is as tall and as large as the thing is that the target is a part of."""
        taller, larger = (self._size_of(thing) - self._relation[2:]).tolist()
        return abs(taller) <= _TALLER and abs(larger) / 2 <= _LARGER

    def _size_of(self, thing: Thing) -> Array:
        """Height, m, and area, m², (2,), logarithms."""
        m = thing.distance_m / self._view.camera.fx_px
        return np.array([math.log(thing.box[3] * m), math.log(thing.area * m**2)])

    def _relation_of(self, box: Box, thing: Thing) -> Array:
        (x, y, width, height), (left, top, across, tall) = box, thing.box
        off = (x + width / 2 - left - across / 2) / across, (y + height / 2 - top - tall / 2) / tall
        return np.array([*off, *self._size_of(thing)])

    def _off_m(self, thing: Thing, foreseen: Foreseen) -> float:
        """How far aside a thing stands of where the target is foreseen, m."""
        off_px = thing.foot - foreseen.box[0] - foreseen.box[2] / 2
        return abs(off_px) * foreseen.distance_m / self._view.camera.fx_px


def _at(foreseen: Foreseen, distance_m: float) -> tuple[float, float]:
    """Width and height that the target shows at a distance, m, px."""
    nearer = foreseen.distance_m / distance_m
    return foreseen.box[2] * nearer, foreseen.box[3] * nearer


def _applied(relation: Array, thing: Box, size: tuple[float, float]) -> Box:
    (left, top, across, tall), (width, height) = thing, size
    right, down = relation[:2].tolist()
    return left + across / 2 + right * across - width / 2, top + tall / 2 + down * tall - height / 2, width, height


def _holds(thing: Box, box: Box) -> bool:
    """Whether a thing's middle column runs through a box, and the box's middle is on the thing."""
    u, v = box[0] + box[2] / 2, box[1] + box[3] / 2
    left, top, across, tall = thing
    return abs(left + across / 2 - u) < box[2] / 2 and left < u < left + across and top < v < top + tall
