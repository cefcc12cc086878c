"""What a depth camera beside the colour one reads in the hall: floor, walls and what stands there, with its errors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.follow_scene import Array, Hall, Lens, Thing, camera, silhouette
from common.geometry.camera import DepthCamera
from simulation.world.depth_config import DepthNoiseConfig
from simulation.world.depth_noise import DepthNoise

_RANGE_M = (0.3, 8.0)
"""Least and largest depth that it reads, m: that of the vehicle `heron`."""
_NOISE = DepthNoiseConfig(noise_m=0.004, noise_per_m=0.0008, edge_m=0.2, flying=0.3, edge_holes=0.2, holes=0.03)
"""A Kinect v2 outdoors, as in the scenarios."""


class DepthEye:
    """A depth camera of half the size, registered to a colour camera, as the vehicle `heron` has.

    Args:
        size_px: width and height of the colour picture.
        field_rad: horizontal field of view of both.
        down_rad: by how much both look below the nose.
        seed: of its noise.
    """

    def __init__(self, size_px: tuple[int, int], field_rad: float, down_rad: float, seed: int):
        width, height = size_px[0] // 2, size_px[1] // 2
        self._camera = camera(width, height, field_rad, down_rad=down_rad)
        sensor = DepthCamera(self._camera, *_RANGE_M)
        self._noise = DepthNoise(_NOISE, sensor, np.random.default_rng((seed, 33)))
        columns, rows = np.meshgrid(np.arange(width), np.arange(height))
        u = (columns - self._camera.cx_px) / self._camera.fx_px
        v = (rows - self._camera.cy_px) / self._camera.fy_px
        self._rays = np.stack([u, v, np.ones_like(u)], axis=-1)

    def picture(self, hall: Hall, lens: Lens, things: Sequence[Thing]) -> Array:
        """Depth along the optical axis, (h, w), m, 0 where it reads none.

        Args:
            hall: walls, floor and ceiling.
            lens: the colour camera.
            things: what stands there; each is as far as its axis.
        """
        lens = lens._replace(camera=self._camera)
        ned = self._rays @ lens.axes()
        low = np.array([-hall.half_m[0], -hall.half_m[1], -hall.half_m[2]])
        high = np.array([hall.half_m[0], hall.half_m[1], 0.0])
        with np.errstate(divide="ignore"):
            depth = (np.where(ned > 0.0, high, low) - lens.ned_p_m) / ned
        read = depth.min(axis=2).astype(np.float32)
        for thing in things:
            where = lens.show(thing)
            window = None if where is None else silhouette(read.shape, lens, thing, where)
            if where is not None and window is not None:
                part, inside = window
                nearer = read[part]
                nearer[inside] = np.minimum(nearer[inside], where.depth_m)
        return np.nan_to_num(self._noise.applied(read), nan=0.0).astype(float)
