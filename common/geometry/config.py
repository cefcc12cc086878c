"""Calibration of the cameras, in the vehicle file: `[camera.down]`, `[camera.front]`, `[camera.front.depth]`."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated

import msgspec

from common.config import ConfigError, NonNegative, Positive, Section
from common.geometry.camera import Camera, DepthCamera
from common.geometry.rotation import as_quat, as_vec3, quat_multiply, quat_rotate
from common.topics import CAMERAS

_Size = Annotated[int, msgspec.Meta(ge=1, le=16384)]
_FARTHEST_M = 65.0
"""Depth travels in 16-bit millimetres."""


class DepthConfig(Section, frozen=True, kw_only=True):
    """The depth part of a camera: its picture is aligned to the colour picture, or has a calibration of its own."""

    aligned: bool = True
    """Whether the depth picture shows what the colour picture shows, at the same or another size (the sensor or its
    driver registers it). Otherwise the intrinsics below and the mounting relative to the colour camera count."""
    width: _Size | None = None
    """Columns, px; None takes those of the colour picture."""
    height: _Size | None = None
    """Rows, px; None takes those of the colour picture."""
    fx_px: Positive | None = None
    """Focal length along columns, px (not aligned)."""
    fy_px: Positive | None = None
    """Focal length along rows, px (not aligned)."""
    cx_px: float | None = None
    """Principal point, column, px (not aligned)."""
    cy_px: float | None = None
    """Principal point, row, px (not aligned)."""
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    """k1, k2, p1, p2, k3 (OpenCV order; not aligned)."""
    camera_q_depth: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    """Turns a vector of the depth sensor's optical frame into the colour camera's (not aligned)."""
    camera_p_depth_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Position of the depth sensor in the colour camera's optical frame, m (not aligned)."""
    range_min_m: Positive = 0.3
    """Smallest depth that is measured, m: nearer things give none."""
    range_max_m: Annotated[float, msgspec.Meta(gt=0, le=_FARTHEST_M)] = 8.0
    """Largest depth that is measured, m (Kinect v2: 8 m outdoors, Al-Kaff 2019, section 4)."""
    rate_hz: Positive | None = None
    """Depth pictures a second, Hz; None takes the colour pictures' rate."""

    def check(self) -> None:
        """Refuse an empty range, a calibration beside `aligned`, and a lack of one without it."""
        if self.range_min_m >= self.range_max_m:
            raise ConfigError(
                f"range_min_m: got {self.range_min_m}, expected less than range_max_m = {self.range_max_m}"
            )
        own = {name: getattr(self, name) for name in ("fx_px", "fy_px", "cx_px", "cy_px")}
        if self.aligned:
            own |= {"distortion": any(self.distortion) or None, "camera_p_depth_m": any(self.camera_p_depth_m) or None}
            own["camera_q_depth"] = any(self.camera_q_depth[1:]) or None
            given = [name for name, value in own.items() if value is not None]
            if given:
                raise ConfigError(
                    f"{', '.join(given)}: got a calibration of the depth sensor's own, which `aligned = true` rules "
                    "out; set aligned = false, or remove it"
                )
            return
        missing = [name for name in (*own, "width", "height") if getattr(self, name) is None]
        if missing:
            raise ConfigError(f"{', '.join(missing)}: got nothing, expected a value as `aligned` is false")
        norm = math.hypot(*self.camera_q_depth)
        if abs(norm - 1.0) > 1e-3:
            raise ConfigError(f"camera_q_depth: got norm {norm:.4f}, expected a unit quaternion (w, x, y, z)")

    def of(self, colour: Camera) -> DepthCamera:
        """The depth sensor beside a colour camera."""
        rate_hz = self.rate_hz or colour.rate_hz
        width, height = self.width or colour.width, self.height or colour.height
        if self.aligned or self.fx_px is None or self.fy_px is None or self.cx_px is None or self.cy_px is None:
            camera = replace(colour.resized(width, height), rate_hz=rate_hz)
            return DepthCamera(camera, self.range_min_m, self.range_max_m)
        offset = quat_rotate(colour.body_q_camera, self.camera_p_depth_m)
        camera = Camera(
            width,
            height,
            self.fx_px,
            self.fy_px,
            self.cx_px,
            self.cy_px,
            self.distortion,
            as_quat(quat_multiply(colour.body_q_camera, self.camera_q_depth)),
            as_vec3(offset + colour.body_p_camera_m),
            colour.exposure_delay_ms,
            rate_hz,
        )
        return DepthCamera(camera, self.range_min_m, self.range_max_m)


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
    depth: DepthConfig | None = None
    """Its depth part; None without one."""

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

    def depth_camera(self) -> DepthCamera | None:
        """The depth sensor that this section calibrates; None without one."""
        return None if self.depth is None else self.depth.of(self.camera())


class FrontCameraConfig(CameraConfig, frozen=True, kw_only=True):
    """The camera that looks forward: as any other, mounted differently by default."""

    body_q_camera: tuple[float, float, float, float] = (0.5, 0.5, 0.5, 0.5)
    """Turns an optical vector (x right, y down, z forward) into FRD. The default looks forward, picture's top up."""
    body_p_camera_m: tuple[float, float, float] = (0.1, 0.0, 0.0)
    """Position in the body frame (FRD), m."""


class CamerasConfig(Section, frozen=True, kw_only=True):
    """The cameras of the vehicle, by name: those of `common.topics.CAMERAS`."""

    down: CameraConfig = CameraConfig()
    """The camera that looks down."""
    front: FrontCameraConfig | None = None
    """The camera that looks forward; None without one."""

    def by_name(self) -> dict[str, CameraConfig]:
        """Every camera that the vehicle has."""
        found = {name: getattr(self, name) for name in CAMERAS}
        return {name: camera for name, camera in found.items() if camera is not None}
