"""People in space: seen from elsewhere, followed, told from what touches them, and recognised when they are back."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from benchmarks.people_scene import DepthScene, person, rock
from common.geometry.rotation import quat_from_euler
from onboard.people.bodies import Body, Claimed, VehiclePose, body_of, claims, hang_on, standing_where_expected
from onboard.people.budget import PoseBudget
from onboard.people.config import PoseFilterConfig
from onboard.people.pipeline import PeoplePipeline
from onboard.people.pipeline_config import PeopleConfig, WatchConfig
from onboard.people.pose import BONES
from onboard.people.pose_filter import evidence, same_body
from onboard.people.regions import Region
from onboard.people.sights import Sight
from onboard.people.trim import touches_more, trimmed
from tests.unit.people_bodies import STANDING, pose, region_of
from tests.unit.people_rig import DOWN, Knower, above, frame

HEIGHT_M = 5.0
GRAIN_M = 0.06
JOINTS = np.column_stack(((STANDING - [0, 60]) * (1.5 / 120.0), np.full(15, HEIGHT_M)))
"""(15, 3) of somebody flat on the floor, in the optical frame, m; the head is up the picture."""


def _points(joints: np.ndarray = JOINTS, radius_m: float = 0.1) -> np.ndarray:
    """(N, 3) all around the bones, as far apart as a cloud's."""
    side = np.arange(-1.3, 1.3, GRAIN_M)
    grid = np.array([(x, y) for x in side for y in side])
    begin, along = joints[BONES[:, 0], :2], joints[BONES[:, 1], :2] - joints[BONES[:, 0], :2]
    offsets = grid[:, None] - begin
    share = np.clip((offsets * along).sum(axis=2) / np.maximum((along**2).sum(axis=1), 1e-9), 0.0, 1.0)
    near = np.linalg.norm(offsets - share[..., None] * along, axis=2).min(axis=1) < radius_m
    return np.column_stack((grid[near], np.full(int(near.sum()), HEIGHT_M)))


def _body(vehicle: VehiclePose) -> Body:
    points = _points()
    found = pose(DOWN.project(JOINTS))
    return body_of(3, found, points, (len(points) * GRAIN_M**2, 0.3), HEIGHT_M, DOWN, vehicle)


def _claimed(body: Body, points: np.ndarray, vehicle: VehiclePose, top_m: float = 0.25) -> list[Claimed]:
    heights, areas = np.full(len(points), top_m), np.full(len(points), GRAIN_M**2)
    return claims([body], points.astype(np.float32), heights.astype(np.float32), areas, HEIGHT_M, DOWN, vehicle)


class NoTime(PoseBudget):
    """Leaves no time for a look."""

    def allows(self, known: bool) -> bool:
        """Never."""
        return False


@pytest.mark.parametrize("yaw_deg", [0.0, 70.0, 180.0])
def test_a_body_is_seen_from_elsewhere_where_it_is(yaw_deg: float):
    body = _body(above(HEIGHT_M))
    elsewhere = VehiclePose(np.array([0.4, -0.3, -7.05]), quat_from_euler(0.05, -0.08, math.radians(yaw_deg)))
    camera_points = elsewhere.into_camera(DOWN, body.ned_joints_m)
    np.testing.assert_allclose(elsewhere.from_camera(DOWN, camera_points), body.ned_joints_m, atol=1e-9)
    np.testing.assert_allclose(body.ned_joints_m[:, 2], 0.0, atol=1e-6)
    # The picture's top is north, so the head is north of the feet, by its 1.5 m.
    np.testing.assert_allclose(body.ned_joints_m[0, :2] - body.pose.up @ [0.0, 0.0], (0.75, 0.0), atol=0.01)
    np.testing.assert_allclose(body.pose_in(DOWN, elsewhere).joints_px, DOWN.project(camera_points), atol=1e-6)


def test_somebody_who_moved_is_followed_and_what_touches_them_is_not_theirs():
    vehicle = above(HEIGHT_M)
    body, mine = replace(_body(vehicle), top_m=1.7), _points()
    shift = np.array([0.12, -0.04, 0.0])
    thing = np.array([(x, y, HEIGHT_M) for x in np.arange(0.6, 1.3, GRAIN_M) for y in np.arange(-0.3, 0.6, GRAIN_M)])
    (claimed,) = _claimed(body, np.vstack((mine + shift, thing)), vehicle, 1.5)
    assert claimed.rows.max() < len(mine) and len(claimed.rows) > 0.9 * len(mine)
    # East is right in the picture, north is up.
    moved = claimed.body.ned_joints_m - body.ned_joints_m
    np.testing.assert_allclose(moved, np.tile((0.04, 0.12, 0.0), (15, 1)), atol=0.05)


