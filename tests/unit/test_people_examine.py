"""Whose pose a region shows: not a thing's, not a part of somebody beside, not half of somebody known."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import cv2
import numpy as np
import pytest

from onboard.people.appearance import Look
from onboard.people.config import PoseFilterConfig
from onboard.people.examine import Verdict, examine
from onboard.people.findings import Frame
from onboard.people.pipeline_config import WatchConfig
from onboard.people.pose import Pose
from onboard.people.pose_finder import PoseFinder
from onboard.people.regions import Region
from onboard.people.sights import Sight
from onboard.people.spot import Spot
from onboard.people.watch import Watch
from tests.unit.people_bodies import STANDING, moved, pose, region_of
from tests.unit.people_rig import DOWN

DEPTH_M = 4.0
LYING = moved(STANDING, 0.3, 1.2, (250.0, 150.0))
FRAME = Frame(np.zeros((DOWN.height, DOWN.width, 3), np.uint8), 1)


class Finds:
    """Stands for the pose finder: what is found is known."""

    def __init__(self, found: Pose):
        self.found = found

    def find(self, *_: Any) -> Pose:
        """It."""
        return self.found

    again = find


def sight_of(joints: np.ndarray, box: np.ndarray | None = None, **changes: Any) -> Sight:
    """A sight of a body at a depth, and of a rectangle (x, y, width, height), px, that it touches."""
    region = region_of(joints)
    drawn = np.zeros((DOWN.height, DOWN.width), np.uint8)
    x, y, width, height = region.box_px
    drawn[y : y + height, x : x + width] = region.mask
    if box is not None:
        cv2.rectangle(drawn, [int(v) for v in box], 1, -1)
    x, y, width, height = cv2.boundingRect(drawn)
    rows, columns = np.nonzero(drawn[::4, ::4])
    points = DOWN.rays(4.0 * np.column_stack((columns, rows))) * DEPTH_M
    region = Region(
        (int(x), int(y), int(width), int(height)), drawn[y : y + height, x : x + width] > 0, (0.0, 0.0, DEPTH_M),
        1.7, 0.6, 0.3,
    )  # fmt: skip
    return Sight(replace(region, **changes), np.zeros(3), points_m=points, area_m2=0.4)


def verdict(spot: Spot, found: Pose, *others: Pose) -> Verdict:
    """Of a look that finds a pose."""
    return examine(spot, others, FRAME, cast(PoseFinder, Finds(found)), PoseFilterConfig(), DOWN)


def test_a_plank_that_feet_touch_is_cut_off_even_where_the_pose_fits():
    alone = sight_of(LYING).region
    feet = LYING[[10, 13]].mean(axis=0)
    sight = sight_of(LYING, np.array([feet[0], feet[1] - 12, 110, 24]))
    found = verdict(Spot(sight, 0), pose(LYING, 1.0, 0.95))
    assert found.refusal == "" and found.sight is not sight
    before, after = (s.region.box_px[2] - alone.box_px[2] for s in (sight, found.sight))
    assert before > 40 and after < 0.5 * before
    whole = Spot(sight_of(LYING), 0)
    assert verdict(whole, pose(LYING, 1.0, 0.95)).sight is whole.sight, "nothing touches them"
    standing = Spot(replace(sight, ned_trunk_m=np.zeros(3)), 0)
    assert verdict(standing, pose(LYING, 1.0, 0.95)).sight is standing.sight, "columns say what is theirs"


def test_a_part_of_somebody_is_nobody_new():
    sitting = pose(moved(STANDING * (1.2, 0.4), 0.3, 1.2, (250.0, 150.0)))
    trunk = moved(STANDING - STANDING.mean(axis=0), -2.5, 0.45, tuple(sitting.joints_px[[1, 14]].mean(axis=0)))
    part, found = Spot(sight_of(trunk), 0), pose(trunk, 1.0, 0.95)
    assert verdict(part, found).refusal == ""
    assert verdict(part, found, sitting).refusal == "a part of somebody beside"
    assert verdict(part, found, pose(sitting.joints_px + np.array([200.0, 0.0]))).refusal == ""
    part.confirmed = True
    assert verdict(part, found, sitting).refusal == "", "somebody believed may lie across somebody else"
    whole = Spot(sight_of(LYING), 0)
    assert verdict(whole, pose(LYING, 1.0, 0.95), pose(LYING + 1.0)).refusal == "the pose of somebody beside"


@pytest.mark.parametrize(
    ("at_edge", "confidence", "kept"), [(True, 0.8, False), (True, 0.95, True), (False, 0.8, True)]
)
def test_a_doubtful_pose_of_the_legs_alone_does_not_replace_somebody_known(
    at_edge: bool, confidence: float, kept: bool
):
    hips = LYING[[8, 11]].mean(axis=0)
    legs = moved(STANDING, 0.3, 0.72, tuple(hips))
    sight = replace(sight_of(legs, at_edge=at_edge), pose=pose(LYING))
    looked = pose(legs, 1.0, confidence)
    found = verdict(Spot(sight, 0), looked)
    assert found.refusal == "" and found.pose is (looked if kept else sight.pose), "they are still there"
    same = verdict(Spot(sight_of(LYING, at_edge=at_edge), 0), pose(LYING, 1.0, confidence))
    assert same.refusal == ""


def test_of_regions_that_turn_out_to_be_one_body_the_eldest_number_stays():
    watch = Watch(WatchConfig())
    spots = [Spot(sight_of(LYING), 0) for _ in range(3)]
    for spot, number, confirmed in zip(spots, (0, 7, 4), (False, True, False), strict=True):
        spot.found(pose(LYING), Look(np.ones((3, 1))), 2.0, 0)
        spot.number, spot.confirmed = number, confirmed
    watch.spots = list(spots)
    watch.joined(spots[0], spots[1:])
    assert watch.spots == spots[:1] and (spots[0].number, spots[0].confirmed) == (7, True)
    assert watch.shown(spots, 0) == spots[:1], "the parts are not shown any more"
