"""Which trackers are doubted, or believed alone, by how like the target their boxes look and where they are."""

from __future__ import annotations

from collections.abc import Mapping

from common.evaluation import jaccard
from common.tracking.base import Box
from onboard.fusion.prior import CLEARLY, FAR_MORE, SURELY, TOGETHER, as_foreseen

_DOUBTFUL = 0.45
"""Relative similarity below which a tracker's box is doubted if another's is clearly more similar; over films, of one
that is at the answer, by far more: so much twins may be."""
_UNLIKE, ALONE_UNLIKE = 0.3, 0.5
"""Relative similarity below which it is doubted in any case, and when the other trackers say that they are lost."""


def doubted(
    similar: Mapping[str, float],
    boxes: Mapping[str, Box],
    last: Box | None,
    there: float,
    foreseen: Box | None,
    followed: frozenset[str] = frozenset(),
) -> frozenset[str]:
    """Trackers whose box looks less like the target than one elsewhere does, or like nothing known.

    Of boxes at one place the witness cannot judge: what turns away, and grows, looks most like the past in the box that
    does not grow with it.

    Args:
        similar: likeness of each tracker's box.
        boxes: the same trackers' boxes, px.
        last: the last answer, px; None without one, or where there is one tracker alone anyway.
        there: least likeness of one that is alone, and is where the answer was.
        foreseen: where the target's motion over ground leads one to expect it: who is found there, however changed, is
            no more doubted than several would be.
        followed: who have followed ever since two agreed, with a thing in their box that moves as the box does. A
            target that has turned away looks like nothing that is known.
    """
    best = max(similar.values(), default=0.0)
    least = _UNLIKE
    if len(boxes) == 1 and last is not None:
        (box,) = boxes.values()
        if foreseen is None or not as_foreseen(box, foreseen):
            least = there if jaccard(box, last) > TOGETHER else max(there, ALONE_UNLIKE)
    there_too = {n for n, box in boxes.items() if last is not None and jaccard(box, last) > TOGETHER}
    margin = {n: FAR_MORE if n in there_too and foreseen is None else CLEARLY for n in boxes}
    unlike = {n for n, s in similar.items() if s < least or (s < _DOUBTFUL and s < best - margin[n])}
    unlike -= followed & there_too
    return frozenset(name for name in unlike if not set(same_as(name, boxes)) - unlike)


def found_alone(similar: Mapping[str, float], boxes: Mapping[str, Box], last: Box | None) -> tuple[str, ...]:
    """The one tracker that sees the target, where that is elsewhere than the last answer and surely the target."""
    if len(boxes) != 1 or last is None:
        return ()
    (name,) = boxes
    elsewhere = jaccard(boxes[name], last) < TOGETHER
    return (name,) if elsewhere and similar[name] >= SURELY else ()


def together(boxes: Mapping[str, Box]) -> frozenset[str]:
    """Those that agree with another one of them."""
    return frozenset(name for name in boxes if same_as(name, boxes))


def same_as(name: str, boxes: Mapping[str, Box]) -> list[str]:
    """The other trackers whose box overlaps that of this one by half; none where it has no box."""
    if name not in boxes:
        return []
    return [n for n, box in boxes.items() if n != name and jaccard(box, boxes[name]) > TOGETHER]
