"""What holds for every rotation and every camera."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from common.geometry.camera import Camera, horizontal_tangents
from common.geometry.rotation import (
    as_quat,
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

components = st.floats(-1.0, 1.0)
angles = st.floats(-np.pi, np.pi)


@st.composite
def quaternions(draw: st.DrawFn) -> np.ndarray:
    """Any rotation."""
    q = np.array([draw(components) for _ in range(4)])
    norm = float(np.linalg.norm(q))
    assume(norm > 1e-3)
    return q / norm


@st.composite
def vectors(draw: st.DrawFn, limit: float = 100.0) -> np.ndarray:
    """Any vector."""
    return np.array([draw(st.floats(-limit, limit)) for _ in range(3)])


@st.composite
def cameras(draw: st.DrawFn) -> Camera:
    """A camera with the distortion of a common lens, mounted in any way."""
    small = st.floats(-0.05, 0.05)
    tiny = st.floats(-0.002, 0.002)
    focal = draw(st.floats(300.0, 900.0))
    return Camera(
        640,
        480,
        focal,
        focal * draw(st.floats(0.95, 1.05)),
        draw(st.floats(300.0, 340.0)),
        draw(st.floats(220.0, 260.0)),
        (draw(small), draw(small), draw(tiny), draw(tiny), 0.0),
        as_quat(draw(quaternions())),
        (0.0, 0.0, 0.0),
    )


def same_rotation(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether two quaternions turn alike (q and -q do)."""
    return bool(abs(abs(float(a @ b)) - 1.0) < 1e-9)


@given(quaternions(), vectors())
def test_rotations_invert_and_keep_length(q: np.ndarray, v: np.ndarray) -> None:
    turned = quat_rotate(q, v)

    assert quat_rotate(quat_conjugate(q), turned) == pytest.approx(v, abs=1e-9)
    assert np.linalg.norm(turned) == pytest.approx(np.linalg.norm(v), abs=1e-9)
    assert quat_multiply(q, quat_conjugate(q)) == pytest.approx((1, 0, 0, 0), abs=1e-12)


@given(quaternions(), quaternions(), vectors())
def test_product_is_composition(a: np.ndarray, b: np.ndarray, v: np.ndarray) -> None:
    assert quat_rotate(quat_multiply(a, b), v) == pytest.approx(quat_rotate(a, quat_rotate(b, v)), abs=1e-9)


@given(quaternions())
def test_matrix_is_a_rotation_and_leads_back(q: np.ndarray) -> None:
    matrix = quat_to_matrix(q)

    assert matrix @ matrix.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(matrix) == pytest.approx(1.0)
    assert same_rotation(matrix_to_quat(matrix), q)
    assert matrix_to_quat(matrix)[0] >= 0.0


@given(angles, st.floats(-1.5, 1.5), angles)
def test_euler_angles_come_back_away_from_the_pole(roll: float, pitch: float, yaw: float) -> None:
    back = euler_from_quat(quat_from_euler(roll, pitch, yaw))

    assert back[1] == pytest.approx(pitch, abs=1e-6)
    assert wrap_angle(back[0] - roll) == pytest.approx(0.0, abs=1e-6)
    assert wrap_angle(back[2] - yaw) == pytest.approx(0.0, abs=1e-6)


@given(quaternions(), quaternions(), st.floats(0.0, 1.0))
def test_slerp_lies_on_the_arc(a: np.ndarray, b: np.ndarray, fraction: float) -> None:
    dot = abs(float(a @ b))
    assume(dot > 1e-6)  # half a turn apart there are two shortest arcs
    middle = slerp(a, b, fraction)

    assert np.linalg.norm(middle) == pytest.approx(1.0)
    # arccos near one loses half the digits, hence the tolerance.
    whole = 2 * np.arccos(min(dot, 1.0))
    part = 2 * np.arccos(min(abs(float(a @ middle)), 1.0))
    assert part == pytest.approx(fraction * whole, abs=1e-6)


@given(vectors(limit=3.0))
def test_rotation_vector_turns_by_its_length_about_itself(vector: np.ndarray) -> None:
    q = quat_exp(vector)

    assert np.linalg.norm(q) == pytest.approx(1.0)
    assert quat_rotate(q, vector) == pytest.approx(vector, abs=1e-9), "the axis stays"
    assert quat_multiply(quat_exp(vector / 2), quat_exp(vector / 2)) == pytest.approx(q, abs=1e-12)


@given(st.floats(-1e4, 1e4))
def test_wrapped_angle_is_the_same_direction(angle: float) -> None:
    wrapped = wrap_angle(angle)

    assert -np.pi <= wrapped < np.pi + 1e-12
    assert (np.cos(wrapped), np.sin(wrapped)) == pytest.approx((np.cos(angle), np.sin(angle)), abs=1e-9)


@given(cameras(), st.floats(60.0, 580.0), st.floats(60.0, 420.0))
def test_projection_undoes_rays(camera: Camera, x: float, y: float) -> None:
    ray = camera.rays([(x, y)])

    assert ray[0, 2] == 1.0
    assert camera.project(ray * 7.3) == pytest.approx(np.array([(x, y)]), abs=1e-3)


@given(cameras(), quaternions(), st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(0.5, 50.0))
def test_tangents_do_not_depend_on_the_attitude(
    camera: Camera, ned_q_body: np.ndarray, north: float, east: float, height_m: float
) -> None:
    ned_point = height_m * np.array([north, east, 1.0])
    optical = quat_rotate(quat_conjugate(camera.body_q_camera), quat_rotate(quat_conjugate(ned_q_body), ned_point))

    tangents = horizontal_tangents(optical, camera.body_q_camera, ned_q_body)

    assert tangents == pytest.approx(np.array([(north, east)]), abs=1e-6)
