"""What the target's place says of trackers over time: who is believed elsewhere, and when what stands there is not."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from common.tracking.base import Box
from onboard.fusion.foreseen import Foreseen
from onboard.fusion.place import PlaceCheck

SHAPE = (240, 320)
THERE: Box = (140.0, 60.0, 30.0, 100.0)
"""Where he is foreseen, 4 m away."""
HIS: Box = (200.0, 53.0, 34.0, 114.0)
"""Where he is, 3.5 m away: half a metre nearer than he can be."""
HERS: Box = (146.0, 62.0, 28.0, 97.0)
MS = 1_000_000


def _depth(*things: tuple[Box, float]) -> np.ndarray:
    """A depth picture at half the size: a wall 7 m away, and these boxes at these distances, m."""
    depth = np.full((120, 160), 7.0)
    for (x, y, width, height), distance_m in things:
        depth[int(y / 2) : int((y + height) / 2), int(x / 2) : int((x + width) / 2)] = distance_m
    return depth


BESIDE_HER = Foreseen(THERE, 4.0, 0.0, _depth((HERS, 4.1), (HIS, 3.45)), SHAPE, measured=True, solid=HERS)
ALONE = replace(BESIDE_HER, depth_m=_depth((HIS, 3.45)), solid=None)


def _excluded(place: PlaceCheck, foreseen: Foreseen, boxes: dict[str, Box], t_ms: int) -> frozenset[str]:
    place.look(t_ms * MS, foreseen, SHAPE)
    return place.excluded(boxes)


def test_several_that_agree_for_long_at_another_distance_are_heard_though_one_fails_them_for_a_picture() -> None:
    place, both = PlaceCheck(0), {"dsst": HIS, "struck": HIS}
    for t_ms in range(0, 300, 30):
        boxes = {"dsst": HIS} if t_ms in (150, 180) else both
        assert _excluded(place, BESIDE_HER, boxes, t_ms) == boxes.keys()
    assert not _excluded(place, BESIDE_HER, both, 300)
    assert _excluded(place, BESIDE_HER, {**both, "tld": HERS, "cmt": HERS}, 330) == both.keys(), "two are where he is"


def test_what_stands_there_is_not_heard_against_several_that_agree_elsewhere_for_it_knows_no_look() -> None:
    place, both = PlaceCheck(0), {"dsst": HIS, "struck": HIS}
    _excluded(place, BESIDE_HER, {"dsst": HIS}, 0)
    assert place.thing is not None, "one by itself may err"
    _excluded(place, BESIDE_HER, both, 30)
    assert place.thing is None
    _excluded(place, BESIDE_HER, {**both, "tld": HERS}, 60)
    assert place.thing is not None, "a tracker sees the target there"


def test_what_has_stood_there_since_a_tracker_saw_him_in_it_is_he_whoever_agrees_elsewhere() -> None:
    place, both = PlaceCheck(0), {"dsst": HIS, "struck": HIS}
    _excluded(place, BESIDE_HER, {"tld": HERS}, 0)
    for t_ms in range(30, 900, 30):
        assert _excluded(place, BESIDE_HER, both, t_ms) == both.keys()
        assert place.thing is not None
    for t_ms in range(900, 1200, 30):
        _excluded(place, replace(BESIDE_HER, solid=None), {}, t_ms)
    for t_ms in range(1200, 1530, 30):
        excluded = _excluded(place, BESIDE_HER, both, t_ms)
        assert place.thing is None, "it may be another"
    assert not excluded


def test_any_that_is_as_large_as_he_is_heard_elsewhere_once_his_place_has_been_empty_for_long() -> None:
    place, one = PlaceCheck(0), {"tld": HIS, "at the wall": (40.0, 60.0, 30.0, 100.0)}
    for t_ms in range(0, 300, 30):
        assert _excluded(place, ALONE, one, t_ms) == one.keys()
    assert _excluded(place, ALONE, one, 300) == {"at the wall"}


@pytest.mark.parametrize(
    "there",
    [
        replace(ALONE, solid=HIS),
        replace(ALONE, depth_m=_depth((THERE, 4.2))),
        replace(ALONE, depth_m=_depth(((100.0, 20.0, 90.0, 190.0), 3.0))),
        replace(ALONE, depth_m=_depth((THERE, 0.0)), measured=False),
        replace(ALONE, reach_m=3.0),
        replace(ALONE, box=(-20.0, *THERE[1:])),
        replace(ALONE, depth_m=None),
        replace(ALONE, distance_m=math.nan),
    ],
    ids=["a thing", "he", "a screen", "not measured", "he may be so far", "not shown", "no camera", "no distance"],
)
def test_his_place_is_empty_only_if_what_is_behind_it_is_seen(there: Foreseen) -> None:
    assert ALONE.empty
    assert replace(ALONE, depth_m=_depth((THERE, 0.0))).empty, "beyond the range there, where he was measured himself"
    assert not there.empty
