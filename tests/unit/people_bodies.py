"""Skeletons for the tests of filter and association."""

from __future__ import annotations

import math

import numpy as np

from onboard.people.pose import Pose
from onboard.people.regions import Region

STANDING = np.array(
    [
        [0, 0], [0, 18], [-14, 20], [-18, 42], [-17, 62], [14, 20], [18, 42], [17, 62],
        [-9, 60], [-10, 90], [-11, 120], [9, 60], [10, 90], [11, 120], [0, 60],
    ],
    float,
)  # fmt: skip
"""(15, 2), px: a person who stands, seen from the front; 120 px from the head to the ankles."""


def pose(joints: np.ndarray = STANDING, presence: float = 1.0, confidence: float = 0.9) -> Pose:
    """A pose of some joints."""
    return Pose(np.asarray(joints, float), np.full(15, confidence), presence)


def moved(joints: np.ndarray, angle_rad: float, scale: float, shift: tuple[float, float]) -> np.ndarray:
    """Joints turned, enlarged and shifted."""
    turn = np.array([[math.cos(angle_rad), -math.sin(angle_rad)], [math.sin(angle_rad), math.cos(angle_rad)]])
    return scale * joints @ turn.T + shift


def region_of(joints: np.ndarray, margin: float = 0.08) -> Region:
    """A region that follows the body: the disc-swept line from above the head to below the feet."""
    head, feet = joints[0], 0.5 * (joints[10] + joints[13])
    ends = np.array([head + margin * (head - feet), feet + margin * (feet - head)])
    radius = 0.2 * float(np.linalg.norm(head - feet))
    low = np.floor(ends.min(axis=0) - radius).astype(int)
    high = np.ceil(ends.max(axis=0) + radius).astype(int) + 1
    columns, rows = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
    places = np.stack((columns, rows), axis=-1) - ends[0]
    line = ends[1] - ends[0]
    along = np.clip(places @ line / (line @ line), 0.0, 1.0)
    inside = np.linalg.norm(places - along[..., None] * line, axis=-1) <= 0.5 * radius
    size = high - low
    return Region((int(low[0]), int(low[1]), int(size[0]), int(size[1])), inside, None, None, None, None)
