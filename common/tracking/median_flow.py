"""Median flow: the displacement and the growth that most points of a box agree on (Kalal et al. 2010).

DOI 10.1109/ICPR.2010.675; the tracker of TLD (Kalal et al. 2012, section 5.2), and of Echeverri 2016, section 3.2.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np

from common.tracking.base import Box
from common.tracking.flow import follow_points

_GRID = 10
"""Points along each side (the paper: 10)."""
_PATCH = 10
"""Side of the patch around a point that is compared in both pictures, px (the paper: 10)."""
_LEAST_HELD = 8
"""Points that must hold for the flow to tell anything."""
_MARGIN = 0.1
"""Share of the box along each edge that has no points: what is there is often not the target."""


class Moved(NamedTuple):
    """What a box has done between two pictures."""

    offset_px: np.ndarray
    """Displacement of its centre, (2,), px."""
    grown: float
    """Its size over the one before."""
    error_px: float
    """Median forward-backward error of all points that were found, px."""
    likeness: float
    """Median correlation of the patches around the points that hold, -1 to 1."""


def median_flow(before: np.ndarray, after: np.ndarray, box: Box, expected_px: np.ndarray | None = None) -> Moved | None:
    """How a box has moved from one picture (H, W) uint8 to the next; None where too few points can be followed.

    The half of the points that come back nearest and the half whose surroundings look most alike hold; the medians over
    them are taken, of the size over all pairs. A displacement (2,) that is expected is where the search begins.
    """
    x, y, width, height = box
    steps = _MARGIN + (1.0 - 2 * _MARGIN) * (np.arange(_GRID) + 0.5) / _GRID
    points = np.stack(np.meshgrid(x + steps * width, y + steps * height), axis=2).reshape(-1, 2)
    rows, columns = before.shape
    points = points[((points >= 0) & (points < (columns, rows))).all(axis=1)]
    places, error = follow_points(before, after, points, expected_px)
    found = np.isfinite(error)
    if found.sum() < _LEAST_HELD:
        return None
    points, places, error = points[found], places[found], error[found]
    likeness = (_patches(before, points) * _patches(after, places)).sum(axis=1)
    middle, typical = float(np.median(error)), float(np.median(likeness))
    held = (error <= middle) & (likeness >= typical)
    if held.sum() < _LEAST_HELD:
        return None
    one, other = np.triu_indices(int(held.sum()), 1)
    was, now = points[held], places[held]
    apart = np.hypot(*(was[one] - was[other]).T)
    grown = float(np.median(np.hypot(*(now[one] - now[other]).T)[apart > 0] / apart[apart > 0]))
    center = np.array([x + width / 2, y + height / 2])
    # Points that hold may all lie on one side: without their growth the centre would creep the other way.
    offset = np.median(now - center - grown * (was - center), axis=0)
    return Moved(offset, grown, middle, typical)


def _patches(grey: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Surroundings of points (n, 2), each of mean 0 and length 1, (n, 100) float32."""
    steps = np.arange(_PATCH, dtype=np.float32) - (_PATCH - 1) / 2
    across, down = np.meshgrid(steps, steps)
    x = (points[:, :1] + across.ravel()).astype(np.float32)
    y = (points[:, 1:] + down.ravel()).astype(np.float32)
    cut = cv2.remap(grey, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float32)
    cut -= cut.mean(axis=1, keepdims=True)
    return cut / (np.sqrt((cut * cut).sum(axis=1, keepdims=True)) + math.sqrt(_PATCH))
