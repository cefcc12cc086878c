"""Where the target is, seen from the vehicle: pictures to metres with the attitude at capture time taken out."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.geometry.camera import Camera, horizontal_tangents
from common.geometry.rotation import quat_conjugate, quat_rotate

Array = NDArray[np.float64]
_NOSE_PX = 20.0
LEAST_HEIGHT_M = 0.3
"""Lower than this above the target, nothing is said of where it is, m."""


@dataclass(frozen=True)
class Pose:
    """The vehicle at a picture's capture time."""

    ned_p_m: Array
    """Position, NED, m, shape (3,)."""
    ned_v_m_s: Array
    """Velocity, NED, m/s, shape (3,)."""
    ned_q_body: Array
    """Attitude, (w, x, y, z), as well as it is known."""
    ned_q_level: Array | None = None
    """Attitude that the autopilot takes for its own and levels by; None: the same."""
    ned_a_m_s2: Array | None = None
    """Horizontal acceleration by the accelerometers, north and east, m/s², shape (2,); None when they are not told."""


@dataclass(frozen=True)
class View:
    """Where the target is, seen from the vehicle."""

    tangents: Array
    """North and east tangents of its ray in the level frame, shape (2,); metres per metre of height (eq. 7)."""
    relative_m: Array
    """North and east from vehicle to target, m, shape (2,)."""
    heading_rad: float
    """Heading of the target: of the rectangle's upper side, rad from north, clockwise."""
    half_field_rad: float
    """Angle from the middle of the picture to its nearest edge, rad."""
    reach_rad: float = 0.0
    """The same to the edge beyond the target, rad: the picture is wider than high."""

    def __post_init__(self) -> None:
        """Without a reach, that of the nearest edge."""
        if self.reach_rad == 0.0:
            object.__setattr__(self, "reach_rad", self.half_field_rad)


def look(
    camera: Camera, pose: Pose, centre_px: tuple[float, float], angle_rad: float, target_height_m: float
) -> View | None:
    """Target seen from the vehicle, with the attitude at capture time taken out (Teulière 2011, fig. 8).

    Args:
        camera: calibration and mounting.
        pose: vehicle at the picture's capture time.
        centre_px: target's centre in the picture.
        angle_rad: rotation of the target's rectangle in the picture; its upper side points where the target heads.
        target_height_m: height of the target's top above home, m.

    Returns:
        None when the vehicle is too low, or the ray does not meet the ground.
    """
    height_m = -float(pose.ned_p_m[2]) - target_height_m
    if height_m < LEAST_HEIGHT_M:
        return None
    arm_m = quat_rotate(pose.ned_q_body, camera.body_p_camera_m)
    nose_px = (centre_px[0] + _NOSE_PX * math.sin(angle_rad), centre_px[1] - _NOSE_PX * math.cos(angle_rad))
    tangents = horizontal_tangents(camera.rays([centre_px, nose_px]), camera.body_q_camera, pose.ned_q_body)
    if not np.isfinite(tangents).all():
        return None
    nose = tangents[1] - tangents[0]
    relative_m = arm_m[:2] + tangents[0] * (height_m - arm_m[2])
    heading_rad = math.atan2(nose[1], nose[0])
    return View(tangents[0], relative_m, heading_rad, _half_field_rad(camera), _reach_rad(camera, centre_px))


def pixel_of(camera: Camera, pose: Pose, ned_m: Array) -> tuple[float, float] | None:
    """Pixel of a point in NED, m; None when the camera looks away from it. The inverse of `look`."""
    body = quat_rotate(quat_conjugate(pose.ned_q_body), ned_m - pose.ned_p_m) - camera.body_p_camera_m
    x, y = camera.project(quat_rotate(quat_conjugate(camera.body_q_camera), body))[0]
    return (float(x), float(y)) if np.isfinite(x) else None


def off_axis_rad(view: View) -> float:
    """Angle between straight down and the target, rad."""
    return math.atan(float(np.linalg.norm(view.tangents)))


def _half_field_rad(camera: Camera) -> float:
    """Angle from the middle of the picture to its nearest edge, rad."""
    return math.atan(min(camera.height / camera.fy_px, camera.width / camera.fx_px) / 2)


def _reach_rad(camera: Camera, centre_px: tuple[float, float]) -> float:
    """Angle from the middle of the picture to its edge, on the way through a pixel, rad."""
    across, down = abs(centre_px[0] - camera.cx_px) / camera.fx_px, abs(centre_px[1] - camera.cy_px) / camera.fy_px
    off = math.hypot(across, down)
    if off == 0.0:
        return _half_field_rad(camera)
    most_across, most_down = camera.width / camera.fx_px / 2, camera.height / camera.fy_px / 2
    return math.atan(min(most_across * off / max(across, 1e-9), most_down * off / max(down, 1e-9)))
