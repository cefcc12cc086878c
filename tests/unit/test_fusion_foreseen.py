"""Where the target must be: what a depth camera says of a tracker's box, and how large the box may be."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from common.tracking.base import Box
from onboard.fusion.foreseen import Foreseen, core_of

SHAPE = (240, 320)
HIS: Box = (140.0, 60.0, 30.0, 100.0)


def _depth(*things: tuple[Box, float]) -> np.ndarray:
    """A depth picture at half the size, nothing but these boxes at these distances, m."""
    depth = np.zeros((120, 160))
    for (x, y, width, height), distance_m in things:
        depth[int(y / 2) : int((y + height) / 2), int(x / 2) : int((x + width) / 2)] = distance_m
    return depth


def _aside(by_px: float) -> Box:
    return HIS[0] + by_px, *HIS[1:]


def test_who_is_nearer_or_farther_than_the_target_can_be_is_somebody_else_however_he_looks() -> None:
    boxes = {"his": HIS, "hers": _aside(60.0), "far": _aside(-60.0), "nowhere": _aside(120.0)}
    depth = _depth((HIS, 4.0), (boxes["hers"], 3.1), (boxes["far"], 5.2))
    foreseen = Foreseen(HIS, 4.1, 0.0, depth, SHAPE)
    assert foreseen.excluded(boxes) == {"hers", "far"}
    assert not Foreseen(HIS, 4.1, 1.0, depth, SHAPE).excluded(boxes), "after a second he may be there"
    for unknown in (replace(foreseen, depth_m=None), replace(foreseen, distance_m=math.nan)):
        assert not unknown.excluded(boxes)


def test_where_nothing_can_be_measured_is_not_the_target_that_could_be_within_the_range() -> None:
    boxes = {"his": HIS, "a wall beyond the range": _aside(60.0)}
    depth = _depth((HIS, 4.0), ((0.0, 180.0, 60.0, 40.0), 7.5))
    foreseen = Foreseen(HIS, 4.0, 0.0, depth, SHAPE, measured=True)
    assert foreseen.excluded(boxes) == {"a wall beyond the range"}
    assert not replace(foreseen, measured=False).excluded(boxes), "he is as dark himself"
    assert not replace(foreseen, reach_m=3.5).excluded(boxes), "he may have gone beyond it"


def test_what_stands_before_the_target_is_not_the_target_however_long_it_stands_there() -> None:
    screen = (100.0, 20.0, 90.0, 190.0)
    foreseen = Foreseen(HIS, 4.0, 1.5, _depth((screen, 3.0)), SHAPE, covered_m=3.1)
    assert foreseen.excluded({"on it": _aside(10.0), "elsewhere": _aside(100.0)}) == {"on it"}


def test_while_the_picture_does_not_show_his_place_who_is_elsewhere_is_not_heard_whatever_is_measured() -> None:
    at_the_edge, inwards = (-8.0, *HIS[1:]), (60.0, *HIS[1:])
    foreseen = Foreseen((-20.0, *HIS[1:]), 4.0, 1.5, None, SHAPE)
    boxes = {"his": at_the_edge, "hers": inwards}
    assert foreseen.excluded(boxes) == {"hers"}
    assert foreseen.excluded({"hers": inwards}) == {"hers"}
    entering = replace(foreseen, box=at_the_edge)
    assert entering.excluded(boxes) == {"hers"}, "he may be a little outside yet"
    wall = replace(entering, distance_m=4.0, depth_m=np.full((120, 160), 4.2), around=np.ones((120, 160), bool))
    assert wall.excluded({"at a wall there": at_the_edge}) == {"at a wall there"}
    assert not replace(entering, reach_m=0.1).excluded(boxes), "he was seen just now"
    assert not replace(foreseen, box=(30.0, *HIS[1:])).excluded(boxes), "by now he would be seen there"


def test_who_has_come_nearer_behind_what_covered_him_does_not_cover_himself() -> None:
    nearer = Foreseen(HIS, 4.0, 1.5, _depth((HIS, 3.4)), SHAPE, covered_m=2.6)
    assert nearer.before_m == 2.6 and not nearer.excluded({"his": HIS})
    assert replace(nearer, reach_m=0.0, covered_m=math.nan).before_m == 3.4, "nobody comes nearer at once"
    assert replace(nearer, covered_m=3.3).before_m == 3.4, "the same goes on"
    assert replace(nearer, others=_depth((HIS, 3.4)) > 0.0).before_m == 3.4, "she is known"


def test_what_covered_the_target_is_not_he_either_once_it_has_passed_and_he_may_be_as_near() -> None:
    screen = (155.0, 20.0, 90.0, 190.0)
    depth = _depth((screen, 3.0), (HIS, 4.0))
    depth[:, 77:] = _depth((screen, 3.0))[:, 77:]  # it stands before his right half
    boxes = {"his": _aside(-5.0), "half on its edge": _aside(10.0)}
    unseen = Foreseen(_aside(-30.0), 4.0, 1.5, depth, SHAPE)
    assert not unseen.excluded(boxes), "within a second and a half he can have come there"
    assert replace(unseen, covered_m=3.05).excluded(boxes) == {"half on its edge"}


def test_neither_somebody_else_who_is_known_nor_the_floor_is_the_target_however_far_he_may_have_got() -> None:
    boxes = {"his": HIS, "hers": _aside(60.0), "at the edge of either": _aside(-28.0), "on the floor": _aside(-60.0)}
    depth = _depth((HIS, 4.0), (boxes["hers"], 3.6), (_aside(-30.0), 4.4), (_aside(-60.0), 4.4))
    foreseen = Foreseen(HIS, 4.0, 1.5, depth, SHAPE)
    assert not foreseen.excluded(boxes), "by its distance each may be he"
    known = replace(foreseen, others=_depth((boxes["hers"], 1.0)) > 0.0, around=depth == 4.4)
    assert known.excluded(boxes) == {"hers", "at the edge of either", "on the floor"}
    assert foreseen.of_his_size(boxes) >= {"hers", "on the floor"}
    assert known.of_his_size(boxes) == {"his"}
    assert known.confirmed(boxes) == {"his"} < foreseen.confirmed(boxes)
    covered = replace(known, others=_depth((HIS, 1.0)) > 0.0)
    assert "his" in covered.excluded(boxes), "that is she, and he behind her"


def test_a_box_is_confirmed_where_it_is_as_large_and_as_far_as_the_target_is_foreseen() -> None:
    x, y, width, height = HIS
    boxes = {
        "his": _aside(8.0),
        "aside": _aside(60.0),
        "large": (x - width / 2, y - height / 2, 2 * width, 2 * height),
    }
    foreseen = Foreseen(HIS, 4.0, 0.0, _depth(((0.0, 0.0, 320.0, 240.0), 4.2)), SHAPE)
    assert foreseen.confirmed(boxes) == {"his"}
    assert not replace(foreseen, distance_m=3.0).confirmed(boxes)
    assert not replace(foreseen, covered_m=4.2).confirmed(boxes), "that is what has covered him"
    for unknown in (replace(foreseen, depth_m=None), replace(foreseen, depth_m=np.zeros((120, 160)))):
        assert not unknown.confirmed(boxes)


def test_what_is_behind_him_is_not_he_though_he_may_have_gone_so_far_unless_the_box_has_shrunk_as_much() -> None:
    x, y, width, height = HIS
    smaller: Box = (x + 60.0, y, 0.67 * width, 0.67 * height)
    depth = _depth(((0.0, 0.0, 320.0, 240.0), 6.0))
    foreseen = Foreseen(HIS, 4.0, 2.0, depth, SHAPE)
    assert foreseen.excluded({"as large": _aside(20.0), "smaller": smaller}) == {"as large"}
    assert not foreseen.confirmed({"as large": _aside(5.0)})


def test_a_box_is_of_the_targets_size_wherever_it_is_if_the_measured_distance_says_so() -> None:
    x, y, width, height = HIS
    farther: Box = (x + 60.0, y, 0.7 * width, 0.7 * height)
    depth = _depth((HIS, 4.0), (farther, 5.7), (_aside(-60.0), 5.7))
    foreseen = Foreseen(HIS, 4.0, 0.0, depth, SHAPE)
    boxes = {"his": HIS, "his farther": farther, "as large, but farther": _aside(-60.0), "nowhere": _aside(120.0)}
    assert foreseen.of_his_size(boxes) == {"his", "his farther"}
    assert foreseen.of_his_size({"his farther": farther}) and foreseen.excluded(boxes) >= {"his farther"}
    assert replace(foreseen, covered_m=5.7).of_his_size(boxes) == {"his"}, "that is what has covered him"
    assert not replace(foreseen, depth_m=None).of_his_size(boxes)


def test_a_box_counts_by_what_fills_its_middle_and_not_by_what_shows_beside_the_target() -> None:
    depth = np.full((120, 160), 6.0)
    depth[30:80, 72:83] = 4.0
    assert not Foreseen(HIS, 4.0, 0.0, depth, SHAPE).excluded({"his": HIS})
    core = core_of(depth, HIS, SHAPE, 4.0)
    assert core is not None and set(np.unique(core)) <= {0.0, 4.0} and float((core > 0.0).mean()) > 0.7
    assert core_of(depth, (-80.0, 60.0, 30.0, 100.0), SHAPE) is None
    assert core_of(depth, (310.0, 200.0, 60.0, 200.0), SHAPE) is None


@pytest.mark.parametrize(("times", "left"), [(1.0, 1.0), (1.1, 1.1), (1.5, 1.162), (0.5, 0.861)])
def test_nobody_grows_by_half(times: float, left: float) -> None:
    x, y, width, height = HIS
    box = (x - width * (times - 1) / 2, y - height * (times - 1) / 2, width * times, height * times)
    fitted = Foreseen(HIS, 4.0).fitted(box)
    assert fitted[2:] == pytest.approx((width * left, height * left), rel=1e-3)
    assert fitted[0] + fitted[2] / 2 == pytest.approx(155.0) and fitted[1] + fitted[3] / 2 == pytest.approx(110.0)
    assert Foreseen(HIS).fitted(box) == box, "nobody knows how far he is"
    assert abs(Foreseen(HIS, 4.0, 4.0).grown(box)) < 0.01, "unseen for long, he may be twice as far or at half of it"
