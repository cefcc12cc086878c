"""How far the camera's own motion moves the whole picture, from the pictures alone.

Beyond the thesis, where a platform's commands enter as B·u: a gust, a jolt or an operator's hand are no commands. Phase
correlation (Kuglin and Hines 1975) of two small pictures tells the shift that most of them share; where they share
none, there is none. Positions less this shift are those of a camera that holds still: a target moves evenly there.
"""

from __future__ import annotations

from collections import OrderedDict

import cv2
import numpy as np

from common.tracking.base import Box, Expectation, Tracker
from common.tracking.box_tracker import BoxTracker

_SIDE_PX = 120
"""Longer side of the pictures that are compared, at least."""
_ALIKE = 0.5
"""Least correlation of what two pictures share after a shift: below it they have none in common."""
_LEAST_CONTRAST = 0.5
"""Least standard deviation of a small picture, grey levels: below it there is nothing to compare."""
_REMEMBERED = 64
"""Pictures whose place is remembered: answers to older ones are as late as no tracker is."""


def expectation(box: Box, shift_px: np.ndarray) -> Expectation:
    """What a tracker is told of a picture that has moved by (2,) px since the one in which its target was there."""
    center = (box[0] + box[2] / 2 + float(shift_px[0]), box[1] + box[3] / 2 + float(shift_px[1]))
    return Expectation(center, 0.0, (float(shift_px[0]), float(shift_px[1])), 0.0, 1.0)


def tell(tracker: Tracker, expected: Expectation) -> None:
    """Let a tracker begin its search there, unless it has a motion model, for which the shift is motion like any."""
    if isinstance(tracker, BoxTracker):
        tracker.expect(expected)


class CameraMotion:
    """Sum of the shifts from picture to picture."""

    def __init__(self) -> None:
        self._before: np.ndarray | None = None
        self._window: np.ndarray | None = None
        self._shifts: OrderedDict[int, np.ndarray] = OrderedDict()

    @property
    def last(self) -> np.ndarray:
        """Where the last picture has moved to, (2,), px."""
        return next(reversed(self._shifts.values()), np.zeros(2))

    def see(self, grey: np.ndarray, t_ns: int) -> np.ndarray:
        """Where this picture has moved to since the first one, (2,), px: what stands still in the world moves so.

        Args:
            grey: (H, W) uint8, of the same size as the ones before.
            t_ns: its stamp, ns, not before the last one's.
        """
        shrink = max(1, max(grey.shape) // _SIDE_PX)
        size = (grey.shape[1] // shrink, grey.shape[0] // shrink)
        small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA).astype(np.float32)
        place = self.last
        if self._before is not None and self._before.shape == small.shape:
            if self._window is None or self._window.shape != small.shape:
                self._window = cv2.createHanningWindow(size, cv2.CV_32F)
            # It multiplies what it is given by the window, in place.
            shift, _ = cv2.phaseCorrelate(self._before.copy(), small.copy(), self._window)
            alike = _correlation(self._before, small, round(shift[0]), round(shift[1]))
            if alike >= max(_ALIKE, _correlation(self._before, small, 0, 0)):
                place = place + np.array(shift) * shrink
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


def _correlation(before: np.ndarray, after: np.ndarray, right: int, down: int) -> float:
    """Correlation of what two pictures (H, W) share when the second lies so far to the right and down; 0 of nothing."""
    rows, columns = before.shape
    if abs(right) >= columns or abs(down) >= rows:
        return 0.0
    one = before[max(0, -down) : rows - max(0, down), max(0, -right) : columns - max(0, right)]
    other = after[max(0, down) : rows + min(0, down), max(0, right) : columns + min(0, right)]
    if min(float(one.std()), float(other.std())) < _LEAST_CONTRAST:
        return 0.0
    return float(cv2.matchTemplate(one, other, cv2.TM_CCOEFF_NORMED)[0, 0])
