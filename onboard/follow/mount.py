"""How the camera's mount shakes: what pictures show of it beside what the vehicle knows of its own attitude.

An estimator knows the airframe, not a camera that swings against it. A target is then foreseen beside where it is
seen, and somebody else stands there. What shakes comes and goes several times a second; what the pictures show beside
that, by things of other distances, goes on evenly, and is left out.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from common.geometry.camera import Camera
from common.geometry.rotation import quat_conjugate, quat_multiply
from onboard.follow.sight import in_camera, in_ned, looks_ahead
from onboard.fusion.camera_motion import CameraMotion
from onboard.proximity.pose import Pose

Array = NDArray[np.float64]
_EVENLY_S = 0.25
"""Time constant with which what goes on evenly is learned, s."""
_MOST_RAD = 0.1
"""Greatest angle of a shaking mount, rad."""
_LONGEST_GAP_S = 0.2
"""Longest time between pictures for the one to tell of the other, s."""
_FAR_M = 8.0
"""How far the things are that the pictures show, where no depth is measured, m."""


class Mount:
    """Takes the shake of a camera that looks ahead out of the vehicle's attitude.

    Args:
        camera: calibration and mounting.
    """

    def __init__(self, camera: Camera):
        self._begin(camera)

    def calibrate(self, camera: Camera) -> None:
        """Take another calibration."""
        if camera != self._camera:
            self._begin(camera)

    def _begin(self, camera: Camera) -> None:
        self._camera = camera
        self._motion = CameraMotion()
        self._seen: tuple[int, Array, Pose] | None = None
        self._off_px = self._even_px = self._rate_px_s = np.zeros(2)

    def pose(self, frame: np.ndarray, t_ns: int, pose: Pose | None, depth_m: Array | None) -> Pose | None:
        """The vehicle's pose with the attitude that its camera had, as if it were mounted stiffly.

        Args:
            frame: the picture, (H, W, 3) uint8 BGR.
            t_ns: its stamp, ns.
            pose: the vehicle then; None while unknown.
            depth_m: depth picture that belongs to it, (h, w), m, 0 for none; None without a depth camera.
        """
        if not looks_ahead(self._camera):
            return pose
        place_px = self._motion.see(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY), t_ns)
        before, self._seen = self._seen, None if pose is None else (t_ns, place_px, pose)
        if pose is None or before is None or not 0 < t_ns - before[0] < _LONGEST_GAP_S * 1e9:
            self._off_px = self._even_px = self._rate_px_s = np.zeros(2)
            return pose
        told_px = self._told_px(before[2], pose, _middle_m(depth_m))
        return self._turned(pose, self._shake_px(place_px - before[1] - told_px, (t_ns - before[0]) * 1e-9))

    def _told_px(self, before: Pose, now: Pose, distance_m: float) -> Array:
        """How far what was in the middle of the last picture has moved, (2,), px, by the vehicle's own pose."""
        there = in_ned(self._camera, before, np.array([0.0, 0.0, distance_m]))
        seen = in_camera(self._camera, now, there)
        return np.array([self._camera.fx_px * seen[0], self._camera.fy_px * seen[1]]) / seen[2]

    def _shake_px(self, moved_px: Array, dt_s: float) -> Array:
        """How far off the picture is, (2,), px, of all that it has moved beside what was told, but for what is even."""
        keeps = math.exp(-dt_s / _EVENLY_S)
        self._off_px = self._off_px + moved_px
        foreseen = self._even_px + self._rate_px_s * dt_s
        wrong = self._off_px - foreseen
        self._even_px = foreseen + (1.0 - keeps**2) * wrong
        self._rate_px_s = self._rate_px_s + (1.0 - keeps) ** 2 / dt_s * wrong
        return self._off_px - self._even_px

    def _turned(self, pose: Pose, off_px: Array) -> Pose:
        """The pose of a vehicle whose picture shows all so far right and down, (2,), px."""
        right, down = np.clip(off_px / (self._camera.fx_px, self._camera.fy_px), -_MOST_RAD, _MOST_RAD).tolist()
        mount = self._camera.body_q_camera
        turn = quat_multiply(quat_multiply(mount, (1.0, down / 2, -right / 2, 0.0)), quat_conjugate(mount))
        q = quat_multiply(pose.ned_q_body, turn)
        return Pose(pose.ned_p_m, q / np.linalg.norm(q))


def _middle_m(depth_m: Array | None) -> float:
    """How far most of what a depth picture shows is, m."""
    known = np.zeros(0) if depth_m is None else depth_m[depth_m > 0.0]
    return float(np.median(known)) if len(known) else _FAR_M
