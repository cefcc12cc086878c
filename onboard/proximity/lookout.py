"""One depth sensor's contribution to the obstacles: what it sees now, what comes nearer, and when it is blind."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.geometry.camera import DepthCamera
from common.geometry.depth import in_mm
from common.geometry.rotation import as_quat, as_vec3, quat_multiply
from common.messages import Image, Obstacle, View
from onboard.limiter.map import covered
from onboard.proximity.blindness import Blind, Taken, Watch
from onboard.proximity.closing import closing_speeds
from onboard.proximity.config import ProximityConfig
from onboard.proximity.pose import Pose
from onboard.proximity.sectors import SectorGrid, Sight

Array = NDArray[np.float64]
_CLOSE_S = 1.0
_BESIDE = 1.5
"""How many cells to the side an earlier point counts for a direction."""


@dataclass(frozen=True)
class Report:
    """What one picture adds."""

    obstacles: tuple[Obstacle, ...]
    """Nearest points."""
    view: View
    """Where they were looked for."""
    blind: Blind
    """Why nothing was seen; empty when something was."""


class Lookout:
    """Reads the pictures of one sensor.

    Args:
        sensor: its calibration as the vehicle's file has it; pictures of another size scale it.
        config: what counts.
    """

    def __init__(self, sensor: DepthCamera, config: ProximityConfig):
        self._sensor, self._config = sensor, config
        self._grid = SectorGrid(sensor, config)
        self._watch = Watch(config)
        self._before: deque[tuple[int, Array, Array, View]] = deque()
        self._close_ns = np.full(config.rows * config.columns, -10 * int(_CLOSE_S * 1e9))

    def look(self, image: Image, capture_ns: int, pose: Pose) -> Report:
        """What a picture shows, taken at a stamp, ns, from a pose of the vehicle."""
        if (image.width, image.height) != (self._sensor.camera.width, self._sensor.camera.height):
            camera = self._sensor.camera.resized(image.width, image.height)
            self._sensor = DepthCamera(camera, self._sensor.range_min_m, self._sensor.range_max_m)
            self._grid = SectorGrid(self._sensor, self._config)
        blind = self._watch.judge(Taken(capture_ns, image.data, pose.ned_p_m, pose.ned_q_body))
        if blind:
            return self.blind(pose.ned_q_body, blind)
        sight = self._grid.look(in_mm(image), pose.ned_q_body, -float(pose.ned_p_m[2]))
        if sight.share < self._config.alive_share:
            return self.blind(pose.ned_q_body, "empty")
        distances = np.linalg.norm(sight.ned_points_m, axis=1)
        view = self._view(pose.ned_q_body, self._trusted(sight, distances, capture_ns))
        speeds = self._closing(sight, view, capture_ns, pose)
        obstacles = tuple(
            Obstacle(
                distance_m=float(distance),
                ned_direction=as_vec3(point / distance),
                ned_v_m_s=as_vec3(-speed * point / distance),
            )
            for point, distance, speed in zip(sight.ned_points_m, distances, speeds, strict=True)
        )
        return Report(obstacles, view, "")

    def blind(self, ned_q_body: Array, reason: Blind) -> Report:
        """A report of seeing nothing, at an attitude."""
        return Report((), self._view(ned_q_body, np.zeros(self._config.rows * self._config.columns, bool)), reason)

    def _closing(self, sight: Sight, view: View, capture_ns: int, pose: Pose) -> Array:
        """Own closing speed of each point, m/s, against the points of a moment ago; 0 where nobody looked then.

        Of a wall that comes into a turning view only the far end was seen before: its near end would seem to rush up.
        """
        config = self._config
        while len(self._before) > 1 and capture_ns - self._before[1][0] >= config.look_back_s * 1e9:
            self._before.popleft()
        speeds = np.zeros(len(sight.ned_points_m))
        if self._before:
            before_ns, ned_m, ned_p_then_m, view_then = self._before[0]
            dt_s = (capture_ns - before_ns) / 1e9
            beside = (
                _BESIDE
                * 2.0
                * max(self._grid.half_width_rad / config.columns, self._grid.half_height_rad / config.rows)
            )
            if 0.5 * config.look_back_s <= dt_s <= 2.0 * config.look_back_s:
                speeds = closing_speeds(
                    sight.ned_points_m,
                    ned_m - pose.ned_p_m,
                    dt_s,
                    beside,
                    config.closing_noise_m_s,
                    config.closing_limit_m_s,
                )
                speeds[~covered(view_then, sight.ned_points_m + pose.ned_p_m - ned_p_then_m)] = 0.0
        self._before.append((capture_ns, sight.ned_points_m + pose.ned_p_m, pose.ned_p_m, view))
        return np.where(sight.cells < 0, 0.0, speeds)  # what lies beneath or overhead is a surface

    def _trusted(self, sight: Sight, distances: Array, capture_ns: int) -> NDArray[np.bool_]:
        """The cells that were seen, without empty ones where something was close a moment ago."""
        config = self._config
        occupied = sight.cells >= 0
        cells = sight.cells[occupied]
        self._close_ns[cells[distances[occupied] < config.close_m]] = capture_ns
        recent = (capture_ns - self._close_ns < _CLOSE_S * 1e9).reshape(config.rows, config.columns)
        padded = np.pad(recent, 1)
        near = np.zeros_like(recent)
        for row in range(3):
            for column in range(3):
                near |= padded[row : row + config.rows, column : column + config.columns]
        empty = np.ones(len(sight.seen), bool)
        empty[cells] = False
        return sight.seen & ~(empty & near.ravel() & ~sight.returned)

    def _view(self, ned_q_body: Array, seen: NDArray[np.bool_]) -> View:
        return View(
            ned_q_sensor=as_quat(quat_multiply(ned_q_body, self._sensor.camera.body_q_camera)),
            half_width_rad=self._grid.half_width_rad,
            half_height_rad=self._grid.half_height_rad,
            range_m=self._grid.range_m,
            columns=self._config.columns,
            rows=self._config.rows,
            seen=tuple(seen.tolist()),
        )
