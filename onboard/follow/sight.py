"""From the fused box to the target's place: the picture's geometry with the attitude at capture time taken out."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from common.geometry.camera import Camera, horizontal_tangents
from common.geometry.rotation import quat_conjugate, quat_multiply, quat_rotate
from common.tracking.base import Box, center_of
from onboard.follow.config import FollowConfig
from onboard.follow.law import TargetState
from onboard.fusion.config import DepthConfig
from onboard.fusion.depth import DepthFusion, size_ratio
from onboard.fusion.motion import MotionFilter
from onboard.proximity.pose import Pose

Array = NDArray[np.float64]
_LEAST_HEIGHT_M = 0.3
"""Least height above the target, or the ground, from which a ray says where it ends, m."""
_GRAVITY_M_S2 = 9.81
_LONGEST_GAP_S = 3.0
"""Time without a place after which what was known of the target's motion is forgotten, s."""
_START_M_S = 1.0
"""Standard deviation of the target's unknown velocity at the start, m/s: a walk."""
_LEVEL_AFTER_S = 0.1
"""For how long an unseen target that is faced may go on up or down, s: what covers it has moved its box so."""
_STEEP = 0.7
"""Down component of the optical axis, 45 degrees, from which on a camera looks more down than ahead."""
_MEASURED = 0.5
"""Least share of the target's pixels with a depth for the first distance to be the depth camera's."""
_LEAST_DOWN = 0.02
"""Least down component of the ray to the target's foot, whose z is 1, for it to meet the ground."""


def looks_ahead(camera: Camera) -> bool:
    """Whether the camera looks more ahead than down."""
    return float(quat_rotate(camera.body_q_camera, np.array([0.0, 0.0, 1.0]))[2]) < _STEEP


def whole_from_m(camera: Camera, box: Box, pose: Pose, level_m: float, acceleration_m_s2: float) -> float:
    """Level distance from which a target ahead stays whole in the picture while the vehicle brakes and speeds up, m.

    Both ends of the target keep their heights against the vehicle; nearer, they are seen steeper. What is left between
    them and the picture's edges must hold the tilt of an acceleration, or, in a narrow picture, half of the angle from
    the horizon to the edge.

    Args:
        camera: calibration and mounting.
        box: the target, px, somewhere in a picture.
        pose: the vehicle then.
        level_m: its level distance then, m.
        acceleration_m_s2: largest acceleration, m/s².
    """
    tilt_rad = math.atan(acceleration_m_s2 / _GRAVITY_M_S2)
    column, least_m = box[0] + box[2] / 2, 0.0
    # Downwards is positive for the lower end, upwards for the upper one.
    for sign, end_px, edge_px in ((1.0, box[1] + box[3], float(camera.height)), (-1.0, box[1], 0.0)):
        end, edge = camera.rays([(column, end_px), (camera.cx_px, edge_px)])
        ned = quat_rotate(pose.ned_q_body, quat_rotate(camera.body_q_camera, end))
        level = quat_rotate(camera.body_q_camera, edge)
        off_m = sign * level_m * float(ned[2]) / max(float(np.hypot(ned[0], ned[1])), 1e-6)
        edge_rad = math.atan2(sign * float(level[2]), float(level[0]))
        if off_m > 0.0 and edge_rad > 0.0:
            least_m = max(least_m, off_m / math.tan(max(edge_rad - tilt_rad, edge_rad / 2)))
    return least_m


def eye_of(camera: Camera, pose: Pose) -> Array:
    """Where the vehicle's camera is, (3,), NED, m."""
    return pose.ned_p_m + quat_rotate(pose.ned_q_body, np.array(camera.body_p_camera_m))


def in_camera(camera: Camera, pose: Pose, ned_p_m: Array) -> Array:
    """A place (3,), NED, m, in the optical frame of the vehicle's camera, (3,), m; its z is along the optical axis."""
    turn = quat_conjugate(quat_multiply(pose.ned_q_body, camera.body_q_camera))
    return quat_rotate(turn, ned_p_m - eye_of(camera, pose))


def in_ned(camera: Camera, pose: Pose, camera_p_m: Array) -> Array:
    """The place (3,), NED, m, of one in the optical frame of the vehicle's camera, (3,), m."""
    turned = quat_rotate(pose.ned_q_body, quat_rotate(camera.body_q_camera, camera_p_m))
    return eye_of(camera, pose) + turned


