"""Where the target must be by its motion over ground, how large it looks there, and what a depth camera says of a box.

Neither a tracker's own model nor the thesis knows a place: whatever looks like the target is the target. Who passes
before him is nearer than he can be, in whatever colours, and nobody grows by half.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.tracking.base import Box
from onboard.fusion.prior import as_foreseen
from onboard.fusion.silhouette import silhouette

Array = NDArray[np.float64]
_CORE = ((0.25, 0.75), (0.3, 0.7))
"""Part of a box that its target fills however it stands: across and down."""
_KNOWN = 0.3
"""Least share of the pixels there that have a depth for it to say anything."""
_HIS = 0.25
"""Least share of those that are as far away as the target must be."""
_MOSTLY = 0.5
"""Share of those from which a box is of one thing."""
_EMPTY = 0.9
"""Share of the pixels there that must show what is behind for nobody to be there."""
_NEARER_M = 0.5
"""How much nearer or farther than foreseen a target that is seen may be, m: less than what passes before it."""
_OF_HIS_SIZE = 0.3
"""By how much a box may differ from the target's size in metres to be of it wherever it is, logarithm."""
_ROOM, _AWAY_M = 0.8, 0.3
"""How much the picture must show beside the place of a target that may have got so far since it was seen, target sizes
and m, for one that is seen elsewhere to be it."""
_GROWN = 0.15
"""How much larger or smaller than foreseen a target that is seen may look, logarithm."""


