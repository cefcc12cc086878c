"""From a depth picture to the nearest points by direction, and which directions were seen.

The picture is divided into cells that are equal in angle (the cells of `common.messages.View`). In each, the point that
is reported is not the nearest pixel but the k-th nearest, k being a few pixels or a small share of the cell, after
flying pixels were dropped: those that the median of their neighbourhood does not confirm. A thing that covers fewer
than k pixels of a cell is not seen: at 320 x 240 over 79 degrees that is a wire, but not a post of 5 cm at 6 m.

The limiter brakes the velocity component towards a point. The ground would so brake level flight, although nobody flies
into it: what lies on the ground (at home's height) is left to the limiter's minimum height, and surfaces that level
flight passes above or below with room to spare are reported straight beneath or overhead, where they are near.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.geometry.camera import DepthCamera
from common.geometry.rotation import quat_multiply, quat_to_matrix
from onboard.proximity.config import ProximityConfig

Array = NDArray[np.float64]
_MM_PER_M = np.float32(1000.0)
_SUB = 6
"""A cell counts as covered by the picture when this many by this many rays through it fall inside."""
_COVERED = 0.95
_RETURNS = 0.2
"""Share of a cell's pixels that must show something for the cell to count as seen by them."""
_EXPECTED = 0.8
"""Ground is expected up to this share of the sensor's range: farther away it may give no return."""


@dataclass(frozen=True)
class Sight:
    """What one picture shows."""

    ned_points_m: Array
    """Nearest points (K, 3) from the vehicle's centre, NED, m: at most one a cell, and one beneath, one overhead."""
    cells: NDArray[np.intp]
    """Cell of each point, (K,); -1 for those beneath and overhead."""
    seen: NDArray[np.bool_]
    """Whether each cell was seen, (rows * columns,), row by row from the top left."""
    returned: NDArray[np.bool_]
    """Whether something returned from a good part of each cell, (rows * columns,)."""
    share: float
    """Share of the pixels that show something."""


