"""What is drawn for the encounters: vehicles that fly straight on, and obstacles that stand and walk in their way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray
MOST = 8
"""Obstacles in an encounter."""
DURATION_S = 12.0
"""Of an encounter, s."""
CONTROL_S = 0.05
"""Period of the limiter, s."""
TICKS = round(DURATION_S / CONTROL_S)
"""Control periods in an encounter."""
RANGE_M, HALF_VIEW_RAD = 8.0, np.radians(45.0)
"""Of the depth sensor, m and rad."""
FAR_M = 1e3
"""Where there is nothing, m."""
_SPEED_M_S, _CRUISING = (0.5, 2.5), 0.5
_WALKING = 0.5
_DRAGS_1_S = (0.1, 1.0)


@dataclass(frozen=True)
class Scene:
    """What is drawn for N encounters."""

    asked: Array
    """Velocity asked all the time, (N, 3), NED, m/s: north, with a little climb or sink."""
    cruising: Array
    """Whether it is flown from the beginning, (N,); else the vehicle starts at rest."""
    drag_1_s: Array
    """Drag by mass, (N,)."""
    places: Array
    """Obstacles at the beginning, (N, 8, 3), m; far away where there are fewer than eight."""
    velocities: Array
    """Their velocities, (N, 8, 3), m/s."""
    delay_ticks: Array
    """Delay of the sensor, (N,), control periods."""
    lost_from_s: Array
    """Beginning of the drop-out, (N,), s."""
    lost_for_s: Array
    """Its length, (N,), s."""

    def at(self, t_s: float) -> Array:
        """Obstacles at a time, (N, 8, 3), m."""
        return self.places + self.velocities * t_s


def draw(rng: np.random.Generator, count: int) -> Scene:
    """Encounters: 1 to 8 obstacles 3 to 15 m away (from 8.5 m where the vehicle is under way), within 60 degrees of the
    way, one or two of them walking at up to 1.5 m/s in every second encounter."""
    speed = rng.uniform(*_SPEED_M_S, count)
    cruising = rng.random(count) < _CRUISING
    number = rng.integers(1, MOST + 1, count)
    distance = rng.uniform(np.where(cruising, RANGE_M + 0.5, 3.0)[:, None], 15.0, (count, MOST))
    bearing = np.radians(rng.uniform(-60.0, 60.0, (count, MOST)))
    height = rng.uniform(-1.0, 1.0, (count, MOST))
    places = np.stack([distance * np.cos(bearing), distance * np.sin(bearing), height], axis=-1)
    places[np.arange(MOST)[None, :] >= number[:, None]] = (FAR_M, 0.0, 0.0)
    walkers = np.where(rng.random(count) < _WALKING, rng.integers(1, 3, count), 0)
    walks = (np.arange(MOST)[None, :] < np.minimum(walkers, number)[:, None]).astype(float)
    heading, pace = rng.uniform(-np.pi, np.pi, (count, MOST)), rng.uniform(0.3, 1.5, (count, MOST)) * walks
    velocities = np.stack([pace * np.cos(heading), pace * np.sin(heading), np.zeros((count, MOST))], axis=-1)
    climb = np.where(rng.random(count) < 0.2, rng.uniform(-0.3, 0.3, count), 0.0)
    return Scene(
        np.stack([speed, np.zeros(count), climb], axis=-1),
        cruising,
        rng.choice(_DRAGS_1_S, count),
        places,
        velocities,
        rng.integers(0, 5, count),
        rng.uniform(0.0, DURATION_S, count),
        np.where(rng.random(count) < 0.5, rng.uniform(0.0, 1.0, count), 0.0),
    )


def length(vectors: Array) -> Array:
    """Lengths of (..., 3), without the copies that `numpy.linalg.norm` makes: (...)."""
    return np.sqrt(np.einsum("...i,...i", vectors, vectors))


def in_view(offset_m: Array) -> Array:
    """Whether an offset from the vehicle lies within range and view, (...)."""
    near = np.einsum("...i,...i", offset_m, offset_m) <= RANGE_M**2
    return near & (np.abs(np.arctan2(offset_m[..., 1], offset_m[..., 0])) <= HALF_VIEW_RAD)
