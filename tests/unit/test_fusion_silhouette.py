"""The target by what is no part of its surroundings: which thing is it, and what trackers elsewhere are worth then."""

from __future__ import annotations

import numpy as np
import pytest

from common.tracking.base import Box
from onboard.fusion.foreseen import Foreseen
from onboard.fusion.silhouette import silhouette
from tests.unit.test_fusion_tracker import BOX, FRAME, Movable, fused

SHAPE = (240, 320)
HIS: Box = (120.0, 80.0, 60.0, 80.0)
REACH_PX = 40.0


def _apart(*things: Box) -> np.ndarray:
    """A known room with these things in it, at half the size, and some noise."""
    apart = np.full((120, 160), -1, np.int8)
    apart[np.random.default_rng(1).random(apart.shape) < 0.02] = 1
    for x, y, width, height in things:
        apart[int(y / 2) : int((y + height) / 2), int(x / 2) : int((x + width) / 2)] = 1
    return apart


def _aside(by_px: float) -> Box:
    return HIS[0] + by_px, *HIS[1:]


def test_the_thing_as_large_as_the_target_and_nearest_to_where_it_is_foreseen_is_it() -> None:
    apart = _apart(_aside(12.0), _aside(-70.0))
    assert silhouette(apart, HIS, REACH_PX, SHAPE) == pytest.approx(_aside(12.0), abs=3.0)
    assert silhouette(apart, _aside(-60.0), REACH_PX, SHAPE) == pytest.approx(_aside(-70.0), abs=3.0)
    assert silhouette(apart, HIS, 8.0, SHAPE) is None, "so far it cannot have come"
    holed = _apart(_aside(12.0))
    holed[50:52, 70:74] = -1
    assert silhouette(holed, HIS, REACH_PX, SHAPE) == pytest.approx(_aside(12.0), abs=3.0)


@pytest.mark.parametrize("passing", [(100.0, 0.0, 40.0, 240.0), (60.0, 60.0, 100.0, 120.0)])
def test_what_passes_before_it_leaves_nothing_to_be_said(passing: Box) -> None:
    assert silhouette(_apart(HIS, passing), HIS, REACH_PX, SHAPE) is None


def test_what_the_edge_cuts_and_what_nobody_knows_is_not_told() -> None:
    cut: Box = (270.0, 80.0, 60.0, 80.0)
    assert silhouette(_apart(cut), cut, REACH_PX, SHAPE) is None
    unknown = _apart(HIS)
    unknown[40:80, 60:75] = 0
    assert silhouette(unknown, HIS, REACH_PX, SHAPE) is None
    assert silhouette(np.zeros((120, 160), np.int8), HIS, REACH_PX, SHAPE) is None


def test_the_answer_is_the_whole_thing_and_who_clings_to_the_room_is_put_back_on_it() -> None:
    members = Movable(), Movable()
    tracker = fused(*members)
    x, y, width, height = BOX
    there: Box = (x + 10.0, y, width, height)  # the first clings to a side of it
    for k in range(1, 50):
        if k == 20:
            members[1].box = (250.0, 180.0, width, height)
        tracker.foresee(Foreseen(there, reach_px=20.0, apart=_apart(there)))
        result = tracker.update(FRAME, k * 40_000_000)
    assert result.state == "tracking" and result.overlap(there) > 0.8
    assert len(members[1].placed) == 1 and members[1].placed[0] == pytest.approx(there, abs=5.0)
    members[0].state = members[1].state = "lost"
    for k in range(50, 80):
        tracker.foresee(Foreseen(there, reach_px=20.0, apart=_apart(there)))
        result = tracker.update(FRAME, k * 40_000_000)
    assert result.state == "tracking", "nobody knows its other side, and yet it is there"
    for k in range(80, 90):
        tracker.foresee(Foreseen(there, reach_px=20.0, apart=_apart()))
        result = tracker.update(FRAME, k * 40_000_000)
    assert result.state == "predicted"
