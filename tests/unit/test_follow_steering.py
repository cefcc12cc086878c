"""From a box to a request: the distance from which a target stays whole, and how long an unseen one is flown after."""

from __future__ import annotations

import math

import numpy as np
import pytest

from common.geometry.camera import Camera
from common.geometry.rotation import as_quat, quat_conjugate, quat_from_euler, quat_multiply, quat_rotate
from common.tracking.base import Box
from onboard.follow.config import FollowConfig
from onboard.follow.law import Vehicle
from onboard.follow.sight import TargetPlace, whole_from_m
from onboard.follow.steering import Steering
from onboard.fusion.config import DepthConfig
from onboard.proximity.pose import Pose

EYE_M, TALL_M, G = 1.5, 1.75, 9.81
S = 1_000_000_000


def _camera(down_rad: float) -> Camera:
    mount = as_quat(quat_multiply(quat_from_euler(0.0, -down_rad, 0.0), (0.5, 0.5, 0.5, 0.5)))
    return Camera(320, 240, 228.0, 228.0, 159.5, 119.5, (0.0, 0.0, 0.0, 0.0, 0.0), mount, (0.0, 0.0, 0.0))


def _seen(camera: Camera, distance_m: float, pitch_rad: float) -> tuple[Box, Pose]:
    """Box of somebody upright ahead of a vehicle 1.5 m up, and its pose."""
    pose = Pose(np.array([0.0, 0.0, -EYE_M]), quat_from_euler(0.0, pitch_rad, 0.0))
    turn = quat_conjugate(quat_multiply(pose.ned_q_body, camera.body_q_camera))
    ends = [quat_rotate(turn, np.array([distance_m, 0.0, down_m])) for down_m in (EYE_M - TALL_M, EYE_M)]
    (u, top), (_, foot) = camera.project(np.array(ends))
    tall = float(foot - top)
    return (float(u) - 0.15 * tall, float(top), 0.3 * tall, tall), pose


@pytest.mark.parametrize("down_rad", [0.0, 0.17, 0.4])
@pytest.mark.parametrize("acceleration_m_s2", [1.0, 2.0, 3.0])
def test_from_there_a_target_stays_whole_while_the_nose_rises_and_dips(
    down_rad: float, acceleration_m_s2: float
) -> None:
    camera = _camera(down_rad)
    box, pose = _seen(camera, 5.0, 0.05)
    least_m = whole_from_m(camera, box, pose, 5.0, acceleration_m_s2)
    tilt_rad = math.atan(acceleration_m_s2 / G)
    lower_rad = math.atan(120.5 / 228.0) + down_rad
    expected_m = EYE_M / math.tan(max(lower_rad - tilt_rad, lower_rad / 2))
    upper_rad = math.atan(119.5 / 228.0) - down_rad
    if upper_rad > 0.0:
        expected_m = max(expected_m, (TALL_M - EYE_M) / math.tan(max(upper_rad - tilt_rad, upper_rad / 2)))
    assert least_m == pytest.approx(expected_m, rel=0.01)
    if lower_rad > 2 * tilt_rad:
        (_, _, _, height), _ = raised, _ = _seen(camera, least_m, tilt_rad)
        assert raised[1] + height == pytest.approx(240.0, abs=1.5) or least_m > EYE_M / math.tan(lower_rad - tilt_rad)


