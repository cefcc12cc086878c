"""Rotations and the camera, on cases that can be worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from common.config import ConfigError, build
from common.geometry.camera import Camera, horizontal_tangents
from common.geometry.config import CameraConfig
from common.geometry.rotation import (
    as_quat,
    as_vec3,
    euler_from_quat,
    matrix_to_quat,
    quat_conjugate,
    quat_exp,
    quat_from_euler,
    quat_multiply,
    quat_rotate,
    quat_to_matrix,
    slerp,
    wrap_angle,
)

NORTH, EAST, DOWN = np.eye(3)
RIGHT_ANGLE = math.pi / 2
LEVEL = (1.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("roll", "pitch", "yaw", "body", "ned"),
    [
        (0, 0, RIGHT_ANGLE, NORTH, EAST),  # heading east: forward is east
        (0, 0, RIGHT_ANGLE, EAST, -NORTH),  # and right is south
        (0, RIGHT_ANGLE, 0, NORTH, -DOWN),  # nose up: forward is up
        (RIGHT_ANGLE, 0, 0, EAST, DOWN),  # rolled right: the right wing points down
        (RIGHT_ANGLE, 0, 0, DOWN, -EAST),
    ],
)
def test_euler_angles_turn_as_in_aviation(
    roll: float, pitch: float, yaw: float, body: np.ndarray, ned: np.ndarray
) -> None:
    assert quat_rotate(quat_from_euler(roll, pitch, yaw), body) == pytest.approx(ned, abs=1e-12)


def test_product_applies_the_right_hand_rotation_first() -> None:
    yaw, roll = quat_from_euler(0, 0, RIGHT_ANGLE), quat_from_euler(RIGHT_ANGLE, 0, 0)

    assert quat_rotate(quat_multiply(yaw, roll), EAST) == pytest.approx(quat_rotate(yaw, quat_rotate(roll, EAST)))
    assert quat_multiply(yaw, roll) == pytest.approx(quat_from_euler(RIGHT_ANGLE, 0, RIGHT_ANGLE))


@pytest.mark.parametrize("axis", [NORTH, EAST, DOWN, (NORTH + EAST) / math.sqrt(2), (EAST - DOWN) / math.sqrt(2)])
def test_half_turns_survive_the_matrix(axis: np.ndarray) -> None:
    q = quat_exp(math.pi * axis)

    assert abs(matrix_to_quat(quat_to_matrix(q)) @ q) == pytest.approx(1.0)


def test_vectors_are_turned_one_by_one_or_as_rows() -> None:
    q = quat_from_euler(0.1, -0.2, 0.3)
    rows = np.arange(12.0).reshape(4, 3)

    turned = quat_rotate(q, rows)

    assert turned.shape == (4, 3)
    assert turned[2] == pytest.approx(quat_rotate(q, rows[2]))
    assert quat_rotate(quat_conjugate(q), turned) == pytest.approx(rows)


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [
        (0.0, 0.0),
        (math.pi, -math.pi),
        (-math.pi, -math.pi),
        (1.5 * math.pi, -0.5 * math.pi),
        (-7.0, -7.0 + 2 * math.pi),
    ],
)
def test_angles_are_wrapped_to_half_a_turn(angle: float, wrapped: float) -> None:
    assert wrap_angle(angle) == pytest.approx(wrapped)


def test_slerp_goes_the_short_way_at_constant_rate() -> None:
    start, end = quat_from_euler(0, 0, 0.2), quat_from_euler(0, 0, 1.0)

    for fraction, yaw in ((0.0, 0.2), (0.25, 0.4), (0.5, 0.6), (1.0, 1.0)):
        assert euler_from_quat(slerp(start, end, fraction))[2] == pytest.approx(yaw)
        assert euler_from_quat(slerp(start, -end, fraction))[2] == pytest.approx(yaw), "-q is the same attitude"
    assert slerp(start, start, 0.3) == pytest.approx(start)


def test_rotation_vector_of_nothing_is_no_rotation() -> None:
    assert quat_exp((0.0, 0.0, 0.0)) == pytest.approx(LEVEL)
    assert quat_exp((0.0, 0.0, 1e-9)) == pytest.approx((1.0, 0.0, 0.0, 5e-10))


def test_conversions_for_messages_are_plain_floats() -> None:
    assert as_quat(np.array([1, 0, 0, 0])) == LEVEL
    assert as_vec3(np.array([1, 2, 3])) == (1.0, 2.0, 3.0)
    assert {type(c) for c in (*as_quat(np.ones(4)), *as_vec3(np.ones(3)))} == {float}


# ---------------------------------------------------------------- the camera


def distorted() -> Camera:
    return build(CameraConfig, {"distortion": [-0.12, 0.05, 0.001, -0.0008, 0.01]}, "test").camera()


def test_default_camera_looks_down_with_the_picture_s_top_forward() -> None:
    q = CameraConfig().camera().body_q_camera

    assert quat_rotate(q, (0, 0, 1)) == pytest.approx((0, 0, 1)), "optical axis down"
    assert quat_rotate(q, (0, -1, 0)) == pytest.approx((1, 0, 0)), "up in the picture is forward"
    assert quat_rotate(q, (1, 0, 0)) == pytest.approx((0, 1, 0)), "right in the picture is right"


def test_projection_without_distortion_is_the_pinhole() -> None:
    camera = CameraConfig().camera()

    pixels = camera.project([(0, 0, 2), (1, 0, 2), (0, -1, 4)])

    assert pixels == pytest.approx(np.array([(319.5, 239.5), (319.5 + 220, 239.5), (319.5, 239.5 - 110)]))


def test_points_that_are_not_in_front_have_no_pixel() -> None:
    pixels = CameraConfig().camera().project([(0, 0, -1), (1, 1, 0), (0, 0, 1)])

    assert np.isnan(pixels[:2]).all()
    assert np.isfinite(pixels[2]).all()
    assert CameraConfig().camera().project(np.empty((0, 3))).shape == (0, 2)


def test_rays_undo_the_distortion() -> None:
    camera = distorted()
    points = np.array([(0.3, -0.2, 1.0), (-0.5, 0.4, 1.0), (0.0, 0.0, 1.0)])

    assert camera.rays(camera.project(points)) == pytest.approx(points, abs=1e-4)


def test_calibration_message_carries_everything() -> None:
    camera = distorted()
    info = camera.info("down")
    info.check()

    assert Camera.from_info(info) == camera
    assert info.camera == "down"


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"body_q_camera": [1, 1, 0, 0]}, "body_q_camera: got norm 1.4142"),
        ({"cx_px": 700.0}, "expected a point inside 640x480"),
        ({"fx_px": 0.0}, "fx_px"),
        ({"distortion": [0.0, 0.0]}, "distortion"),
    ],
)
def test_calibration_that_cannot_be_is_refused(table: dict, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        build(CameraConfig, table, "kite [camera.down]")


# ---------------------------------------------------------------- attitude compensation


@pytest.mark.parametrize("attitude", [(0, 0, 0), (0.3, 0, 0), (0, -0.3, 0), (0.2, 0.1, 2.0), (-0.1, 0.25, -1.0)])
def test_a_place_on_the_ground_keeps_its_tangents_at_any_attitude(attitude: tuple[float, float, float]) -> None:
    camera = distorted()
    ned_q_body = quat_from_euler(*attitude)
    height_m, north_m, east_m = 5.0, 1.2, -0.7
    body_point = quat_rotate(quat_conjugate(ned_q_body), (north_m, east_m, height_m))
    optical_point = quat_rotate(quat_conjugate(camera.body_q_camera), body_point)

    rays = camera.rays(camera.project(optical_point))

    tangents = horizontal_tangents(rays, camera.body_q_camera, ned_q_body)
    assert tangents == pytest.approx(np.array([(north_m / height_m, east_m / height_m)]), abs=1e-4)


def test_a_ray_that_meets_no_ground_has_no_tangents() -> None:
    camera = CameraConfig().camera()
    on_its_side = quat_from_euler(RIGHT_ANGLE, 0, 0)

    tangents = horizontal_tangents([(0, 0, 1), (-1, 0, 0.2), (1, 0, 0.2)], camera.body_q_camera, on_its_side)

    assert np.isnan(tangents[:2]).all(), "level, and above the horizon"
    assert np.isfinite(tangents[2]).all(), "what is right in the picture is down"
