"""What a depth sensor does to true depth: noise that grows with the range, flying pixels and holes, steps.

Random fields are made once, a little larger than a picture, and laid over each picture at a random offset: drawing
them anew would cost more than rendering.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from common.geometry.camera import DepthCamera
from common.geometry.depth import DepthPicture
from simulation.world.depth_config import DepthNoiseConfig

_MARGIN_PX = 64
_NEIGHBOURS = np.ones((3, 3), np.uint8)


class DepthNoise:
    """Imperfections of one depth sensor.

    Args:
        config: how large they are.
        sensor: size of its pictures and its range.
        rng: source of randomness, drawn from here and for each picture.
    """

    def __init__(self, config: DepthNoiseConfig, sensor: DepthCamera, rng: np.random.Generator):
        self._config, self._sensor, self._rng = config, sensor, rng
        shape = (sensor.camera.height + _MARGIN_PX, sensor.camera.width + _MARGIN_PX)
        self._gauss = rng.standard_normal(shape, dtype=np.float32)
        self._chance = rng.random(shape, dtype=np.float32)
        self._between = rng.random(shape, dtype=np.float32)

    def applied(self, depth_m: DepthPicture) -> DepthPicture:
        """What the sensor measures of true depths (height, width), m, NaN where nothing returns; the same shape."""
        config, range_m = self._config, np.float32(self._sensor.range_max_m)
        measured = depth_m.copy()
        if config.flying or config.edge_holes:
            self._edges(depth_m, measured)
        if config.noise_m or config.noise_per_m:
            sigma = np.float32(config.noise_m) + np.float32(config.noise_per_m) * measured * measured
            measured += sigma * self._part(self._gauss)
        if config.holes:
            share = measured / range_m
            measured[self._part(self._chance) < np.float32(config.holes) * share * share] = np.nan
        if config.step_m:
            measured = np.round(measured / np.float32(config.step_m)) * np.float32(config.step_m)
        # NaN compares as outside.
        within = (measured >= np.float32(self._sensor.range_min_m)) & (measured <= range_m)
        measured[~within] = np.nan
        return measured

    def _edges(self, depth_m: DepthPicture, measured: DepthPicture) -> None:
        """Let pixels on edges fly between the two sides, or show nothing."""
        config = self._config
        # Nothing behind an edge counts as the far end of the range, with room for the edge to be one.
        behind = np.float32(self._sensor.range_max_m + 2 * config.edge_m)
        solid = np.where(np.isnan(depth_m), behind, depth_m)
        near, far = cv2.erode(solid, _NEIGHBOURS), cv2.dilate(solid, _NEIGHBOURS)
        rows, columns = np.nonzero(far - near > np.float32(config.edge_m))
        chance = self._part(self._chance)[rows, columns]
        between = self._part(self._between)[rows, columns]
        near, far = near[rows, columns], far[rows, columns]
        flown = near + between * (far - near)
        value = np.where(chance < config.flying, flown, measured[rows, columns])
        measured[rows, columns] = np.where(chance >= 1.0 - config.edge_holes, np.nan, value)

    def _part(self, field: NDArray[np.float32]) -> NDArray[np.float32]:
        """A random window of a field, as large as a picture."""
        row, column = (int(i) for i in self._rng.integers(0, _MARGIN_PX, 2))
        return field[row : row + self._sensor.camera.height, column : column + self._sensor.camera.width]
