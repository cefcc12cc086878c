"""Where the target can be by its own motion: what tells it from another thing that looks the same.

Boxes are those of a camera that holds still but for the last answer, which has been moved with the picture already
(`camera_motion`). So a target moves evenly there, and a box far off is of another thing, however alike.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from common.evaluation import jaccard
from common.tracking.base import Box, center_of, size_of

_REACH, _SPEED = 1.5, 5.0
"""How far from the answer the target may be found: target sizes, and more for each second since two agreed on it."""
_GROWN, _GROWTH = 0.5, 1.0
"""By how much its size may differ, logarithm, and the same for each second."""
_THERE = 0.4
"""Overlap with the answer above which a tracker is where the target was expected."""
_APART = 0.2
"""Overlap with the answer below which it is at another thing."""
SURELY = 0.7
"""Likeness from which a box is the target: one tracker's that is alone with it, or the mean of those who agree."""
CLEARLY, FAR_MORE = 0.1, 0.25
"""By how much more alike another must be to be heard beside who is at the answer, and to outshine all there."""
TOGETHER = 0.5
"""Overlap above which two boxes are the same: their trackers agree."""
_FORESEEN, _FORESEEN_GROWN = 0.7, 0.35
"""How far from where its motion over ground leads one to expect it the target is, target sizes, and its size,
logarithm: somebody beside it is further."""
LIKE, LIKE_BESIDE_TWINS = 0.5, 0.4
"""Least likeness of one that is where the target was expected for the others to be doubted: beside things that look the
same it is one half at best."""


def out_of_reach(boxes: Mapping[str, Box], last: Box, since_s: float) -> frozenset[str]:
    """Trackers whose box is further from the last answer, or of another size, than the target can have come by itself.

    Args:
        boxes: of each tracker that sees the target, px.
        last: the answer, moved with the picture, px.
        since_s: time since two trackers last agreed on it, s.
    """
    size = math.sqrt(max(1.0, last[2] * last[3]))
    reach_px, grown = size * (_REACH + _SPEED * since_s), _GROWN + _GROWTH * since_s
    u, v = center_of(last)

    def beyond(box: Box) -> bool:
        x, y = center_of(box)
        return math.hypot(x - u, y - v) > reach_px or abs(math.log(size_of(box) / size)) > grown

    return frozenset(name for name, box in boxes.items() if beyond(box))


def as_foreseen(box: Box, foreseen: Box) -> bool:
    """Whether a box is where, and as large as, the target's motion over ground leads one to expect it, px."""
    size = size_of(foreseen)
    (u, v), (x, y) = center_of(foreseen), center_of(box)
    grown = math.log(size_of(box) / size)
    return math.hypot(x - u, y - v) <= _FORESEEN * size and abs(grown) <= _FORESEEN_GROWN


def elsewhere(similar: Mapping[str, float], boxes: Mapping[str, Box], last: Box, least: float = LIKE) -> frozenset[str]:
    """Trackers elsewhere than the answer, where another is there, looks like the target, and hardly less so than they.

    Two that find the same other thing agree with each other; that it looks the same is no reason to leave the one that
    has gone on where the target was expected.

    Args:
        similar: likeness of each tracker's box, 0 to 1.
        boxes: the same trackers' boxes, px.
        last: the answer, moved with the picture, px.
        least: least likeness of one that is there.
    """
    best = max((similar[name] for name, box in boxes.items() if jaccard(box, last) > _THERE), default=0.0)
    if best < least:
        return frozenset()
    return frozenset(n for n, box in boxes.items() if jaccard(box, last) < _APART and similar[n] < best + CLEARLY)


def gone(similar: Mapping[str, float], boxes: Mapping[str, Box], kept: Box, likeness: float) -> frozenset[str]:
    """Trackers, if it is all, that have left where the target was expected, and still is by its look, for its like.

    Args:
        similar: likeness of each tracker's box, 0 to 1.
        boxes: the same trackers' boxes, px.
        kept: the box there, px.
        likeness: of that one, 0 to 1.
    """
    away = frozenset(n for n, box in boxes.items() if jaccard(box, kept) < _APART)
    if away != boxes.keys() or likeness < LIKE_BESIDE_TWINS:
        return frozenset()
    return frozenset() if any(similar[n] > likeness + CLEARLY for n in away) else away


def rivals(
    similar: Mapping[str, float], boxes: Mapping[str, Box], last: Box, copies: frozenset[str] = frozenset()
) -> frozenset[str]:
    """The two or more trackers that agree elsewhere than those at the answer, and are at least as credible as these.

    That is: they look clearly more like the target on average, or are more and look hardly less so; where nobody is at
    the answer, they surely look like the target.

    Args:
        similar: likeness of each tracker's box, 0 to 1.
        boxes: the same trackers' boxes, px.
        last: the answer, moved with the picture, px.
        copies: trackers that were put on the answer, and do not count there.
    """
    there = [name for name, box in boxes.items() if jaccard(box, last) > _THERE and name not in copies]
    away = {name: box for name, box in boxes.items() if jaccard(box, last) < _APART and similar[name] >= LIKE}
    together = [frozenset(n for n in away if jaccard(away[n], box) > TOGETHER) for box in away.values()]
    group = max(together, key=lambda names: (len(names), sum(similar[n] for n in names)), default=frozenset())
    if len(group) < 2:
        return frozenset()
    mean = sum(similar[n] for n in group) / len(group)
    if not there:
        return group if mean > SURELY else frozenset()
    lead = mean - sum(similar[n] for n in there) / len(there)
    return group if lead > (CLEARLY if len(group) <= len(there) else -CLEARLY) else frozenset()


def outshining(similar: Mapping[str, float], boxes: Mapping[str, Box], last: Box) -> frozenset[str]:
    """The tracker elsewhere, and who agree with it, that surely looks like the target, and far more so than all there.

    Nobody, where nobody is at the answer.

    Args:
        similar: likeness of each tracker's box, 0 to 1.
        boxes: the same trackers' boxes, px.
        last: the answer, moved with the picture, px.
    """
    there = max((similar[name] for name, box in boxes.items() if jaccard(box, last) > _THERE), default=1.0)
    away = {name: similar[name] for name, box in boxes.items() if jaccard(box, last) < _APART}
    best = max(away, key=lambda name: away[name], default="")
    if away.get(best, 0.0) < max(SURELY, there + FAR_MORE):
        return frozenset()
    return frozenset(name for name in away if jaccard(boxes[name], boxes[best]) > TOGETHER)
