"""Rotations: quaternions (w, x, y, z), Hamilton, and Euler angles in the aerospace order (yaw, pitch, roll).

`a_q_b` turns a vector given in frame b into frame a; `a_q_c = quat_multiply(a_q_b, b_q_c)`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def wrap_angle(angle_rad: float) -> float:
    """Same angle in [-pi, pi), rad."""
    return float((angle_rad + np.pi) % (2.0 * np.pi) - np.pi)


def quat_multiply(a: ArrayLike, b: ArrayLike) -> Array:
    """Hamilton product of two quaternions, shape (4,)."""
    aw, ax, ay, az = (float(c) for c in np.asarray(a))
    bw, bx, by, bz = (float(c) for c in np.asarray(b))
    return np.array(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ]
    )


def quat_conjugate(q: ArrayLike) -> Array:
    """Inverse rotation of a unit quaternion, shape (4,)."""
    return np.asarray(q, dtype=float) * np.array([1.0, -1.0, -1.0, -1.0])


def quat_to_matrix(q: ArrayLike) -> Array:
    """Rotation matrix (3, 3) of a unit quaternion (4,)."""
    w, x, y, z = (float(c) for c in np.asarray(q))
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def quat_rotate(q: ArrayLike, vector: ArrayLike) -> Array:
    """Vectors (3,) or (N, 3) turned by a unit quaternion, same shape."""
    return np.asarray(vector, dtype=float) @ quat_to_matrix(q).T


def matrix_to_quat(matrix: ArrayLike) -> Array:
    """Unit quaternion (4,), w >= 0, of a rotation matrix (3, 3); Shepperd's method, DOI 10.2514/3.55767b."""
    r = np.asarray(matrix, dtype=float)
    diagonal = np.array([np.trace(r), r[0, 0], r[1, 1], r[2, 2]])
    largest = int(np.argmax(diagonal))
    if largest == 0:
        q = np.array([1.0 + diagonal[0], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    else:
        i = largest - 1
        j, k = (i + 1) % 3, (i + 2) % 3
        q = np.empty(4)
        q[0] = r[k, j] - r[j, k]
        q[1 + i] = 1.0 + r[i, i] - r[j, j] - r[k, k]
        q[1 + j] = r[j, i] + r[i, j]
        q[1 + k] = r[k, i] + r[i, k]
    q /= np.linalg.norm(q)
    return q if q[0] >= 0 else -q


def quat_from_euler(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Array:
    """Quaternion `ned_q_body` (4,) of roll, pitch and yaw, rad."""
    cr, sr = np.cos(roll_rad / 2), np.sin(roll_rad / 2)
    cp, sp = np.cos(pitch_rad / 2), np.sin(pitch_rad / 2)
    cy, sy = np.cos(yaw_rad / 2), np.sin(yaw_rad / 2)
    return np.array(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
    )


def euler_from_quat(ned_q_body: ArrayLike) -> tuple[float, float, float]:
    """Roll, pitch and yaw of an attitude, rad."""
    w, x, y, z = (float(c) for c in np.asarray(ned_q_body))
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0))
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return float(roll), float(pitch), float(yaw)


def quat_exp(rotation_vector_rad: ArrayLike) -> Array:
    """Quaternion (4,) of a rotation vector (3,), rad: the rotation after turning at constant rates."""
    vector = np.asarray(rotation_vector_rad, dtype=float)
    angle = float(np.linalg.norm(vector))
    # np.sinc(x) is sin(pi x)/(pi x): finite at zero.
    return np.concatenate(([np.cos(angle / 2)], vector * 0.5 * np.sinc(angle / (2 * np.pi))))


def slerp(q0: ArrayLike, q1: ArrayLike, fraction: float) -> Array:
    """Attitude between two unit quaternions along the shorter arc, shape (4,); fraction 0 gives q0, 1 gives q1."""
    a, b = np.asarray(q0, dtype=float), np.asarray(q1, dtype=float)
    dot = float(a @ b)
    if dot < 0:
        b, dot = -b, -dot
    angle = np.arccos(min(dot, 1.0))
    if angle < 1e-6:
        mixed = a + fraction * (b - a)
    else:
        mixed = (np.sin((1 - fraction) * angle) * a + np.sin(fraction * angle) * b) / np.sin(angle)
    return mixed / np.linalg.norm(mixed)


def as_quat(q: Sequence[float] | Array) -> tuple[float, float, float, float]:
    """Quaternion as the tuple that messages carry."""
    return (float(q[0]), float(q[1]), float(q[2]), float(q[3]))


def as_vec3(v: Sequence[float] | Array) -> tuple[float, float, float]:
    """Vector as the tuple that messages carry."""
    return (float(v[0]), float(v[1]), float(v[2]))