def test_a_target_that_is_too_near_to_stay_whole_is_backed_away_from_unless_told_to_keep_the_first_distance() -> None:
    camera = _camera(0.17)
    box, pose = _seen(camera, 2.5, 0.0)
    vehicle = Vehicle(pose.ned_p_m, np.zeros(3), 0.0, 0.0)
    for config, backwards in ((FollowConfig(), True), (FollowConfig(keep="first"), False)):
        steering = Steering(config, DepthConfig(), camera)
        for k in range(1, 20):
            request = steering.step(k * S // 30, box, pose, vehicle)
            assert request is not None
        assert (request.vector[0] < -0.3) == backwards
        assert abs(request.vector[0]) < 0.05 or backwards
        assert request.vector[1:] == pytest.approx((0.0, 0.0), abs=0.05)


def test_an_unseen_target_is_flown_after_for_a_while_and_it_says_why_nothing_is_asked() -> None:
    camera, config = _camera(0.17), FollowConfig()
    steering = Steering(config, DepthConfig(), camera)
    box, pose = _seen(camera, 5.0, 0.0)
    vehicle = Vehicle(pose.ned_p_m, np.zeros(3), 0.0, 0.0)
    assert steering.step(S, None, pose, vehicle) is None and "not seen" in steering.why_not
    assert steering.step(2 * S, box, None, None) is None and "no vehicle state" in steering.why_not
    assert steering.step(3 * S, box, pose, vehicle) is not None and not steering.why_not
    later_ns = 3 * S + round(config.coast_s * S)
    assert steering.step(later_ns, None, pose, vehicle) is not None
    assert steering.step(later_ns + S // 10, None, pose, vehicle) is None and "for 2.1 s" in steering.why_not
    steering.reset()
    assert steering.step(later_ns + S // 5, None, pose, vehicle) is None


def _walking(steering: Steering, camera: Camera, speed_m_s: float, seconds: float) -> tuple[int, float]:
    """Show it somebody who walks away from a vehicle that stands; the last stamp, ns, and his distance then, m."""
    distance_m, t_ns = 5.0, S
    for _ in range(round(30 * seconds)):
        t_ns, distance_m = t_ns + S // 30, distance_m + speed_m_s / 30
        box, pose = _seen(camera, distance_m, 0.0)
        steering.step(t_ns, box, pose, Vehicle(pose.ned_p_m, np.zeros(3), 0.0, 0.0))
    return t_ns, distance_m


def test_who_goes_out_of_sight_is_not_flown_at_for_long_since_he_may_have_stopped() -> None:
    asked = []
    for memory_s in (0.5, 100.0):
        camera = _camera(0.17)
        steering = Steering(FollowConfig(unseen_memory_s=memory_s), DepthConfig(), camera)
        t_ns, _ = _walking(steering, camera, 2.0, 2.0)
        _, pose = _seen(camera, 5.0, 0.0)
        flown_m, vehicle = 0.0, np.array([2.0, 0.0, 0.0])
        for k in range(1, 60):
            place = pose.ned_p_m + np.array([flown_m, 0.0, 0.0])
            request = steering.step(t_ns + k * S // 30, None, pose, Vehicle(place, vehicle, 0.0, 0.0))
            assert request is not None
            vehicle = np.array([request.vector[0], 0.0, 0.0])
            flown_m += request.vector[0] / 30
        asked.append((flown_m, request.vector[0]))
    assert asked[0][0] < asked[1][0] - 1.0 and abs(asked[0][1]) < asked[1][1] / 2


def test_it_says_where_the_next_picture_should_show_the_target_whatever_the_nose_does() -> None:
    camera = _camera(0.17)
    steering = Steering(FollowConfig(), DepthConfig(), camera)
    assert steering.expected(S, _seen(camera, 5.0, 0.0)[1]) is None
    t_ns, distance_m = _walking(steering, camera, 1.0, 2.0)
    for pitch_rad in (-0.15, 0.0, 0.2):
        truth, pose = _seen(camera, distance_m + 1.0 / 30, pitch_rad)
        expected = steering.expected(t_ns + S // 30, pose)
        assert expected is not None
        box = expected.box
        off = [e + s / 2 - t - u / 2 for e, s, t, u in zip(box[:2], box[2:], truth[:2], truth[2:], strict=True)]
        assert math.hypot(*off) < 4.0 and box[3] == pytest.approx(truth[3], rel=0.1)
    behind = Pose(np.array([distance_m + 3.0, 0.0, -EYE_M]), quat_from_euler(0.0, 0.0, 0.0))
    assert steering.expected(t_ns + S // 30, behind) is None
    assert steering.expected(t_ns, None) is None
    assert steering.expected(t_ns + 3 * S, _seen(camera, distance_m, 0.0)[1]) is None, "away for too long"


def test_with_a_depth_camera_a_box_that_does_not_shrink_with_the_target_takes_nobody_nearer() -> None:
    camera = _camera(0.17)
    steering = Steering(FollowConfig(), DepthConfig(), camera)
    vehicle = Vehicle(np.zeros(3), np.zeros(3), 0.0, 0.0)
    for k in range(60):
        distance_m = 5.0 + k / 30
        box, pose = _seen(camera, distance_m, 0.0)
        large = _seen(camera, 5.0, 0.0)[0]
        kept = (box[0], box[1] + (box[3] - large[3]) / 2, *large[2:])
        steering.step(S + k * S // 30, kept, pose, vehicle, np.full((120, 160), distance_m))
    expected = steering.expected(S + 60 * S // 30, pose, np.zeros((120, 160)))
    assert expected is not None and expected.distance_m == pytest.approx(7.0, abs=0.15) and not expected.reach_m > 0.01
    assert expected.fitted(kept)[3] < 1.47 * box[3] < 0.98 * 1.47 * kept[3]
    passing = np.full((120, 160), 5.9)
    for k in range(60, 75):
        steering.step(S + k * S // 30, kept, pose, vehicle, passing)
    state = steering.expected(S + 75 * S // 30, pose)
    assert state is not None and state.distance_m > 6.2, "who passes before him does not tell how far he is"


def test_a_target_of_which_little_is_left_to_measure_counts_for_a_while_as_one_that_can_be_measured() -> None:
    camera = _camera(0.17)
    steering = Steering(FollowConfig(), DepthConfig(), camera)
    box, pose = _seen(camera, 5.0, 0.0)
    vehicle, whole = Vehicle(pose.ned_p_m, np.zeros(3), 0.0, 0.0), np.full((120, 160), 5.0)
    sliver = np.zeros((120, 160))
    sliver[:, 78:80] = 5.0
    measured = []
    for k, depth in enumerate([whole, *[sliver] * 40]):
        steering.step(S + k * S // 30, box, pose, vehicle, depth)
        expected = steering.expected(S + (k + 1) * S // 30, pose)
        assert expected is not None
        measured.append(expected.measured)
    assert measured == [True] * 30 + [False] * 11


def test_what_has_covered_the_target_is_remembered_where_it_is_until_he_is_seen_again() -> None:
    camera = _camera(0.17)
    steering = Steering(FollowConfig(), DepthConfig(), camera)
    box, pose = _seen(camera, 5.0, 0.0)
    vehicle = Vehicle(pose.ned_p_m, np.zeros(3), 0.0, 0.0)
    free, screen = np.full((120, 160), 5.0), np.full((120, 160), 3.8)
    for k in range(30):
        steering.step(S + k * S // 30, box, pose, vehicle, free)
    for k in range(30, 50):
        steering.step(S + k * S // 30, None, pose, vehicle, screen)
    nearer = Pose(pose.ned_p_m + np.array([0.5, 0.0, 0.0]), pose.ned_q_body)
    beside = steering.expected(S + 50 * S // 30, nearer, free)
    assert beside is not None and beside.covered_m == pytest.approx(3.8 - 0.5 * math.cos(0.17), abs=0.02)
    for k in range(50, 55):
        covered = steering.expected(S + k * S // 30, pose, free)
        assert covered is not None and not math.isnan(covered.covered_m), "one alone may be at the screen's edge"
        steering.step(S + k * S // 30, box, pose, vehicle, free, sure=k == 54)
    seen = steering.expected(S + 55 * S // 30, pose, free)
    assert seen is not None and math.isnan(seen.covered_m) and math.isnan(seen.before_m)


def test_one_tracker_alone_that_has_found_him_again_is_believed_after_a_while() -> None:
    camera = _camera(0.17)
    steering = Steering(FollowConfig(), DepthConfig(), camera)
    box, pose = _seen(camera, 5.0, 0.0)
    vehicle = Vehicle(pose.ned_p_m, np.zeros(3), 0.0, 0.0)
    for k in range(30):
        steering.step(S + k * S // 30, box, pose, vehicle)
    aside = (box[0] + 20.0, *box[1:])
    for k in range(60, 75):
        steering.step(S + k * S // 30, aside if k != 63 else None, pose, vehicle)
        expected = steering.expected(S + k * S // 30, pose)
        assert expected is not None
        assert (expected.box[0] > box[0] + 10.0) == (k >= 66), "a break of a picture is forgiven"


def test_above_a_target_that_is_out_of_sight_its_motion_goes_on() -> None:
    place = TargetPlace(FollowConfig(), faced=False)
    for k in range(60):
        place.measure(np.array([k / 30, 0.0, 0.0]), k * S // 30)
    state = place.at(59 * S // 30 + S)
    assert state is not None
    assert state.ned_p_m[0] == pytest.approx(59 / 30 + 1.0, abs=0.05) and state.ned_v_m_s[0] == pytest.approx(
        1, abs=0.05
    )


@pytest.mark.parametrize(("aside_m", "after_s"), [(0.3, 0.0), (1.2, 0.6)])
def test_a_box_that_steps_aside_faster_than_anybody_does_is_not_flown_after_until_it_has_stayed_there(
    aside_m: float, after_s: float
) -> None:
    camera = _camera(0.17)
    steering = Steering(FollowConfig(), DepthConfig(), camera)
    t_ns, distance_m = _walking(steering, camera, 0.0, 1.0)
    box, pose = _seen(camera, distance_m, 0.0)
    beside = (box[0] + 228.0 * aside_m / distance_m, *box[1:])
    turns = []
    for k in range(1, 45):
        request = steering.step(t_ns + k * S // 30, beside, pose, Vehicle(pose.ned_p_m, np.zeros(3), 0.0, 0.0))
        assert request is not None
        turns.append(request.yaw_rate_rad_s)
    followed_s = next(k for k, turn in enumerate(turns) if turn > 0.03) / 30
    assert after_s <= followed_s <= after_s + 0.2


@pytest.mark.parametrize(("sure", "from_s"), [(False, 1.15), (True, 0.4)])
def test_several_trackers_that_agree_where_he_cannot_be_are_flown_after_sooner(sure: bool, from_s: float) -> None:
    camera = _camera(0.17)
    steering = Steering(FollowConfig(), DepthConfig(), camera)
    t_ns, distance_m = _walking(steering, camera, 0.0, 1.0)
    box, pose = _seen(camera, distance_m, 0.0)
    beside = (box[0] + 228.0 * 2.8 / distance_m, *box[1:])
    vehicle = Vehicle(pose.ned_p_m, np.zeros(3), 0.0, 0.0)
    turns = []
    for k in range(1, 60):
        request = steering.step(t_ns + k * S // 30, beside, pose, vehicle, sure=sure)
        assert request is not None
        turns.append(request.yaw_rate_rad_s)
    followed_s = next(k for k, turn in enumerate(turns, 1) if turn > 0.03) / 30
    assert from_s <= followed_s <= from_s + 0.15


@pytest.mark.parametrize(("empty", "followed"), [(True, True), (False, False)])
def test_one_tracker_alone_is_flown_after_at_another_distance_once_his_place_is_seen_to_be_empty(
    empty: bool, followed: bool
) -> None:
    camera = _camera(0.17)
    steering = Steering(FollowConfig(), DepthConfig(), camera)
    (there, pose), (box, _) = _seen(camera, 5.0, 0.0), _seen(camera, 3.8, 0.0)
    beside = (box[0] + 60.0, *box[1:])
    depth = np.full((120, 160), 7.5)
    vehicle = Vehicle(pose.ned_p_m, np.zeros(3), 0.0, 0.0)
    turns = []
    for k in range(1, 45):
        seen = there if k < 30 else beside
        depth[:] = 7.5
        for (x, y, width, height), distance_m in ((seen, 5.0 if k < 30 else 3.8), (there, 5.0)):
            if seen == there or distance_m < 5.0 or not empty:
                depth[int(y / 2) : int((y + height) / 2), int(x / 2) : int((x + width) / 2)] = distance_m
        request = steering.step(k * S // 30, seen, pose, vehicle, depth)
        assert request is not None
        turns.append(request.yaw_rate_rad_s)
    assert max(turns[:40]) < 0.03
    assert (turns[-1] > 0.03) == followed


def test_a_box_at_the_feet_of_somebody_else_is_not_flown_after_since_nobody_sinks_into_the_floor() -> None:
    camera = _camera(0.17)
    steering = Steering(FollowConfig(), DepthConfig(), camera)
    t_ns, distance_m = _walking(steering, camera, 0.0, 1.0)
    box, pose = _seen(camera, distance_m, 0.0)
    before = steering.expected(t_ns, pose)
    low = (box[0], box[1] + 0.6 * box[3], *box[2:])
    for k in range(1, 10):
        steering.step(t_ns + k * S // 30, low, pose, Vehicle(pose.ned_p_m, np.zeros(3), 0.0, 0.0))
    after = steering.expected(t_ns + 10 * S // 30, pose)
    assert before is not None and after is not None and after.box == pytest.approx(before.box, abs=3.0)
