"""The way over an area: parallel lines, there and back, as far apart as the camera sees."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from common.geometry.camera import Camera
from common.geometry.rotation import Array

_EDGE = 1e-6


def swath_m(camera: Camera, height_m: float) -> float:
    """Width of ground that a level camera looking down sees across the way from a height, m: the picture's columns."""
    return height_m * camera.width / camera.fx_px


def sweep(area: Sequence[tuple[float, float]], spacing_m: float, start: tuple[float, float]) -> Array:
    """Corners (N, 2) of the way over an area, north and east, m.

    The lines run along the area's longest side, so that there are few; the first and the last lie half a spacing (or
    less) inside it, and each is cut where it leaves the area. Of the four ways to fly them, it is the one that begins
    nearest to the start.

    Args:
        area: corners (north, east) of a polygon, m.
        spacing_m: greatest distance between neighbouring lines, m.
        start: where the vehicle is, north and east, m.
    """
    corners = np.array(area, float)
    sides = np.roll(corners, -1, axis=0) - corners
    longest = sides[int(np.argmax((sides * sides).sum(axis=1)))]
    along = longest / np.linalg.norm(longest)
    axes = np.array([along, (-along[1], along[0])])
    turned = corners @ axes.T
    low, high = float(turned[:, 1].min()), float(turned[:, 1].max())
    count = max(1, math.ceil((high - low) / spacing_m))
    levels = low + (np.arange(count) + 0.5) * (high - low) / count
    lines = [piece for level in levels for piece in _pieces(turned, float(level))]
    ways = [_there_and_back(order, flip) @ axes for order in (lines, lines[::-1]) for flip in (False, True)]
    return min(ways, key=lambda way: float(np.linalg.norm(way[0] - start)))


def _there_and_back(lines: Sequence[Array], flip: bool) -> Array:
    return np.concatenate([line[::-1] if (number % 2 == 1) != flip else line for number, line in enumerate(lines)])


def _pieces(corners: Array, level: float) -> list[Array]:
    """Parts (2, 2) of the line across = level that lie in a polygon (C, 2) of along and across."""
    crossings = []
    for (a0, c0), (a1, c1) in pairwise([*corners, corners[0]]):
        if (c0 > level) != (c1 > level):
            crossings.append(a0 + (level - c0) / (c1 - c0) * (a1 - a0))
    crossings.sort()
    pairs = zip(crossings[::2], crossings[1::2], strict=True)
    return [np.array([(a, level), (b, level)]) for a, b in pairs if b - a > _EDGE]


def length_m(way: Array, start: tuple[float, float]) -> float:
    """Length of a way (N, 2) from a start, m."""
    steps = np.diff(np.vstack((start, way)), axis=0)
    return float(np.linalg.norm(steps, axis=1).sum())
