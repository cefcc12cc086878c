"""The chase law: geometry, signs, stability against a vehicle that answers as slowly as a real one."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

import numpy as np
import pytest

from common.geometry.camera import Camera
from common.geometry.config import CameraConfig
from common.geometry.rotation import quat_conjugate, quat_from_euler, quat_rotate
from ground.pursuit.config import PursuitConfig
from ground.pursuit.control import ChaseLaw
from ground.pursuit.view import Pose, View, look, pixel_of

CAMERA: Camera = CameraConfig().camera()
HALF_FIELD = math.atan(240 / 440)


def _pose(roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0, height_m: float = 5.0) -> Pose:
    return Pose(np.array([0.0, 0.0, -height_m]), np.zeros(3), quat_from_euler(roll, pitch, yaw))


def _pixel(pose: Pose, ned_m: tuple[float, float, float]) -> tuple[float, float]:
    body = quat_rotate(quat_conjugate(pose.ned_q_body), np.array(ned_m) - pose.ned_p_m)
    optical = quat_rotate(quat_conjugate(CAMERA.body_q_camera), body)
    x, y = CAMERA.project(optical)[0]
    return float(x), float(y)


@pytest.mark.parametrize("attitude", [(0.0, 0.0, 0.0), (0.2, -0.15, 0.0), (-0.1, 0.25, 2.0), (0.15, 0.1, -3.0)])
def test_attitude_does_not_move_the_target(attitude: tuple[float, float, float]) -> None:
    pose = _pose(*attitude)
    view = look(CAMERA, pose, _pixel(pose, (0.8, -0.5, 0.0)), 0.0, 0.0)
    assert view is not None
    assert view.relative_m == pytest.approx([0.8, -0.5], abs=1e-6)


@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.5])
def test_heading_of_the_target_is_the_vehicle_s_plus_its_rotation(yaw: float) -> None:
    view = look(CAMERA, _pose(yaw=yaw), (319.5, 239.5), 0.4, 0.0)
    assert view is not None
    assert math.remainder(view.heading_rad - yaw - 0.4, 2 * math.pi) == pytest.approx(0.0, abs=1e-6)


def test_no_view_near_the_ground_or_above_the_horizon() -> None:
    assert look(CAMERA, _pose(height_m=0.2), (320.0, 240.0), 0.0, 0.0) is None
    assert look(CAMERA, _pose(pitch=1.5), (320.0, 5.0), 0.0, 0.0) is None


def test_vehicle_flies_and_turns_towards_what_it_sees() -> None:
    law = ChaseLaw(PursuitConfig())
    wish = None
    for index in range(20):
        view = View(np.array([0.1, -0.2]), np.array([0.5, -1.0]), 0.6, HALF_FIELD)
        wish = law.follow(view, _pose(), index * 50_000_000, 0.05)
    assert wish is not None
    assert wish.ned_v_m_s[0] > 0.1
    assert wish.ned_v_m_s[1] < -0.2
    assert wish.yaw_rate_rad_s > 0.0


def test_start_is_gentle_when_the_target_is_at_the_edge() -> None:
    def first_speed(tangent: float) -> float:
        law = ChaseLaw(PursuitConfig())
        for index in range(10):
            wish = law.follow(
                View(np.array([tangent, 0.0]), np.array([5 * tangent, 0.0]), 0.0, HALF_FIELD),
                _pose(),
                index * 50_000_000,
                0.05,
            )
        return float(np.linalg.norm(wish.ned_v_m_s))

    assert first_speed(0.45) < 0.9 * first_speed(0.2)
    assert first_speed(0.45) <= PursuitConfig().acceleration_min_m_s2 * 0.5


def test_doubtful_orientation_leaves_the_heading_alone() -> None:
    law = ChaseLaw(PursuitConfig())
    view = View(np.zeros(2), np.zeros(2), 1.0, HALF_FIELD)
    assert law.follow(view, _pose(), 0, angle_std_rad=2.0).yaw_rate_rad_s == 0.0


def _fly_leaning(target: Callable[[float], tuple[float, float]], seconds: float, drag_1_s: float) -> np.ndarray:
    """Errors, m, of a chase in the orientation form: tilt by two lags after a dead time, wind, a slanted horizon."""
    config, rng = PursuitConfig(output="orientation"), np.random.default_rng(0)
    law = ChaseLaw(config)
    position, velocity, lagged, tilt = np.array(target(0.0)), np.zeros(2), np.zeros(2), np.zeros(2)
    commands: deque[np.ndarray] = deque([np.zeros(2)] * 11)
    slant, errors, command = np.array([0.05, -0.08]), [], np.zeros(2)
    for index in range(int(seconds * 100)):
        t_s = index / 100
        there = np.array(target(t_s))
        if index % 5 == 0:
            relative = there - position + rng.normal(0, 0.02, 2)
            north, east = tilt + slant
            attitude = quat_from_euler(math.atan(east / 9.80665), -math.atan(north / 9.80665), 0.0)
            pose = Pose(np.array([*position, -5.0]), np.array([*velocity, 0.0]), attitude)
            wish = law.follow(View(relative / 5, relative, 0.0, HALF_FIELD), pose, int(t_s * 1e9), 0.05)
            assert wish.ned_a_m_s2 is not None
            command = wish.ned_a_m_s2
        commands.append(command)
        lagged = lagged + (commands.popleft() - lagged) * 0.1
        tilt = tilt + (lagged - tilt) * 0.1
        velocity = velocity + (tilt - drag_1_s * (velocity - np.array([0.7, -0.7]))) * 0.01
        position = position + velocity * 0.01
        errors.append(np.linalg.norm(there - position))
    return np.array(errors)


@pytest.mark.parametrize("drag_1_s", [0.1, 1.0])
def test_the_orientation_form_hovers_in_wind_with_a_slanted_horizon(drag_1_s: float) -> None:
    assert _fly_leaning(lambda t_s: (0.0, 0.0), 30.0, drag_1_s)[1000:].max() < 0.1  # the paper: 10 cm


def test_the_orientation_form_keeps_closer_to_a_turning_car_than_the_velocity_form() -> None:
    def path(t_s: float) -> tuple[float, float]:
        return 5 * math.sin(0.21 * t_s), 5 * math.sin(0.42 * t_s + 0.5) / 2

    leaning, plain = _fly_leaning(path, 60.0, 0.1)[1000:], _fly(path, 60.0, (0.0, 1.2))[1000:]
    assert np.sqrt(np.mean(leaning**2)) < 0.6 * np.sqrt(np.mean(plain**2))
    assert leaning.max() < 0.3  # the paper's 30 cm


def _fly(
    target: Callable[[float], tuple[float, float]], seconds: float, start: tuple[float, float] = (0.0, 0.0)
) -> np.ndarray:
    """Errors, m, of a chase of a vehicle with dead time and a velocity loop as px4 in the loop has it."""
    law, rng = ChaseLaw(PursuitConfig()), np.random.default_rng(0)
    position, velocity, acceleration = np.array(start), np.zeros(2), np.zeros(2)
    commands: deque[np.ndarray] = deque([np.zeros(2)] * 6)  # 60 ms at 100 Hz
    integral, errors, command = np.zeros(2), [], np.zeros(2)
    for index in range(int(seconds * 100)):
        t_s = index / 100
        there = np.array(target(t_s))
        if index % 5 == 0:
            relative = there - position + rng.normal(0, 0.02, 2)
            pose = Pose(np.array([*position, -5.0]), np.array([*velocity, 0.0]), np.array([1.0, 0, 0, 0]))
            command = law.follow(View(relative / 5, relative, 0.0, HALF_FIELD), pose, int(t_s * 1e9), 0.05).ned_v_m_s
        commands.append(command)
        error = commands.popleft() - velocity
        integral += 0.4 * error * 0.01
        acceleration += (1.8 * error + integral - acceleration) * 0.01 / 0.28
        velocity = velocity + (acceleration - 0.1 * velocity) * 0.01
        position = position + velocity * 0.01
        errors.append(np.linalg.norm(there - position))
    return np.array(errors)


def test_hover_over_a_parked_car() -> None:
    errors = _fly(lambda t_s: (1.0, 0.5), 30.0)
    assert errors[1500:].max() < 0.1  # the paper: 10 cm


def test_car_at_one_and_a_half_metres_a_second_with_turns() -> None:
    # A square with rounded corners would do; a Lissajous figure turns all the time, at up to 1.5 m/s.
    errors = _fly(lambda t_s: (5 * math.sin(0.21 * t_s), 5 * math.sin(0.42 * t_s + 0.5) / 2), 90.0, (0.0, 1.2))
    assert np.sqrt(np.mean(errors[1000:] ** 2)) < 0.35


def test_lost_target_is_coasted_after_and_then_the_vehicle_stands() -> None:
    law = ChaseLaw(PursuitConfig(coast_s=1.0))
    position = np.zeros(3)
    t_ns = 0
    for index in range(60):
        t_ns = index * 50_000_000
        position = np.array([0.05 * index, 0.0, -5.0])
        pose = Pose(position, np.array([1.0, 0.0, 0.0]), np.array([1.0, 0, 0, 0]))
        law.follow(View(np.zeros(2), np.zeros(2), 0.0, HALF_FIELD), pose, t_ns, 0.05)
    pose = Pose(position, np.array([1.0, 0.0, 0.0]), np.array([1.0, 0, 0, 0]))
    assert law.coast(pose, t_ns + 100_000_000).ned_v_m_s[0] > 0.5
    for index in range(2, 80):
        wish = law.coast(pose, t_ns + index * 50_000_000)
    assert wish.ned_v_m_s == pytest.approx([0.0, 0.0], abs=1e-6)
    assert wish.yaw_rate_rad_s == 0.0


@pytest.mark.parametrize("attitude", [(0.0, 0.0, 0.0), (0.2, -0.1, 1.0)])
def test_hidden_target_is_expected_where_the_moved_vehicle_will_see_it(attitude: tuple[float, float, float]) -> None:
    law = ChaseLaw(PursuitConfig(target_height_m=0.0))
    for index in range(40):  # the target drives north at 1 m/s, the vehicle stands
        relative = np.array([0.05 * index - 1.0, 0.3])
        law.follow(View(relative / 5, relative, 0.2, HALF_FIELD), _pose(), index * 50_000_000, 0.05)
    pose = _pose(*attitude)
    expected = law.expected(CAMERA, pose, 39 * 50_000_000 + 500_000_000)
    assert expected is not None
    assert expected.center_px == pytest.approx(pixel_of(CAMERA, pose, np.array([1.45, 0.3, 0.0])), abs=6.0)
    assert expected.angle_rad == pytest.approx(0.2 - attitude[2], abs=1e-6)


def _climb_after(tangent: float, law: ChaseLaw, frames: int = 5) -> float:
    wish = None
    for index in range(frames):
        view = View(np.array([tangent, 0.0]), np.array([5 * tangent, 0.0]), 0.0, HALF_FIELD)
        wish = law.follow(view, _pose(), index * 50_000_000, 0.05)
    assert wish is not None
    return wish.climb_m_s


def test_target_near_the_edge_makes_the_vehicle_climb_and_one_in_the_middle_does_not() -> None:
    assert _climb_after(0.05, ChaseLaw(PursuitConfig())) == 0.0
    assert _climb_after(0.45, ChaseLaw(PursuitConfig())) > 0.5
    assert _climb_after(0.45, ChaseLaw(PursuitConfig(climb_m=0.0))) == 0.0


def test_vehicle_climbs_for_a_lost_target_and_comes_down_again() -> None:
    law = ChaseLaw(PursuitConfig(climb_after_s=0.5))
    _climb_after(0.05, law)
    assert law.coast(_pose(), 300_000_000).climb_m_s == 0.0
    for index in range(7, 20):
        wish = law.coast(_pose(), index * 50_000_000)
    assert wish.climb_m_s > 0.5
    view = View(np.zeros(2), np.zeros(2), 0.0, HALF_FIELD)
    assert law.follow(view, _pose(height_m=7.0), 1_050_000_000, 0.05).climb_m_s < -0.2
    assert law.follow(view, _pose(height_m=5.2), 1_100_000_000, 0.05).climb_m_s == 0.0


def test_expected_change_is_that_of_the_vehicle_s_motion() -> None:
    law = ChaseLaw(PursuitConfig(target_height_m=0.0))
    for index in range(20):
        law.follow(View(np.zeros(2), np.zeros(2), 0.0, HALF_FIELD), _pose(), index * 50_000_000, 0.05)
    expected = law.expected(CAMERA, _pose(pitch=0.1, height_m=6.0), 1_000_000_000)
    assert expected is not None
    assert math.hypot(*expected.moved_px) == pytest.approx(440 * math.tan(0.1), abs=2.0)
    assert expected.grown == pytest.approx(5.0 / 6.0)
