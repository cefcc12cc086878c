"""Which target is shown on the ground, and where it stands there by its place in the picture; what a click into the 3-D
view means."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from common.geometry.camera import Camera, horizontal_tangents
from common.geometry.rotation import Array, euler_from_quat, quat_multiply, quat_rotate, quat_to_matrix
from common.messages import Track, VehicleState
from ground.console.overlay import BLUE, GREEN, Colour
from ground.console.snapshot import FOLLOWED, MEMBERS, PURSUIT_CAMERA, TRACK, Snapshot


class Aim(NamedTuple):
    """The target that is shown on the ground."""

    track: Track
    """Where it is in the picture."""
    capture_ns: int
    """Capture stamp of that picture (vehicle clock)."""
    word: str
    """What it is called."""
    seen_colour: Colour
    """Its colour while it is seen."""


def aimed_at(view: Snapshot) -> Aim | None:
    """The chase's target, or the follower's where helm obeys that or nothing is chased; None without either.

    Of the follower's, where it follows by the camera that looks down: through another one, a box's middle is no place
    on the ground.
    """
    chased = view.track if view.fresh(TRACK) else None
    followed = view.followed if view.fresh(FOLLOWED) and view.fresh(MEMBERS) else None
    if view.members is None or view.members.camera != PURSUIT_CAMERA:
        followed = None
    idle = chased is None or chased.state == "idle"
    if followed is not None and followed.state != "idle" and (view.following or idle):
        return Aim(followed, view.followed_capture_ns, "followed", BLUE)
    return None if chased is None or idle else Aim(chased, view.track_capture_ns, "target", GREEN)


def camera_position_m(camera: Camera, state: VehicleState) -> Array:
    """Position (3,) of the camera, NED, m."""
    return np.asarray(state.ned_p_m) + quat_rotate(state.ned_q_body, camera.body_p_camera_m)


def ground_point_m(track: Track, camera: Camera, state: VehicleState) -> Array | None:
    """Point (3,), NED, m, at which the ray through the target's centre meets level ground at home's height.

    Args:
        track: the target in the picture.
        camera: calibration of that camera.
        state: of the vehicle at the picture's capture time.

    Returns:
        None for an idle track, a camera on or below that ground, and a ray that does not point down.
    """
    eye = camera_position_m(camera, state)
    height_m = -float(eye[2])
    if track.state == "idle" or height_m <= 0.0:
        return None
    tangents = horizontal_tangents(camera.rays([[track.x_px, track.y_px]]), camera.body_q_camera, state.ned_q_body)[0]
    if not np.isfinite(tangents).all():
        return None
    return np.array([eye[0] + height_m * tangents[0], eye[1] + height_m * tangents[1], 0.0])


def bearing_rad(camera: Camera, state: VehicleState, x_px: float, y_px: float) -> float:
    """Direction of a place in the picture, rad from the vehicle's heading, clockwise, -pi to pi.

    Args:
        camera: calibration of that camera.
        state: of the vehicle at the picture's capture time.
        x_px: column, px.
        y_px: row, px.
    """
    ned = quat_rotate(state.ned_q_body, quat_rotate(camera.body_q_camera, camera.rays([[x_px, y_px]])))[0]
    return math.remainder(math.atan2(ned[1], ned[0]) - euler_from_quat(state.ned_q_body)[2], math.tau)


def pixels_of(ned_points_m: ArrayLike, camera: Camera, state: VehicleState) -> Array:
    """Places (N, 2) in the picture, px, of points (N, 3), NED, m; NaN for those behind the camera.

    Args:
        ned_points_m: the points.
        camera: calibration of that camera.
        state: of the vehicle at the picture's capture time.
    """
    turn = quat_to_matrix(quat_multiply(state.ned_q_body, camera.body_q_camera))
    return camera.project((np.asarray(ned_points_m, dtype=float) - camera_position_m(camera, state)) @ turn)


def point_on_ray(points_m: Sequence[Array], origin_m: Array, direction: Array, within_m: float = 0.4) -> Array | None:
    """The point (3,) that a ray passes nearest to, m; None when it passes all of them by, or they lie behind it.

    Args:
        points_m: candidates (3,), m.
        origin_m: where the ray begins (3,), m.
        direction: its direction (3,), not zero.
        within_m: how far a point may lie off the ray, m.
    """
    unit = direction / np.linalg.norm(direction)
    best, best_m = None, within_m
    for point in points_m:
        offset = point - origin_m
        along = float(offset @ unit)
        off_m = float(np.linalg.norm(offset - along * unit))
        if along > 0.0 and off_m <= best_m:
            best, best_m = point, off_m
    return best