@dataclass(frozen=True)
class Foreseen:
    """What is known of the target's place in a picture before anybody has looked."""

    box: Box
    """Where the picture should show it, px."""
    distance_m: float = math.nan
    """How far away, along the optical axis, m; NaN: unknown, and so is how large it can look."""
    reach_m: float = 0.0
    """How far it can have got from there since it was seen, m."""
    depth_m: Array | None = None
    """Depth picture that belongs to it, (h, w), m, 0 for none, at any size; None without a depth camera."""
    shape: tuple[int, int] = (0, 0)
    """Rows and columns of the picture that the boxes are of."""
    measured: bool = False
    """Whether the depth camera measured the target's own distance when it was seen last."""
    covered_m: float = math.nan
    """How far away what has covered the target since it was seen last is now, m; NaN: nothing has."""
    moved_px: tuple[float, float] | None = None
    """How far what stands still there has moved in the picture since the last one, by the platform's own motion, px;
    None: the platform does not know."""
    reach_px: float = 0.0
    """How far from there the middle of what is no part of the surroundings can be for it to be the target, px."""
    apart: NDArray[np.int8] | None = None
    """What in it is no part of the surroundings: 1, what is: -1, what is unknown: 0, (h, w), at any size; None where
    nobody knows them."""
    others: NDArray[np.bool_] | None = None
    """Which depths are of who is known to be somebody else, (h, w); None: of nobody."""
    around: NDArray[np.bool_] | None = None
    """Which depths are of floor and walls, (h, w); None where nobody can tell."""
    solid: Box | None = None
    """Where the depth camera shows a thing of its size at its place, px, whatever its look; None: it does not."""

    @property
    def outside(self) -> bool:
        """Whether the picture does not show where he can be: who is seen then may be his like, and he beside it."""
        u, size = self.box[0] + self.box[2] / 2, math.sqrt(self.box[2] * self.box[3])
        room = _ROOM * size if self.reach_m > _AWAY_M else 0.0
        return self.shape[1] > 0 and not room <= u < self.shape[1] - room

    @property
    def before_m(self) -> float:
        """How far away what covers the target is, in this picture or since it was seen last, m; NaN: nothing does.

        What is nearer than the target can have come, is known to be somebody else, or as far as what covered it before:
        what else is nearer than it was is the target itself, come nearer behind that.
        """
        core = None if self.depth_m is None else core_of(self.depth_m, self.box, self.shape)
        if core is None or not core.size:
            return self.covered_m
        nearer = (core > 0.0) & (core < self.distance_m - _NEARER_M)
        covers = core < self.distance_m - _NEARER_M - self.reach_m
        covers |= self._marked(self.others, self.box, core) | (np.abs(core - self.covered_m) < _NEARER_M / 2)
        covers &= nearer
        return float(np.median(core[covers])) if np.count_nonzero(covers) > core.size / 2 else self.covered_m

    @property
    def covered_by_others(self) -> float:
        """Share of the middle of his place that shows somebody else."""
        if self.others is None:
            return 0.0
        part = self.others[window_of(self.others.shape, self.box, self.shape)]
        return float(np.mean(part)) if part.size else 0.0

    @property
    def empty(self) -> bool:
        """Whether the depth camera shows that nobody is there: what is behind it, and nothing like the target."""
        if self.depth_m is None or self.solid is not None or self.outside or not math.isfinite(self.distance_m):
            return False
        core = core_of(self.depth_m, self.box, self.shape)
        behind_m = self.distance_m + self.reach_m + _NEARER_M
        if core is None:
            return False
        behind = core > behind_m
        if self._in_range(behind_m):
            behind |= core == 0.0
        return float(np.mean(behind)) > _EMPTY

    def whole(self, shape: tuple[int, ...]) -> Box | None:
        """Box of the one thing there that is no part of the surroundings, px of a picture of this shape; None: none."""
        return None if self.apart is None else silhouette(self.apart, self.box, self.reach_px, shape)

    def excluded(self, boxes: Mapping[str, Box]) -> frozenset[str]:
        """Trackers in whose box everything is nearer or farther than the target can be, or is what stands before it.

        Where the camera measures nothing, what is there is beyond its range, or as dark as the target may be, too.
        While the picture does not show where the target can be, those that are not at its place.
        """
        away = frozenset(name for name, box in boxes.items() if self.outside and not as_foreseen(box, self.box))
        if self.depth_m is None or not math.isfinite(self.distance_m):
            return away
        before_m = self.before_m
        return away | {name for name, box in boxes.items() if self._at_another(self.depth_m, box, before_m)}

    def of_his_size(self, boxes: Mapping[str, Box]) -> frozenset[str]:
        """Trackers whose box is as large as the target, at the distance that is measured there, and not what covers it.

        Where that is another distance than foreseen, one of the two is wrong.
        """
        if self.depth_m is None or not self.distance_m > 0.0 or self.outside:
            return frozenset()
        before_m, names = self.before_m, set()
        for name, box in boxes.items():
            core = core_of(self.depth_m, box, self.shape)
            known = np.zeros(0) if core is None else core[core > 0.0]
            if core is None or len(known) < _KNOWN * core.size or self._not_his(box, core, before_m) > _MOSTLY:
                continue
            if float(np.mean(self._marked(self.around, box, core))) > _MOSTLY:
                continue
            if self._fits(box, float(np.median(known))):
                names.add(name)
        return frozenset(names)

    def _fits(self, box: Box, distance_m: float) -> bool:
        """Whether a box is as large in metres as the target, at a distance, m."""
        larger = 0.5 * math.log(box[2] * box[3] / (self.box[2] * self.box[3]))
        return abs(larger + math.log(distance_m / self.distance_m)) < _OF_HIS_SIZE

    def confirmed(self, boxes: Mapping[str, Box]) -> frozenset[str]:
        """Trackers whose box is where, as large and as far as the target is foreseen; none where it is not measured."""
        if self.depth_m is None or not math.isfinite(self.distance_m):
            return frozenset()
        before_m, depth_m = self.before_m, self.depth_m
        return frozenset(
            name
            for name, box in boxes.items()
            if as_foreseen(box, self.box) and self._share(box, core_of(depth_m, box, self.shape), before_m) > _MOSTLY
        )

    def grown(self, box: Box) -> float:
        """By how much a box is larger (below 0: smaller) than the target can look, logarithm; 0 where it is not."""
        if not self.distance_m > 0.0:
            return 0.0
        larger = 0.5 * math.log(box[2] * box[3] / (self.box[2] * self.box[3]))
        slack = _GROWN + math.log1p(self.reach_m / self.distance_m)
        return math.copysign(max(0.0, abs(larger) - slack), larger)

    def fitted(self, box: Box) -> Box:
        """The box about its middle, no larger and no smaller than the target can look, px."""
        shrink = math.exp(-self.grown(box))
        width, height = box[2] * shrink, box[3] * shrink
        return box[0] + (box[2] - width) / 2, box[1] + (box[3] - height) / 2, width, height

    def _at_another(self, depth_m: Array, box: Box, before_m: float) -> bool:
        core = core_of(depth_m, box, self.shape)
        known = np.zeros(0) if core is None else core[core > 0.0]
        if core is None:
            return False
        if len(known) < _KNOWN * core.size:
            return self._in_range(self.distance_m + self.reach_m + _NEARER_M)
        if self._not_his(box, core, before_m) > _MOSTLY:
            return True
        return self._share(box, core, before_m) < _HIS

    def _in_range(self, distance_m: float) -> bool:
        """Whether the camera would measure the target up to a distance, m: what it does not measure is farther."""
        return self.measured and self.depth_m is not None and distance_m < float(self.depth_m.max())

    def _share(self, box: Box, core: Array | None, before_m: float) -> float:
        """Share of the measured pixels in the middle of a box that are as far as the target can be.

        0 of too few, and where the box is not as large as the target at the distance that they show: what is behind him
        is soon within his reach, too.
        """
        known = np.zeros(0) if core is None else core[core > 0.0]
        if core is None or len(known) < _KNOWN * core.size:
            return 0.0
        not_his = self._marked(self.others, box, core) | self._marked(self.around, box, core)
        his = core[self._as_far(core, before_m) & ~not_his]
        at_m = float(np.median(his)) if len(his) else self.distance_m
        if abs(at_m - self.distance_m) > _NEARER_M and not self._fits(box, at_m):
            return 0.0
        return len(his) / len(known)

    def _not_his(self, box: Box, core: Array, before_m: float) -> float:
        """Share of the measured pixels in the middle of a box that are of what covers him, or of somebody else."""
        not_his = self._of_cover(core, before_m) | self._marked(self.others, box, core)
        return float(np.mean(not_his[core > 0.0]))

    def _marked(self, mask: NDArray[np.bool_] | None, box: Box, core: Array) -> NDArray[np.bool_]:
        """Which pixels in the middle of a box are marked in a mask of the depth picture, (h, w)."""
        if mask is None:
            return np.zeros(core.shape, bool)
        return mask[window_of(mask.shape, box, self.shape)]

    def things(self, depth_m: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Which depths, m, of any shape, are as far as the target can be, and which are of what covers it."""
        before_m = self.before_m
        return self._as_far(depth_m, before_m), self._of_cover(depth_m, before_m)

    def _as_far(self, depth_m: Array, before_m: float) -> NDArray[np.bool_]:
        near = np.abs(depth_m - self.distance_m) < _NEARER_M + self.reach_m
        return near & (depth_m > 0.0) & ~self._of_cover(depth_m, before_m)

    def _of_cover(self, known: Array, before_m: float) -> NDArray[np.bool_]:
        """Which depths are of what covers the target: nobody is asked to be as far as that."""
        return np.abs(known - before_m) < _NEARER_M / 2 if math.isfinite(before_m) else np.zeros(known.shape, bool)


def core_of(
    depth_m: Array, box: Box, shape: tuple[int, int], about_m: float = math.nan, reach_m: float = 0.0
) -> Array | None:
    """Depth in the middle of a box, (h, w), m, 0 for none; None where that is outside the picture.

    Args:
        depth_m: depth picture, (h, w), m, 0 for none, of the same view at any size.
        box: in the picture, px.
        shape: rows and columns of that picture.
        about_m: how far away the target must be, m: what is nearer or farther is no depth of it; NaN: unknown.
        reach_m: how far it can have got from there, m.
    """
    core = depth_m[window_of(depth_m.shape, box, shape)]
    if not core.size:
        return None
    return np.where(np.abs(core - about_m) < _NEARER_M + reach_m, core, 0.0) if math.isfinite(about_m) else core


def window_of(picture: tuple[int, ...], box: Box, shape: tuple[int, int]) -> tuple[slice, slice]:
    """Rows and columns of a depth picture, of a shape, in the middle of a box in a picture of another shape, px."""
    columns, rows = (
        slice(*_within(box[axis], box[axis + 2], _CORE[axis], picture[1 - axis] / shape[1 - axis])) for axis in (0, 1)
    )
    return rows, columns


def _within(corner: float, side: float, shares: tuple[float, float], scale: float) -> tuple[int, int]:
    """First pixel and the one after the last of a part of a box's side, in a picture of another scale."""
    first, last = (max(0, int((corner + side * share) * scale)) for share in shares)
    return first, last + 1 if corner + side * shares[1] > 0.0 else first
