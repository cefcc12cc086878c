"""Pinhole camera with Brown-Conrady distortion, mounted on a body: projection, rays, attitude compensation.

Camera optical frame: x right, y down, z forward (OpenCV).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import ArrayLike

from common.geometry.rotation import Array, quat_rotate
from common.messages import CameraInfo, Quat, Vec3

# OpenCV's own five iterations leave 0.02 px at the corners of a 640x480 picture; these leave nothing, for 1 us more.
_UNDISTORT = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 20, 1e-8)


@dataclass(frozen=True)
class Camera:
    """Calibration of one camera."""

    width: int
    """Columns, px."""
    height: int
    """Rows, px."""
    fx_px: float
    """Focal length along columns, px."""
    fy_px: float
    """Focal length along rows, px."""
    cx_px: float
    """Principal point, column, px."""
    cy_px: float
    """Principal point, row, px."""
    distortion: tuple[float, float, float, float, float]
    """k1, k2, p1, p2, k3 (OpenCV order)."""
    body_q_camera: Quat
    """Turns an optical vector into the body frame."""
    body_p_camera_m: Vec3
    """Position in the body frame, m."""
    exposure_delay_ms: float = 0.0
    """How long before its stamp a picture was exposed, ms."""
    rate_hz: float = 20.0
    """Nominal picture rate, Hz."""

    @classmethod
    def from_info(cls, info: CameraInfo) -> Camera:
        """Camera of a calibration message."""
        return cls(
            info.width,
            info.height,
            info.fx_px,
            info.fy_px,
            info.cx_px,
            info.cy_px,
            info.distortion,
            info.body_q_camera,
            info.body_p_camera_m,
            info.exposure_delay_ms,
            info.rate_hz,
        )

    def info(self, name: str) -> CameraInfo:
        """Calibration message of this camera."""
        return CameraInfo(
            camera=name,
            width=self.width,
            height=self.height,
            fx_px=self.fx_px,
            fy_px=self.fy_px,
            cx_px=self.cx_px,
            cy_px=self.cy_px,
            distortion=self.distortion,
            body_q_camera=self.body_q_camera,
            body_p_camera_m=self.body_p_camera_m,
            exposure_delay_ms=self.exposure_delay_ms,
            rate_hz=self.rate_hz,
        )

    def resized(self, width: int, height: int) -> Camera:
        """The calibration for pictures of another size, px, as a resize of the calibrated ones would give."""
        sx, sy = width / self.width, height / self.height
        if (sx, sy) == (1.0, 1.0):
            return self
        return replace(
            self,
            width=width,
            height=height,
            fx_px=self.fx_px * sx,
            fy_px=self.fy_px * sy,
            cx_px=(self.cx_px + 0.5) * sx - 0.5,
            cy_px=(self.cy_px + 0.5) * sy - 0.5,
        )

    @property
    def matrix(self) -> Array:
        """Intrinsic matrix (3, 3), px."""
        return np.array([[self.fx_px, 0.0, self.cx_px], [0.0, self.fy_px, self.cy_px], [0.0, 0.0, 1.0]])

    def project(self, camera_points_m: ArrayLike) -> Array:
        """Pixels (N, 2) of points (N, 3) in the optical frame, m; NaN for points that are not in front."""
        points = np.asarray(camera_points_m, dtype=float).reshape(-1, 3)
        pixels: Array = np.full((len(points), 2), np.nan)
        front = points[:, 2] > 1e-6
        if front.any():
            projected, _ = cv2.projectPoints(
                points[front], np.zeros(3), np.zeros(3), self.matrix, np.array(self.distortion)
            )
            pixels[front] = projected.reshape(-1, 2)
        return pixels

    def rays(self, pixels: ArrayLike) -> Array:
        """Optical rays (N, 3) with z = 1 through pixels (N, 2), distortion removed."""
        points = np.asarray(pixels, dtype=float).reshape(-1, 1, 2)
        normalised = cv2.undistortPoints(points, self.matrix, np.array(self.distortion), criteria=_UNDISTORT).reshape(
            -1, 2
        )
        return np.column_stack((normalised, np.ones(len(normalised)))).astype(np.float64)


@dataclass(frozen=True)
class DepthCamera:
    """Calibration of a depth sensor: depth is measured along its optical axis (z), not along the ray."""

    camera: Camera
    """Intrinsics, mounting, delay and rate of the depth picture."""
    range_min_m: float
    """Smallest depth that it measures, m."""
    range_max_m: float
    """Largest depth that it measures, m."""


def horizontal_tangents(rays: ArrayLike, body_q_camera: ArrayLike, ned_q_body: ArrayLike) -> Array:
    """Rays in the level frame below the vehicle, as (north, east) tangents (N, 2): metres per metre of height.

    This removes what the vehicle's attitude adds to the picture: Teulière 2011, fig. 8, frame F_p.

    Args:
        rays: (N, 3) in the optical frame.
        body_q_camera: mounting of the camera.
        ned_q_body: attitude at the picture's capture time.

    Returns:
        Tangents; NaN for a ray that does not point below the horizon.
    """
    ned = quat_rotate(ned_q_body, quat_rotate(body_q_camera, np.asarray(rays, dtype=float).reshape(-1, 3)))
    down = np.where(ned[:, 2] > 1e-3, ned[:, 2], np.nan)
    return ned[:, :2] / down[:, None]
