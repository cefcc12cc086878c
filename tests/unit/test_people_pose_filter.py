"""The Human Pose Filter on skeletons in closed form (Al-Kaff 2019, eqs 1 to 4)."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from onboard.people.config import PoseFilterConfig
from onboard.people.pose import ANKLE_L, ANKLE_R, HEAD, KNEE_L, KNEE_R, NECK, Pose
from onboard.people.pose_filter import foreshortened_refusal, head_inside, pose_refusal, share_inside, upright
from onboard.people.regions import Crown, Region
from tests.unit.people_bodies import STANDING, moved, pose, region_of

CONFIG = PoseFilterConfig()


@pytest.mark.parametrize("angle_deg", [0, 45, 90, 135, 180, -135, -90, -45])
def test_turned_upright_about_the_head(angle_deg: float):
    joints = moved(STANDING, math.radians(angle_deg), 0.7, (300.0, 200.0))
    turned = upright(joints)
    np.testing.assert_allclose(turned[HEAD], joints[HEAD])
    np.testing.assert_allclose(turned - turned[HEAD], 0.7 * STANDING, atol=1e-9)


def _refusal(joints: np.ndarray, **kwargs: float) -> str:
    return pose_refusal(pose(joints, **kwargs), region_of(STANDING), CONFIG)


def test_a_standing_person_passes():
    assert _refusal(STANDING) == ""


def test_a_person_who_sits_with_knees_up_passes():
    joints = STANDING.copy()
    joints[[KNEE_R, KNEE_L], 1] = 50.0
    assert _refusal(joints) == ""


@pytest.mark.parametrize("joint", [KNEE_R, KNEE_L, 8, 11])
def test_a_leg_joint_above_the_neck_is_refused_on_either_side(joint: int):
    joints = STANDING.copy()
    joints[joint, 1] = 5.0
    assert "order that no body has" in _refusal(joints)


def test_one_foot_above_the_neck_is_refused():
    joints = STANDING.copy()
    joints[ANKLE_L] = [60.0, -30.0]
    assert _refusal(joints)


def test_a_body_whose_head_lies_beside_its_region_is_refused_with_depth():
    region = replace(region_of(STANDING), camera_p_m=(0.0, 0.0, 5.0))
    rows, _ = np.indices(region.mask.shape)
    headless = replace(region, mask=region.mask & (rows + region.box_px[1] > 9))
    assert head_inside(pose(), region) > 0.9 and head_inside(pose(), headless) < 0.1
    assert pose_refusal(pose(), region, CONFIG) == ""
    assert "of the head on the region" in pose_refusal(pose(), headless, CONFIG)
    assert pose_refusal(pose(), replace(headless, at_edge=True), CONFIG) == "", "the picture may end before the head"


def test_of_a_region_that_the_depth_picture_cuts_the_head_is_enough():
    region = replace(region_of(STANDING), camera_p_m=(0.0, 0.0, 5.0))
    rows, _ = np.indices(region.mask.shape)
    above = replace(region, mask=region.mask & (rows + region.box_px[1] < 35), at_edge=True)
    assert "times as long as the region" in pose_refusal(pose(), above, CONFIG)
    assert pose_refusal(pose(), replace(above, cut=True), CONFIG) == ""
    below = replace(region, mask=region.mask & (rows + region.box_px[1] > 75), at_edge=True, cut=True)
    assert pose_refusal(pose(), below, CONFIG)


def test_no_head_no_person():
    joints = STANDING.copy()
    joints[NECK] = joints[HEAD] + [0.0, 5.0]
    assert "body lengths from the neck" in _refusal(joints)
    joints[NECK] = joints[HEAD] - [0.0, 30.0]
    assert "order that no body has" in _refusal(joints)


def test_what_the_network_doubts_is_refused():
    assert "presence 0.40" in _refusal(STANDING, presence=0.4)
    assert "mean confidence 0.30" in _refusal(STANDING, confidence=0.3)


def test_a_body_smaller_or_larger_than_its_region_is_refused():
    assert "as long as the region" in _refusal(moved(STANDING, 0.0, 0.5, (0.0, 30.0)))
    assert "as long as the region" in _refusal(moved(STANDING, 0.0, 2.0, (0.0, -60.0)))


def test_tiny_regions_and_broken_numbers_are_refused():
    small = moved(STANDING, 0.0, 0.2, (0.0, 0.0))
    assert "px long" in pose_refusal(pose(small), region_of(small), CONFIG)
    broken = STANDING.copy()
    broken[3, 0] = np.nan
    assert "no numbers" in _refusal(broken)


@pytest.mark.parametrize(("distance_m", "passes"), [(1.0, False), (7.0, True), (20.0, True), (40.0, False)])
def test_with_depth_the_body_has_to_be_as_long_as_people_are(distance_m: float, passes: bool):
    """120 px at a focal length of 1000 px are 0.12 m for each metre of distance."""
    region = replace(region_of(STANDING), camera_p_m=(0.0, 0.0, distance_m))
    said = pose_refusal(pose(), region, CONFIG, focal_px=1000.0)
    assert (said == "") == passes and ("m long" in said) == (not passes)


def _from_above(**crown: float) -> tuple[Pose, Region]:
    """Somebody who stands below the camera: head in the middle of the shoulders, feet beside it, at 100 px a metre."""
    joints = np.full((15, 2), 200.0)
    joints[[KNEE_R, KNEE_L]] += (4.0, 6.0)
    joints[[ANKLE_R, ANKLE_L]] += (-5.0, 9.0)
    mask = np.ones((60, 60), bool)
    shape = {"depth_m": 5.0, "area_m2": 0.03, "below_m2": 0.08, **crown}
    region = Region((170, 170, 60, 60), mask, (0.0, 0.0, 5.0), 0.6, 0.5, 1.75, Crown(np.array([205.0, 200.0]), **shape))
    return pose(joints, presence=0.5), region


def test_who_stands_below_the_camera_is_known_by_head_and_shoulders():
    seen, region = _from_above()
    assert pose_refusal(seen, region, CONFIG, 500.0) == ""
    assert pose_refusal(seen, region, CONFIG) != "", "without depth there is no evidence for it"
    low = replace(region, height_m=0.4)
    assert "high" in foreshortened_refusal(seen, low, CONFIG, 500.0)


@pytest.mark.parametrize(
    ("crown", "said"),
    [({"area_m2": 0.26}, "a top of"), ({"below_m2": 0.01}, "below a top"), ({"depth_m": 50.0}, "from the top")],
)
def test_barrels_posts_and_heads_elsewhere_are_refused(crown: dict[str, float], said: str):
    seen, region = _from_above(**crown)
    assert said in foreshortened_refusal(seen, region, CONFIG, 500.0)
    assert pose_refusal(seen, region, CONFIG, 500.0) != ""


def test_a_pose_that_lies_beside_its_region_is_somebody_elses():
    seen, region = pose(STANDING), region_of(STANDING)
    assert share_inside(seen, region) == 1.0
    x, y, w, h = region.box_px
    beside = replace(region, box_px=(x + 2 * w, y, w, h))
    assert share_inside(seen, beside) == 0.0
    assert "joints on the region" in pose_refusal(seen, beside, CONFIG)
