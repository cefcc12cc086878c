"""What is known around the vehicle at one instant: obstacles as arrays, and how fast it may fly where."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from common.messages import Obstacle, Vec3

Array = np.ndarray
ROWS, COLUMNS = 9, 36
"""Cells of the sphere of directions: 20 degrees of elevation by 10 of azimuth."""
_NOTHING = np.zeros((0, 3))


@dataclass(frozen=True)
class Surroundings:
    """Obstacles and sight, now."""

    distance_m: Array = field(default_factory=lambda: np.zeros(0))
    """Distances to where the obstacles should be, m, (K,)."""
    ned_direction: Array = field(default_factory=lambda: _NOTHING)
    """Unit vectors towards the obstacles, NED, (K, 3)."""
    ned_v_m_s: Array = field(default_factory=lambda: _NOTHING)
    """Their velocities, NED, m/s, (K, 3)."""
    labels: Sequence[str] = ()
    """Their names, K, or none at all."""
    sources: Sequence[str] = ()
    """Topic of each, K, or none at all."""
    unsure_m: Array | None = None
    """How far from there each may be, m, (K,); None for not at all."""
    speed_m_s: Array | None = None
    """Fastest speed in each direction of `cell_directions`, m/s, (ROWS, COLUMNS); None where nothing bounds it."""
    blind: bool = False
    """Whether nothing is known at all, or a source that sees has gone blind."""
    range_m: Array | None = None
    """How far each direction is known to be free but for the obstacles, m, (ROWS, COLUMNS), 0 where it is not; None
    without a source that sees."""

    @property
    def least_m(self) -> Array:
        """How near each obstacle may be, m, (K,), not negative."""
        return self.distance_m if self.unsure_m is None else np.maximum(self.distance_m - self.unsure_m, 0.0)

    def fastest_m_s(self, ned_v_m_s: Vec3) -> float:
        """Fastest speed in the direction of a velocity, m/s, continuous in it; infinite where none is set."""
        if self.speed_m_s is None:
            return math.inf
        north, east, down = ned_v_m_s
        size = math.sqrt(north * north + east * east + down * down)
        if size == 0.0:
            return math.inf
        row = (math.asin(max(min(down / size, 1.0), -1.0)) / math.pi + 0.5) * ROWS - 0.5
        column = math.atan2(east, north) / (2.0 * math.pi) * COLUMNS - 0.5
        low = min(max(math.floor(row), 0), ROWS - 2)
        down_share = min(max(row - low, 0.0), 1.0)
        left = math.floor(column)
        right_share = column - left
        above, below = self.speed_m_s[low], self.speed_m_s[low + 1]
        a, b = left % COLUMNS, (left + 1) % COLUMNS
        top = float(above[a]) * (1.0 - right_share) + float(above[b]) * right_share
        bottom = float(below[a]) * (1.0 - right_share) + float(below[b]) * right_share
        return top * (1.0 - down_share) + bottom * down_share


def cell_directions() -> Array:
    """Unit vectors to the middles of the cells, NED, (ROWS, COLUMNS, 3): from up to down, from north by east."""
    elevation = ((np.arange(ROWS) + 0.5) / ROWS - 0.5) * np.pi
    azimuth = (np.arange(COLUMNS) + 0.5) / COLUMNS * 2.0 * np.pi
    level = np.cos(elevation)[:, None]
    return np.stack(
        [
            level * np.cos(azimuth),
            level * np.sin(azimuth),
            np.broadcast_to(np.sin(elevation)[:, None], (ROWS, COLUMNS)),
        ],
        axis=-1,
    )


def of_obstacles(obstacles: Sequence[Obstacle]) -> Surroundings:
    """Surroundings of a plain list of obstacles, with sight in every direction."""
    if not obstacles:
        return Surroundings()
    return Surroundings(
        np.array([o.distance_m for o in obstacles]),
        np.array([o.ned_direction for o in obstacles]),
        np.array([o.ned_v_m_s for o in obstacles]),
        [o.label for o in obstacles],
    )