def test_somebody_whom_the_edge_cuts_is_found_beside_where_they_were_believed():
    vehicle = above(HEIGHT_M)
    body = _body(vehicle)
    for legs_beyond, looked_for in ((2.1, True), (3.0, False)):  # by so much north, m: the picture's top is there
        there = vehicle.into_camera(DOWN, body.ned_joints_m + np.array([legs_beyond, 0.0, 0.0]))
        mine = _points() + (there - JOINTS).mean(axis=0) + np.array([0.15, 0.0, 0.0])
        mine = mine[DOWN.project(mine)[:, 1] > 0]
        found = _claimed(body.shifted(np.array([legs_beyond, 0.0, 0.0])), mine, vehicle)
        assert bool(found) is looked_for
        if found:
            assert len(found[0].rows) > 0.9 * len(mine), "and nothing of them is left for somebody new"


def test_who_lies_does_not_drift_to_what_touches_them():
    vehicle = above(HEIGHT_M)
    body, mine = _body(vehicle), _points()
    thing = np.array([(x, y, HEIGHT_M) for x in np.arange(0.3, 1.0, GRAIN_M) for y in np.arange(-0.9, 0.9, GRAIN_M)])
    thing = thing[np.linalg.norm(thing[:, None, :2] - mine[None, :, :2], axis=2).min(axis=1) > GRAIN_M]
    (claimed,) = _claimed(body, np.vstack((mine, thing)), vehicle)
    np.testing.assert_allclose(claimed.body.ned_joints_m, body.ned_joints_m, atol=0.05)
    assert _claimed(body, mine, vehicle, body.top_m + 0.6) == [], "what is so high is no body that lies"


