"""How far the target reaches beyond the fused box, by what moves as it does.

Trackers of fixed shape ride on the side of a thing that they began with: while it turns, another side comes into view
beside their box, and none follows the ratio of the sides. What is around the box moves either with it or with the
ground. Both motions are known, so each place is given to the one that explains its change better, and the box grows to
the rectangle that holds most of what goes with the target. It never shrinks: what covers a part is no part of it.
What looks as it did has not turned, and shows no other side: whatever goes along beside it is another thing.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np

from common.tracking.appearance import upright_patch
from common.tracking.base import Box, center_of, size_of

_CELLS, _BOX_CELLS = 48, 20
"""Side of the square map around the box, and of the box within it."""
_FIRST = (_CELLS - _BOX_CELLS) // 2
_LAST = _FIRST + _BOX_CELLS
_LEAST_PX, _LEAST_SHARE = 4.0, 0.08
"""How far the target must have moved over the ground between two pictures to be told from it: px, and target sizes."""
_REACH_S = 0.4
"""Greatest time between these pictures."""
_SMOOTH = 5
"""Cells over which differences of both pictures are averaged."""
_MEMORY = 0.25
"""Share of a new map in the one that is kept."""
_LIMIT = 0.08
"""Least preference for the target's motion of what belongs to it, -1 to 1."""
_CONTRAST = 0.3
"""Least difference of the mean preferences within the found rectangle and around it."""
_TRIALS, _MOST_TRIALS, _BEYOND = 5, 40, 0.5
"""Maps of a time in which it looks as it did that are needed for the box to grow, and kept, and how far beyond the box
what moves may reach on any side in most of them, box sides: around a face that moves with a body it reaches further,
and the motion then tells nothing about the face; around a whole thing that begins to turn, a little on every side."""
_AS_EVER, _SURELY_AS_EVER = 0.78, 0.82
"""Correlation with its usual look above which it has not turned (0.8 to 0.98 where it has not, else 0.1 to 0.7), and
above which maps tell whether the box is the whole."""
_USUAL_S = 12.0
"""Time constant with which the usual look follows slow changes while it has not turned."""
_BLUR = 0.05
"""By how much the map's own blur moves an edge outwards, box sides."""
_DOUBT, _DOUBT_PX = 0.15, 4.0
"""How far out an edge must lie for the box to grow: box sides, and px; half as far for it to stay grown."""
_FASTEST = 0.6
"""Most by which an edge moves, box sides a second."""


@dataclass(frozen=True)
class _Seen:
    """A picture of late."""

    t_ns: int
    grey: np.ndarray
    place: np.ndarray
    """Where the camera has moved it, (2,), px."""
    box: Box


