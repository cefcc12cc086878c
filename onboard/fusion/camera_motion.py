"""How far the camera's own motion moves the whole picture: told by a platform that knows, or from the pictures alone.

In the thesis a platform's commands enter as B·u. A head's servos and a robot's wheels tell what has become of these. A
gust, a jolt or an operator's hand are no commands, and are measured: the shift is the one under which two small
pictures correlate best: among all shifts of coarser ones first, then nearby (Lewis 1995, Fast normalized
cross-correlation). Phase correlation, which weighs all frequencies alike, finds nothing in pictures that are blurred or
dark. Where two pictures share nothing, there is no shift. Positions less this shift are those of a camera that holds
still: a target moves evenly there.
"""

from __future__ import annotations

from collections import OrderedDict
from functools import cached_property

import cv2
import numpy as np

from common.tracking.base import Box, Expectation, Tracker, center_of
from common.tracking.box_tracker import BoxTracker

_SIDE_PX = 120
"""Longer side of the pictures that are compared, at least."""
_ALIKE = 0.5
"""Least correlation of what two pictures share after a shift: below it they have none in common."""
_LEAST_CONTRAST = 0.5
"""Least standard deviation of a small picture, grey levels: below it there is nothing to compare."""
_COARSE = 2
"""By how much the pictures are smaller still in which all shifts are tried."""
_REACH = 0.625
"""Largest shift that is tried, of the picture's sides."""
_FLAT_PX = 8.0
"""Extent of the brightness that is taken out of these, px: a shadow that lies still is no scene that does."""
_NEAR, _STEPS = 2, 3
"""How far around the best of these shifts is looked, px, and how often anew where the best one there is at the edge."""
_REMEMBERED = 64
"""Pictures whose place is remembered: answers to older ones are as late as no tracker is."""


def expectation(box: Box, shift_px: np.ndarray) -> Expectation:
    """What a tracker is told of a picture that has moved by (2,) px since the one in which its target was there."""
    (u, v), (across, down) = center_of(box), shift_px.tolist()
    return Expectation((u + across, v + down), 0.0, (across, down), 0.0, 1.0)


def tell(tracker: Tracker, expected: Expectation) -> None:
    """Let a tracker begin its search there, unless it has a motion model, for which the shift is motion like any."""
    if isinstance(tracker, BoxTracker):
        tracker.expect(expected)


