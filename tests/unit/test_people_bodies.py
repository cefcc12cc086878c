"""People in space: seen from elsewhere, followed, told from what touches them, and recognised when they are back."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.people_scene import DepthScene, person, rock
from common.geometry.rotation import quat_from_euler
from onboard.people.bodies import BONES, Body, Claimed, VehiclePose, body_of, claims, hang_on
from onboard.people.pipeline import PeoplePipeline
from onboard.people.pipeline_config import PeopleConfig, WatchConfig
from tests.unit.people_bodies import STANDING, pose
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


def _claimed(body: Body, points: np.ndarray, vehicle: VehiclePose) -> list[Claimed]:
    return claims([body], points.astype(np.float32), np.full(len(points), GRAIN_M**2), HEIGHT_M, DOWN, vehicle)


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
    body, mine = _body(vehicle), _points()
    shift = np.array([0.12, -0.04, 0.0])
    thing = np.array([(x, y, HEIGHT_M) for x in np.arange(0.6, 1.3, GRAIN_M) for y in np.arange(-0.3, 0.6, GRAIN_M)])
    (claimed,) = _claimed(body, np.vstack((mine + shift, thing)), vehicle)
    assert set(range(len(mine))) == set(claimed.rows.tolist())
    # East is right in the picture, north is up.
    moved = claimed.body.ned_joints_m - body.ned_joints_m
    np.testing.assert_allclose(moved, np.tile((0.04, 0.12, 0.0), (15, 1)), atol=0.04)


def test_who_is_gone_takes_nothing():
    vehicle = above(HEIGHT_M)
    body, mine = _body(vehicle), _points()
    assert _claimed(body, mine[: len(mine) // 3], vehicle) == [], "a third of what was there"
    assert _claimed(body, mine + np.array([2.5, 0.0, 0.0]), vehicle) == []
    assert _claimed(body, mine, above(HEIGHT_M, 30.0, 0.0)) == [], "not in the picture at all"


def test_what_hangs_on_a_body_is_its_if_it_ends_near_it():
    vehicle = above(HEIGHT_M)
    body = _body(vehicle)
    wrist = JOINTS[7]
    hand = wrist + np.array([(0.22 + d, 0.0, 0.0) for d in (0.0, 0.05, 0.1)])
    plank = wrist + np.array([(0.22 + d, 0.0, 0.0) for d in np.arange(0.0, 1.0, 0.05)])
    heights = np.full(len(plank), 0.15, np.float32)
    assert hang_on(hand.astype(np.float32), heights[:3], body, HEIGHT_M, DOWN, vehicle).all()
    assert not hang_on(plank.astype(np.float32), heights, body, HEIGHT_M, DOWN, vehicle).any()
    # Of somebody upright, what is as high as the arms are is theirs however far it reaches.
    standing = replace(body, top_m=1.75)
    assert hang_on(plank.astype(np.float32), heights + 1.2, standing, HEIGHT_M, DOWN, vehicle).all()


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
    people.config = PeopleConfig(watch=WatchConfig(budget_ms=1e-9))
    people._left_ms = -1e6  # no time for a look
    (back,) = people.look(frame(scene, 3.0, above(HEIGHT_M))).people
    assert knower.looks == looks and back.number == first.number and not back.fresh
    # Somebody else in other clothes there is not taken for them.
    other = frame(scene, 10.0, above(HEIGHT_M))
    people.look(frame(empty, 5.0, above(HEIGHT_M)))
    swapped = replace(other, colour=np.ascontiguousarray(other.colour[..., ::-1]))
    assert people.look(swapped).people == ()
