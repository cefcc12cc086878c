"""Calibration of the cameras, in the vehicle file: `[camera.down]`."""

from __future__ import annotations

import math

from common.config import ConfigError, NonNegative, Positive, Section
from common.geometry.camera import Camera
from common.geometry.rotation import as_quat


class CameraConfig(Section, frozen=True, kw_only=True):
    """One camera: intrinsics, mounting, delay."""

    width: int = 640
    """Columns, px."""
    height: int = 480
    """Rows, px."""
    fx_px: Positive = 440.0
    """Focal length along columns, px."""
    fy_px: Positive = 440.0
    """Focal length along rows, px."""
    cx_px: float = 319.5
    """Principal point, column, px."""
    cy_px: float = 239.5
    """Principal point, row, px."""
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    """k1, k2, p1, p2, k3 (OpenCV order)."""
    body_q_camera: tuple[float, float, float, float] = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
    """Turns an optical vector (x right, y down, z forward) into FRD. The default looks down, picture's top forward."""
    body_p_camera_m: tuple[float, float, float] = (0.0, 0.0, 0.05)
    """Position in the body frame (FRD), m."""
    exposure_delay_ms: NonNegative = 0.0
    """How long before its stamp a picture was exposed, ms."""
    rate_hz: Positive = 20.0
    """Picture rate, Hz."""

    def check(self) -> None:
        """Refuse a mounting that is no rotation and a principal point outside the picture."""
        norm = math.hypot(*self.body_q_camera)
        if abs(norm - 1.0) > 1e-3:
            raise ConfigError(f"body_q_camera: got norm {norm:.4f}, expected a unit quaternion (w, x, y, z)")
        if not (0 <= self.cx_px < self.width and 0 <= self.cy_px < self.height):
            raise ConfigError(
                f"cx_px, cy_px: got ({self.cx_px}, {self.cy_px}), expected a point inside {self.width}x{self.height}"
            )

    def camera(self) -> Camera:
        """The camera that this section calibrates."""
        return Camera(
            self.width,
            self.height,
            self.fx_px,
            self.fy_px,
            self.cx_px,
            self.cy_px,
            self.distortion,
            as_quat(self.body_q_camera),
            self.body_p_camera_m,
            self.exposure_delay_ms,
            self.rate_hz,
        )


class CamerasConfig(Section, frozen=True, kw_only=True):
    """The cameras of the vehicle, by name."""

    down: CameraConfig = CameraConfig()
    """The camera that looks down."""