class Sight:
    """Place of the target from box, pose and, for a camera that looks ahead, distance.

    Args:
        camera: calibration and mounting.
        config: how high the target is, how far it is at the start.
        depth: of the distance.
    """

    def __init__(self, camera: Camera, config: FollowConfig, depth: DepthConfig):
        self.ahead = looks_ahead(camera)
        """Whether the target is faced, instead of flown above."""
        self._camera = camera
        self._config = config
        image_px = (float(camera.width), float(camera.height))
        self._scale = DepthFusion(depth, image_px)
        self._image_px = image_px
        self.why_not = ""
        """Why the last place is missing."""

    def place(self, t_ns: int, box: Box, pose: Pose, depth_m: Array | None = None) -> Array | None:
        """Place (3,) of the target, NED, m; None, and `why_not`, where the picture does not tell.

        Args:
            t_ns: capture stamp, ns.
            box: x, y, width, height, px.
            pose: the vehicle then.
            depth_m: depth inside the box, (h, w), m, 0 for none; None without a depth camera.
        """
        centre = center_of(box)
        eye = eye_of(self._camera, pose)
        if self.ahead:
            return self._faced(t_ns, box, centre, eye, pose, depth_m)
        return self._below(t_ns, box, centre, eye, pose)

    def _below(self, t_ns: int, box: Box, centre: tuple[float, float], eye: Array, pose: Pose) -> Array | None:
        """Where the ray meets the height of the target's top; with `scale`, as far down as its size says."""
        height_m = -float(eye[2]) - self._config.target_height_m
        if height_m < _LEAST_HEIGHT_M:
            self.why_not = f"too low to look, {height_m:.1f} m above the target"
            return None
        tangents = horizontal_tangents(self._camera.rays([centre]), self._camera.body_q_camera, pose.ned_q_body)[0]
        if not np.isfinite(tangents).all():
            self.why_not = "tilted too far to look"
            return None
        drop_m = height_m
        if self._config.height == "scale":
            if self._scale.scale_m is None:
                self._scale.scale_m = height_m / size_ratio((box[2], box[3]), self._image_px)
            estimate = self._scale.update(t_ns, centre, (box[2], box[3]), None)
            drop_m = height_m if estimate is None else float(estimate.position[2])
        return eye + np.array([*(tangents * height_m), drop_m])

    def _faced(
        self, t_ns: int, box: Box, centre: tuple[float, float], eye: Array, pose: Pose, depth_m: Array | None
    ) -> Array | None:
        """Along the ray as far as depth camera and size say."""
        if self._scale.scale_m is None and (first_m := self._first_distance(box, eye, pose, depth_m)) is not None:
            self._scale.scale_m = first_m / size_ratio((box[2], box[3]), self._image_px)
        estimate = self._scale.update(t_ns, centre, (box[2], box[3]), depth_m)
        if estimate is None or not math.isfinite(float(estimate.position[2])):
            self.why_not = "no distance: no depth, and the target's foot is above the horizon; set follow.distance_m"
            return None
        return in_ned(self._camera, pose, self._camera.rays([centre])[0] * float(estimate.position[2]))

    def _first_distance(self, box: Box, eye: Array, pose: Pose, depth_m: Array | None) -> float | None:
        """Distance along the optical axis at the start, m, where the depth camera does not give it."""
        if self._config.distance_m > 0.0:
            return self._config.distance_m
        if depth_m is not None and depth_m.size and float((depth_m > 0).mean()) > _MEASURED:
            return None  # measured: the first depth itself teaches the scale
        foot = self._camera.rays([(box[0] + box[2] / 2, box[1] + box[3])])[0]
        ned = quat_rotate(pose.ned_q_body, quat_rotate(self._camera.body_q_camera, foot))
        if ned[2] < _LEAST_DOWN or eye[2] >= -_LEAST_HEIGHT_M:
            return None
        return -float(eye[2]) / float(ned[2])  # the ray has z = 1 along the axis


class TargetPlace:
    """Place and velocity of the target from its measured places: a Kalman filter with real Δt.

    Args:
        config: noise, and for how long the velocity of an unseen target is believed.
        faced: whether it is faced and not flown above: then it is flown at, and its velocity is believed ever less.
    """

    def __init__(self, config: FollowConfig, faced: bool):
        self._density = np.full(3, config.process_m_s2**2)
        self._variance = np.full(3, config.measurement_m**2)
        self._faced = faced
        self._memory_s = config.unseen_memory_s if faced else math.inf
        self._filter: MotionFilter | None = None

    def reset(self) -> None:
        """Forget the target."""
        self._filter = None

    def measure(self, ned_p_m: Array, t_ns: int) -> None:
        """Take in a place (3,), NED, m, of a time, ns; one from before the last is ignored."""
        known = self._filter
        if known is not None and t_ns < known.t_ns:
            return
        if known is None or t_ns - known.t_ns > _LONGEST_GAP_S * 1e9:
            self._filter = MotionFilter(ned_p_m, t_ns, np.sqrt(self._variance), np.full(3, _START_M_S))
            return
        known.predict(t_ns, self._density)
        known.update(ned_p_m, self._variance)

    def at(self, t_ns: int) -> TargetState | None:
        """State at a time, ns, at or after the last measurement; None without any."""
        if self._filter is None:
            return None
        away_s = (t_ns - self._filter.t_ns) * 1e-9
        left = math.exp(-away_s / self._memory_s)
        way_s = away_s if math.isinf(self._memory_s) else self._memory_s * (1.0 - left)
        rate = self._filter.rate.copy()
        if self._faced and away_s > _LEVEL_AFTER_S:
            rate[2] = 0.0
        return TargetState(self._filter.value + way_s * rate, left * rate)