def test_who_is_gone_takes_nothing():
    vehicle = above(HEIGHT_M)
    body, mine = _body(vehicle), _points()
    assert _claimed(body, mine[: len(mine) // 3], vehicle) == [], "a third of what was there"
    assert _claimed(replace(body, top_m=1.0), mine, vehicle) == [], "what is there is flat"
    assert _claimed(body, mine + np.array([2.5, 0.0, 0.0]), vehicle) == []
    assert _claimed(body, mine, above(HEIGHT_M, 30.0, 0.0)) == [], "not in the picture at all"


def test_what_hangs_on_a_body_is_its_if_it_ends_near_it():
    vehicle = above(HEIGHT_M)
    body = _body(vehicle)
    wrist = JOINTS[7]
    hand = wrist + np.array([(0.22 + d, 0.0, 0.0) for d in (0.0, 0.05, 0.1)])
    plank = wrist + np.array([(0.22 + d, 0.0, 0.0) for d in np.arange(0.0, 1.0, 0.05)])
    assert hang_on(hand.astype(np.float32), body, HEIGHT_M, DOWN, vehicle)
    assert not hang_on(plank.astype(np.float32), body, HEIGHT_M, DOWN, vehicle)


def test_who_stands_is_followed_by_the_trunk_and_told_from_who_passes():
    trunk = np.array([1.0, 2.0, -1.3])
    one = replace(_body(above(HEIGHT_M)), top_m=1.7, area_m2=0.4, ned_trunk_m=trunk)
    two = replace(one, number=4, ned_trunk_m=np.array([1.7, 2.0, -1.3]))
    seen = [np.array([1.62, 2.05, -1.3]), np.array([1.08, 2.0, -1.2])]
    found = standing_where_expected([one, two], seen, [(0.4, 1.7), (0.4, 1.7)])
    assert [(body.number, k) for body, k in found] == [(3, 1), (4, 0)]
    np.testing.assert_allclose(found[0][0].ned_joints_m - one.ned_joints_m, np.tile((0.08, 0.0, 0.0), (15, 1)))
    assert standing_where_expected([one], [np.array([1.5, 2.0, -1.3])], [(0.4, 1.7)]) == [], "too far"
    assert standing_where_expected([one], [trunk], [(0.4, 0.9)]) == [], "what is there is low"
    assert standing_where_expected([one], [trunk], [(0.1, 1.7)]) == [], "too little of it"
    assert standing_where_expected([replace(one, ned_trunk_m=None)], [trunk], [(0.4, 1.7)]) == []


def test_a_thing_that_comes_to_touch_somebody_does_not_enlarge_them():
    people = PeoplePipeline(PeopleConfig(watch=WatchConfig(budget_ms=1e-3)), DOWN, DOWN, Knower().network)
    alone = DepthScene((person("lying", 0.0, 0.3, 0.4),), HEIGHT_M, camera=DOWN)
    for step in range(3):
        (before,) = people.look(frame(alone, 0.1 * step, above(HEIGHT_M))).people
    touched = DepthScene((*alone.things, rock(0.75, 0.3, 0.45)), HEIGHT_M, camera=DOWN)
    found = people.look(frame(touched, 0.3, above(HEIGHT_M)))
    (after,) = found.people
    assert after.number == before.number and len(found.sights) == 2
    assert np.abs(np.subtract(after.box_px, before.box_px)).max() < 25


def test_who_is_back_where_they_lay_is_known_before_their_next_pose():
    knower = Knower()
    people = PeoplePipeline(PeopleConfig(), DOWN, DOWN, knower.network, clock=knower.clock)
    scene = DepthScene((person("lying", 0.0, 0.3, 0.4),), HEIGHT_M, camera=DOWN)
    empty = DepthScene((), HEIGHT_M, camera=DOWN)
    for step in range(3):
        (first,) = people.look(frame(scene, 0.1 * step, above(HEIGHT_M))).people
    for step in range(3, 20, 2):
        assert people.look(frame(empty, 0.1 * step, above(HEIGHT_M))).people == ()
    looks = knower.looks
    people._budget = NoTime(1.0)
    (back,) = people.look(frame(scene, 3.0, above(HEIGHT_M))).people
    assert knower.looks == looks and back.number == first.number and not back.fresh
    # Somebody else in other clothes there is not taken for them.
    other = frame(scene, 10.0, above(HEIGHT_M))
    people.look(frame(empty, 5.0, above(HEIGHT_M)))
    swapped = replace(other, colour=np.ascontiguousarray(other.colour[..., ::-1]))
    assert people.look(swapped).people == ()


def test_somebody_who_leans_on_a_thing_is_cut_out_of_it_by_their_bones():
    joints = np.round(DOWN.project(JOINTS))
    points = np.vstack((_points(), _points() + np.array([1.0, 0.0, 0.0])))
    pixels = np.round(DOWN.project(points)).astype(int)
    low, high = pixels.min(axis=0), pixels.max(axis=0) + 5
    mask = np.zeros((high[1] - low[1], high[0] - low[0]), np.uint8)
    mask[pixels[:, 1] - low[1], pixels[:, 0] - low[0]] = 1
    mask = np.asarray(cv2.dilate(mask, np.ones((5, 5), np.uint8))) > 0
    box = (int(low[0]), int(low[1]), mask.shape[1], mask.shape[0])
    x, y, z = points.mean(axis=0)
    region = Region(box, mask, (float(x), float(y), float(z)), 2.6, 1.5, 0.3)
    sight = Sight(region, np.zeros(3), points_m=points, area_m2=len(points) * GRAIN_M**2)
    part = trimmed(sight, pose(joints), DOWN, above(HEIGHT_M))
    assert part is not None and part.points_m is not None and part.region.camera_p_m is not None
    assert part.region.box_px[2] < 0.7 * box[2] and part.region.box_px[3] > 0.9 * box[3]
    assert abs(part.region.camera_p_m[0]) < 0.1 and part.area_m2 < 0.7 * sight.area_m2
    # What is all theirs stays whole.
    assert trimmed(part, pose(joints), DOWN, None) is None
    assert touches_more(sight, pose(joints), DOWN) and not touches_more(part, pose(joints), DOWN)


def test_a_clear_body_says_more_than_a_small_or_doubtful_one():
    focal_px, config = 0.5 * (DOWN.fx_px + DOWN.fy_px), PoseFilterConfig()
    found = pose(DOWN.project(JOINTS), 1.0, 0.95)
    region = replace(region_of(found.joints_px), camera_p_m=(0.0, 0.0, HEIGHT_M), height_m=0.3)
    assert evidence(found, region, config, focal_px) == 2.0
    assert evidence(found, replace(region, height_m=0.15), config, focal_px) == 0.5, "planks are as flat"
    assert evidence(replace(found, presence=0.9), region, config, focal_px) == 0.5
    small = pose(DOWN.project(JOINTS * np.array([0.4, 0.4, 1.0])), 1.0, 0.95)
    assert evidence(small, region, config, focal_px) == 0.5
    assert evidence(found, region, config) == 1.0, "without depth nothing is measured"
    assert same_body(found, pose(found.joints_px + 3.0)) and not same_body(found, pose(found.joints_px + 60.0))
