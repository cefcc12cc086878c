"""Depth pictures: what is usable, and the cloud of points that they show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.geometry.camera import Camera

Floats = NDArray[np.float32]
Ints = NDArray[np.int32]

_LARGEST_M = 100.0
_FEWEST_POINTS = 200
_SPARSE = 8
"""Every so many rows and columns are looked at to judge a whole picture."""


class UnusableDepth(ValueError):
    """A depth picture that cannot be used; the text says what was got, what is expected and what to do."""


@dataclass(frozen=True)
class Cloud:
    """Points that a depth picture shows, in the optical frame."""

    points_m: Floats
    """(N, 3)."""
    pixels: Ints
    """(N, 2) column and row of each point in the depth picture."""
    stride: int
    """Every so many columns and rows were read."""
    focal_px: float
    """Mean focal length of the camera, px: at depth z neighbouring points are stride · z / focal_px apart."""

    def rows(self, rows: Ints) -> Cloud:
        """The cloud of some rows (M,)."""
        return Cloud(self.points_m[rows], self.pixels[rows], self.stride, self.focal_px)


@dataclass(frozen=True)
class RayTable:
    """Optical rays of every pixel of a depth camera, computed once."""

    camera: Camera
    """The depth camera."""
    rays: Floats
    """(H, W, 2) x/z and y/z of each pixel, distortion removed."""

    @classmethod
    def of(cls, camera: Camera) -> RayTable:
        """Table of a camera."""
        columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
        rays = camera.rays(np.column_stack((columns.ravel(), rows.ravel())))[:, :2]
        return cls(camera, rays.reshape(camera.height, camera.width, 2).astype(np.float32))

    @property
    def focal_px(self) -> float:
        """Mean of the two focal lengths, px."""
        return 0.5 * (self.camera.fx_px + self.camera.fy_px)

    def stride_for(self, depth_m: Floats, spacing_m: float, nearest_m: float, farthest_m: float) -> int:
        """Stride at which neighbouring points are about `spacing_m` apart at the median depth.

        Raises:
            UnusableDepth: too few depths between the bounds.
        """
        sparse = depth_m[::_SPARSE, ::_SPARSE]
        valid = sparse[(sparse > nearest_m) & (sparse < farthest_m)]
        if _SPARSE**2 * len(valid) < _FEWEST_POINTS:
            seen = sparse[sparse > 0]
            middle = f"; their median is {float(np.median(seen)):.3g} m: is the unit right?" if seen.size else ""
            raise UnusableDepth(
                f"depth picture: {len(valid)} of {sparse.size} sampled depths lie in {nearest_m} to {farthest_m} m, "
                f"expected a scene within the sensor's range{middle}"
            )
        return max(1, round(spacing_m * self.focal_px / float(np.median(valid))))

    def cloud(self, depth_m: Floats, stride: int, nearest_m: float, farthest_m: float) -> Cloud:
        """Points of every `stride`-th pixel whose depth lies between the bounds; holes (0 or NaN) are left out.

        Args:
            depth_m: (H, W) depth along the optical axis, m.
            stride: 1 for the full cloud.
            nearest_m: smallest depth, m.
            farthest_m: largest depth, m.

        Raises:
            UnusableDepth: fewer than 200 points are left of the full picture's worth.
        """
        start = stride // 2
        z = depth_m[start::stride, start::stride]
        rows, columns = np.nonzero((z > nearest_m) & (z < farthest_m))
        if len(rows) * stride * stride < _FEWEST_POINTS:
            raise UnusableDepth(
                f"depth picture: {len(rows)} usable depths, expected at least {_FEWEST_POINTS // stride**2 + 1} "
                f"between {nearest_m} and {farthest_m} m"
            )
        points = np.empty((len(rows), 3), np.float32)
        points[:, 2] = z[rows, columns]
        points[:, :2] = self.rays[start::stride, start::stride][rows, columns] * points[:, 2:]
        pixels = np.column_stack((columns, rows)).astype(np.int32) * stride + start
        return Cloud(points, pixels, stride, self.focal_px)


def metres(depth: NDArray, camera: Camera) -> Floats:
    """A depth picture (H, W) in metres, checked: 16-bit pictures hold millimetres, floats hold metres.

    Holes stay what they are, 0, NaN or infinity; `RayTable.cloud` leaves them out.

    Args:
        depth: (H, W); uint16 in mm, or float in m.
        camera: the depth camera.

    Raises:
        UnusableDepth: wrong shape or type, no depth at all, or a unit that cannot be.
    """
    expected = (camera.height, camera.width)
    if depth.shape != expected:
        raise UnusableDepth(f"depth picture: got shape {depth.shape}, expected {expected} as the calibration says")
    if depth.dtype == np.uint16:
        depth_m = depth.astype(np.float32) * np.float32(1e-3)
    elif depth.dtype in (np.float32, np.float64):
        depth_m = depth.astype(np.float32, copy=False)
    else:
        raise UnusableDepth(f"depth picture: got {depth.dtype}, expected uint16 (mm) or float32 (m)")
    sparse = depth_m[::_SPARSE, ::_SPARSE]
    seen = sparse[(sparse > 0) & (sparse < np.inf)]
    if not seen.size:
        raise UnusableDepth(
            f"depth picture: every depth is zero or NaN ({sparse.size} were looked at); expected a scene within the "
            "sensor's range: check that the sensor is on and not covered"
        )
    middle_m = float(np.median(seen))
    if middle_m > _LARGEST_M:
        raise UnusableDepth(
            f"depth picture: got a median of {middle_m:g} m, expected less than {_LARGEST_M:g}; floats are metres, "
            "divide millimetres by 1000 or send them as uint16"
        )
    return depth_m