class Outline:
    """Edges of the target relative to a box that rides on it."""

    def __init__(self) -> None:
        self._seen: deque[_Seen] = deque()
        self._map = np.zeros((_CELLS, _CELLS), np.float32)
        self._trials: deque[float] = deque(maxlen=_MOST_TRIALS)
        self._usual_look: np.ndarray | None = None
        self._alike = 1.0
        self._grown = np.zeros(4)
        """How far the left, upper, right and lower edge lie outside the box, box sides."""
        self._larger = np.zeros(2, bool)
        """Whether the target is wider, and higher, than the box."""

    def whole(self, grey: np.ndarray, t_ns: int, place: np.ndarray, box: Box) -> Box:
        """The whole target's box, px.

        Args:
            grey: the picture, (H, W) uint8.
            t_ns: its stamp, ns.
            place: where the camera's motion has moved the picture, (2,), px.
            box: the fused box in it, px.
        """
        now, look = _Seen(t_ns, grey, place, box), upright_patch(grey, box)
        before_ns = self._seen[-1].t_ns if self._seen else t_ns
        self._compare(look, (t_ns - before_ns) * 1e-9)
        wanted = self._look(now)
        most = _FASTEST * (t_ns - before_ns) * 1e-9
        if wanted is not None:
            self._grown = self._grown + np.clip(wanted - self._grown, -most, most)
        self._seen.append(now)
        while t_ns - self._seen[0].t_ns > _REACH_S * 1e9:
            self._seen.popleft()
        return self.around(box)

    def around(self, box: Box) -> Box:
        """The whole target's box, px, for a box that only a motion model tells: as far around it as it last was."""
        left, up, right, down = self._grown.tolist()
        x, y, width, height = box
        return x - left * width, y - up * height, (1 + left + right) * width, (1 + up + down) * height

    def rest(self) -> None:
        """Nobody sees the target, or it is followed anew: pictures of before say nothing about it."""
        self._seen.clear()

    def _compare(self, look: np.ndarray, elapsed_s: float) -> None:
        """Note how far a look (n,) is the usual one, which follows it slowly while it is."""
        usual = look if self._usual_look is None else self._usual_look
        self._alike += _MEMORY * (float(usual @ look) - self._alike)
        if self._alike > _AS_EVER:
            usual = usual - math.expm1(-elapsed_s / _USUAL_S) * (look - usual)
        self._usual_look = usual / (float(np.linalg.norm(usual)) + 1e-6)

    def _look(self, now: _Seen) -> np.ndarray | None:
        """How far the edges lie outside, (4,), box sides; None where the pictures do not tell."""
        before = self._reference(now)
        if before is None:
            return None
        preferred = _preference(before, now)
        self._map += _MEMORY * (preferred - self._map)
        found = _rectangle(self._map - _LIMIT)
        left, up, right, down = found
        inside = np.zeros((_CELLS, _CELLS), bool)
        inside[up:down, left:right] = True
        if inside.all() or self._map[inside].mean() - self._map[~inside].mean() < _CONTRAST:
            return None
        if self._alike > _SURELY_AS_EVER:
            self._trials.append(max(_FIRST - left, _FIRST - up, right - _LAST, down - _LAST) / _BOX_CELLS)
        if self._alike > _AS_EVER:
            return np.zeros(4)
        if len(self._trials) < _TRIALS or float(np.median(self._trials)) > _BEYOND:
            return None
        outside = np.array([_FIRST - left, _FIRST - up, right - _LAST, down - _LAST]) / _BOX_CELLS
        outside -= np.clip(outside, -_BLUR, _BLUR)
        reach = np.maximum(outside[:2], outside[2:])
        doubt = np.maximum(_DOUBT, _DOUBT_PX / np.array(now.box[2:]))
        self._larger = np.where(self._larger, reach > 0.5 * doubt, reach > doubt)
        outside *= np.concatenate([self._larger, self._larger])
        # An edge goes in only as far as the opposite one goes out: the box has slid, and what is covered counts.
        return np.maximum(outside, -np.maximum(0, outside[[2, 3, 0, 1]]))

    def _reference(self, now: _Seen) -> _Seen | None:
        """The newest picture since which the target has moved far enough over the ground."""
        for before in reversed(self._seen):
            moved = np.subtract(center_of(now.box), now.place) - np.subtract(center_of(before.box), before.place)
            if np.hypot(*moved) >= max(_LEAST_PX, _LEAST_SHARE * size_of(now.box)):
                return before
        return None


def _preference(before: _Seen, now: _Seen) -> np.ndarray:
    """How much better the target's motion than the ground's explains each cell around the box, (n, n), -1 to 1."""
    current = _cut(now.grey, now.box)
    ground: Box = (*(np.array(now.box[:2]) + before.place - now.place).tolist(), *now.box[2:])
    with_ground = np.abs(current - _cut(before.grey, ground))
    with_target = np.abs(current - _cut(before.grey, before.box))
    with_ground, with_target = (cv2.blur(d, (_SMOOTH, _SMOOTH)) for d in (with_ground, with_target))
    return (with_ground - with_target) / (with_ground + with_target + 0.2)


def _cut(grey: np.ndarray, box: Box) -> np.ndarray:
    """The surroundings of a box, (n, n), without their mean and in units of their contrast."""
    x, y, width, height = box
    step = np.array([width, height]) / _BOX_CELLS
    shift = np.array([x, y]) - _FIRST * step + (step - 1) / 2
    matrix = np.array([[step[0], 0.0, shift[0]], [0.0, step[1], shift[1]]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    cut = cv2.warpAffine(grey, matrix, (_CELLS, _CELLS), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    cut = cv2.GaussianBlur(cut.astype(np.float32), (0, 0), 0.8)
    cut -= cv2.blur(cut, (_BOX_CELLS | 1, _BOX_CELLS | 1))
    return cut / (float(cut.std()) + 1.0)


def _rectangle(worth: np.ndarray) -> tuple[int, int, int, int]:
    """Rectangle (left, up, right, down) around the box that holds most worth, each edge in turn until none moves."""
    sums = cv2.integral(worth)
    left, up, right, down = _FIRST, _FIRST, _LAST, _LAST
    middle = _CELLS // 2
    for _ in range(4):
        old = left, up, right, down
        left = int((sums[down, :middle] - sums[up, :middle]).argmin())
        right = middle + int((sums[down, middle:] - sums[up, middle:]).argmax())
        up = int((sums[:middle, right] - sums[:middle, left]).argmin())
        down = middle + int((sums[middle:, right] - sums[middle:, left]).argmax())
        if (left, up, right, down) == old:
            break
    return left, up, right, down