class SectorGrid:
    """Cells of one sensor's picture, prepared once.

    Args:
        sensor: calibration, mounting and range.
        config: how many cells, and what counts.
    """

    def __init__(self, sensor: DepthCamera, config: ProximityConfig):
        self._sensor, self._config, camera = sensor, config, sensor.camera
        columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
        rays = camera.rays(np.column_stack((columns.ravel(), rows.ravel())))
        azimuth, elevation = (
            np.arctan2(rays[:, 0], rays[:, 2]),
            np.arctan2(rays[:, 1], np.hypot(rays[:, 0], rays[:, 2])),
        )
        self.half_width_rad, self.half_height_rad = float(np.abs(azimuth).max()), float(np.abs(elevation).max())
        """Half the angular width and height of the view, rad."""
        column = np.floor((azimuth / self.half_width_rad + 1.0) / 2.0 * config.columns).astype(int)
        row = np.floor((elevation / self.half_height_rad + 1.0) / 2.0 * config.rows).astype(int)
        cell = np.clip(row, 0, config.rows - 1) * config.columns + np.clip(column, 0, config.columns - 1)
        self._pixels = np.bincount(cell, minlength=config.rows * config.columns)
        self._members = _members(cell, self._pixels)
        self._nth = np.maximum(config.least_pixels, np.ceil(config.least_share * self._pixels)).astype(int) - 1
        self._rays = rays.astype(np.float32)
        # Distance from the vehicle's centre of a point z r behind a lens at t: d² = z² r·r + 2 z r·t + t·t.
        mounting = quat_to_matrix(camera.body_q_camera)
        self._body_p = np.array(camera.body_p_camera_m)
        in_camera = mounting.T @ self._body_p
        self._r_r = np.einsum("ij,ij->i", rays, rays).astype(np.float32)
        self._r_t = (2.0 * rays @ in_camera).astype(np.float32)
        self._t_t = np.float32(in_camera @ in_camera)
        self._directions, self._covered = self._cell_rays()
        self.range_m = sensor.range_max_m - float(np.linalg.norm(self._body_p))
        """Distance from the vehicle's centre within which the sensor measures, m."""

    def _cell_rays(self) -> tuple[Array, NDArray[np.bool_]]:
        """Rays (cells, 3) through the middles of the cells, and which cells the picture covers."""
        config, camera = self._config, self._sensor.camera
        steps = [(np.arange(n * _SUB) + 0.5) / (n * _SUB) * 2.0 - 1.0 for n in (config.rows, config.columns)]
        el, az = np.meshgrid(steps[0] * self.half_height_rad, steps[1] * self.half_width_rad, indexing="ij")
        rays = np.stack((np.sin(az) * np.cos(el), np.sin(el), np.cos(az) * np.cos(el)), axis=-1)
        pixels = camera.project(rays.reshape(-1, 3)).reshape(*el.shape, 2)
        with np.errstate(invalid="ignore"):
            inside = ((pixels > -0.5) & (pixels < np.array([camera.width, camera.height]) - 0.5)).all(axis=-1)
        by_cell = inside.reshape(config.rows, _SUB, config.columns, _SUB).mean(axis=(1, 3)).ravel()
        middles = rays.reshape(config.rows, _SUB, config.columns, _SUB, 3).mean(axis=(1, 3)).reshape(-1, 3)
        return middles / np.linalg.norm(middles, axis=1)[:, None], by_cell >= _COVERED

    def look(self, depth_mm: NDArray[np.uint16], ned_q_body: ArrayLike, height_m: float) -> Sight:
        """What a picture shows.

        Args:
            depth_mm: (height, width), mm along the optical axis, 0 where nothing returned.
            ned_q_body: attitude of the vehicle at its capture.
            height_m: height of the vehicle's centre above home, m.
        """
        config = self._config
        depth, usable = self._confirmed(depth_mm)
        matrix = quat_to_matrix(quat_multiply(ned_q_body, self._sensor.camera.body_q_camera)).astype(np.float32)
        lens_down = np.float32((quat_to_matrix(ned_q_body) @ self._body_p)[2])
        down = depth * (self._rays @ matrix[2]) + lens_down  # below the vehicle's centre, m
        distance = np.sqrt(depth * (depth * self._r_r + self._r_t) + self._t_t)
        standing = usable & (down < height_m - config.ground_m)
        level = standing & (np.abs(down) < config.clearance_m)
        cells, pixels = self._nearest(np.where(level, distance, np.float32(np.inf)))
        points = (self._rays[pixels] * depth[pixels, None]) @ matrix.T + quat_to_matrix(ned_q_body) @ self._body_p
        passed = np.flatnonzero(standing & ~level & (distance**2 - down**2 < config.beneath_m**2))
        vertical = self._vertical(down[passed])
        share = float(usable.mean())
        returned = self._returned(usable)
        seen = self._covered & (returned | self._free_when_empty(matrix, height_m - float(lens_down)))
        return Sight(
            np.vstack((points, vertical)).astype(float),
            np.concatenate((cells, np.full(len(vertical), -1))),
            seen if share >= config.alive_share else np.zeros_like(seen),
            returned,
            share,
        )

    def _confirmed(self, depth_mm: NDArray[np.uint16]) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Depth (N,), m, and which pixels their neighbourhood confirms, within the sensor's range."""
        config, sensor = self._config, self._sensor
        median = cv2.medianBlur(np.ascontiguousarray(depth_mm), 3)
        apart = cv2.absdiff(depth_mm, median)
        tolerance = config.edge_m * 1000.0 + config.edge_share * median
        usable = (depth_mm > sensor.range_min_m * 1000.0) & (depth_mm <= sensor.range_max_m * 1000.0 + 1.0)
        usable &= apart <= tolerance
        return (median.ravel() / _MM_PER_M).astype(np.float32), usable.ravel()

    def _nearest(self, distance: NDArray[np.float32]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Cells that show something, and the pixel of each that is its k-th nearest."""
        padded = np.append(distance, np.float32(np.inf))
        cells, pixels = [], []
        for cell, members in enumerate(self._members):
            values = padded[members]
            candidates = np.flatnonzero(values < np.inf)
            if len(candidates) > self._nth[cell]:
                nth = candidates[np.argpartition(values[candidates], self._nth[cell])[self._nth[cell]]]
                cells.append(cell)
                pixels.append(members[nth])
        return np.array(cells, np.intp), np.array(pixels, np.intp)

    def _vertical(self, down_m: NDArray[np.float32]) -> Array:
        """The nearest surface straight beneath and overhead, (0 to 2, 3), NED, m."""
        found = []
        for sign in (1.0, -1.0):
            values = sign * down_m[np.sign(down_m) == sign]
            nth = self._config.least_pixels - 1
            if len(values) > nth:
                found.append((0.0, 0.0, sign * float(np.partition(values, nth)[nth])))
        return np.array(found).reshape(-1, 3)

    def _returned(self, usable: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Cells (rows * columns,) from a good part of which something returned."""
        counts = np.array([np.count_nonzero(usable[members]) for members in self._members])
        return counts >= _RETURNS * np.maximum(self._pixels, 1)

    def _free_when_empty(self, matrix: NDArray[np.float32], lens_height_m: float) -> NDArray[np.bool_]:
        """Cells (rows * columns,) in which emptiness means free space: no ground had to return."""
        if not self._config.empty_is_free:
            return np.zeros(len(self._covered), bool)
        down = self._directions @ matrix[2].astype(float)
        with np.errstate(divide="ignore", invalid="ignore"):
            ground_z = lens_height_m / down * self._directions[:, 2]
        return ~((down > 0) & (ground_z < _EXPECTED * self._sensor.range_max_m))


def _members(cell: NDArray[np.intp], pixels: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """Numbers of the pixels of each cell."""
    return np.split(np.argsort(cell, kind="stable"), np.cumsum(pixels)[:-1])