class _Small:
    """A small picture, and what is needed of it twice: to compare it with the one before, and with the next one.

    Args:
        picture: (H, W) float32.
    """

    def __init__(self, picture: np.ndarray):
        self.picture = picture

    @cached_property
    def contrast(self) -> float:
        """Standard deviation, grey levels."""
        return float(self.picture.std())

    @cached_property
    def flat(self) -> np.ndarray:
        """A coarse copy without the brightness of its surroundings, (h, w) float32."""
        rows, columns = self.picture.shape
        small = cv2.resize(self.picture, (columns // _COARSE, rows // _COARSE), interpolation=cv2.INTER_AREA)
        return small - cv2.GaussianBlur(small, (0, 0), _FLAT_PX)

    @cached_property
    def energy(self) -> np.ndarray:
        """Sum of squares (rows, columns) of what of that copy each shift within reach leaves in its own frame."""
        return _energy(self.flat, *_shifts(self.flat))


class CameraMotion:
    """Sum of the shifts from picture to picture."""

    def __init__(self) -> None:
        self._before: _Small | None = None
        self._shifts: OrderedDict[int, np.ndarray] = OrderedDict()

    @property
    def last(self) -> np.ndarray:
        """Where the last picture has moved to, (2,), px."""
        return next(reversed(self._shifts.values()), np.zeros(2))

    def see(self, grey: np.ndarray, t_ns: int, moved_px: tuple[float, float] | None = None) -> np.ndarray:
        """Where this picture has moved to since the first one, (2,), px: what stands still in the world moves so.

        Args:
            grey: (H, W) uint8, of the same size as the ones before.
            t_ns: its stamp, ns, not before the last one's.
            moved_px: how far it has moved since the last one by somebody who knows; None: it is measured.
        """
        shrink = max(1, max(grey.shape) // _SIDE_PX)
        size = (grey.shape[1] // shrink, grey.shape[0] // shrink)
        small = _Small(cv2.resize(grey, size, interpolation=cv2.INTER_AREA).astype(np.float32))
        place = self.last
        if moved_px is not None:
            place = place + np.array(moved_px)
        elif self._before is not None and self._before.picture.shape == small.picture.shape:
            shift, alike = _shift(self._before, small)
            if alike >= _ALIKE:
                place = place + shift * shrink
        self._before = small
        self._shifts[t_ns] = place
        while len(self._shifts) > _REMEMBERED:
            self._shifts.popitem(last=False)
        return place

    def at(self, t_ns: int) -> np.ndarray:
        """The same for a picture of late, by its stamp, ns; for one that is not known, that of the one before it."""
        known = self._shifts.get(t_ns)
        if known is not None:
            return known
        earlier = [place for stamp, place in self._shifts.items() if stamp <= t_ns]
        return earlier[-1] if earlier else next(iter(self._shifts.values()), np.zeros(2))


def _shift(before: _Small, after: _Small) -> tuple[np.ndarray, float]:
    """How far (2,), px, the second of two pictures has moved, and their correlation under that shift."""
    if min(before.contrast, after.contrast) < _LEAST_CONTRAST:
        return np.zeros(2), 0.0
    (right, down), shift, alike = _coarse_shift(before, after), np.zeros(2), 0.0
    for _ in range(_STEPS):
        near = _alike(before.picture, after.picture, right, down)
        if near is None:
            break
        row, column = (int(i) for i in np.unravel_index(near.argmax(), near.shape))
        right, down = right + column - _NEAR, down + row - _NEAR
        if 0 < row < 2 * _NEAR and 0 < column < 2 * _NEAR:
            across = _summit(*near[row, column - 1 : column + 2].tolist())
            shift = np.array([right + across, down + _summit(*near[row - 1 : row + 2, column].tolist())])
            alike = float(near[row, column])
            break
    return shift, alike


def _summit(before: float, middle: float, after: float) -> float:
    """Where the parabola through three values is highest, from the middle one, at most half a step away."""
    bend = 2 * middle - before - after
    return 0.0 if bend <= 0.0 else min(0.5, max(-0.5, (after - before) / (2 * bend)))


def _coarse_shift(before: _Small, after: _Small) -> tuple[int, int]:
    """The shift, px, right and down, of the most significant correlation of coarse copies, among all within reach.

    Where little is shared, a high correlation is chance: it counts by the root of how many pixels are.
    """
    rows, columns = before.flat.shape
    right, down = _shifts(before.flat)
    far_right, far_down = int(right[-1]), int(down[-1])
    around = cv2.copyMakeBorder(after.flat, far_down, far_down, far_right, far_right, cv2.BORDER_CONSTANT, value=(0.0,))
    shared = cv2.matchTemplate(around, before.flat, cv2.TM_CCORR)
    energies = after.energy * before.energy[::-1, ::-1]  # what stays of the first one is shifted the other way
    pixels = (rows - np.abs(down))[:, None] * (columns - np.abs(right))
    row, column = np.unravel_index((shared * np.sqrt(pixels / (energies + 1e-3))).argmax(), shared.shape)
    return _COARSE * int(right[column]), _COARSE * int(down[row])


def _shifts(flat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All shifts within reach of a coarse copy (h, w), px: right (columns,) and down (rows,), from the least on."""
    far_down, far_right = (round(_REACH * side) for side in flat.shape)
    return np.arange(-far_right, far_right + 1), np.arange(-far_down, far_down + 1)


def _energy(picture: np.ndarray, right: np.ndarray, down: np.ndarray) -> np.ndarray:
    """Sum of squares (rows, columns) of what of a picture (H, W) lies in its own frame shifted right and down."""
    sums, (rows, columns) = cv2.integral(picture * picture), picture.shape
    first, last = np.maximum(0, right), columns + np.minimum(0, right)
    upper, lower = np.maximum(0, down)[:, None], rows + np.minimum(0, down)[:, None]
    return sums[lower, last] - sums[upper, last] - sums[lower, first] + sums[upper, first]


def _alike(before: np.ndarray, after: np.ndarray, right: int, down: int) -> np.ndarray | None:
    """Correlation, (2 n + 1, 2 n + 1), under a shift and those up to n px below and above; None of too little shared.

    All compare the same part of the first picture: what of it every one of these shifts leaves in the second.
    """
    rows, columns = before.shape
    x0, x1 = max(0, -right) + _NEAR, columns - max(0, right) - _NEAR
    y0, y1 = max(0, -down) + _NEAR, rows - max(0, down) - _NEAR
    if x1 - x0 < _NEAR or y1 - y0 < _NEAR:
        return None
    around = after[y0 + down - _NEAR : y1 + down + _NEAR, x0 + right - _NEAR : x1 + right + _NEAR]
    return cv2.matchTemplate(around, before[y0:y1, x0:x1], cv2.TM_CCOEFF_NORMED)
