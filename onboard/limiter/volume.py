"""The space that the vehicle may be in: floor, ceiling and a fence, as rooms along normals."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from common.messages import Vec3
from onboard.limiter.config import LimiterConfig

Array = np.ndarray
Edge = Literal["floor", "ceiling", "fence"]
_FAR_M = 200.0


class Edges(NamedTuple):
    """Edges of the flight volume that are near."""

    names: tuple[Edge, ...]
    """What each is, E."""
    normals: Array
    """Unit vectors towards and out over the edges, NED, (E, 3)."""
    rooms_m: Array
    """What is left, m, (E,); none or less: at or beyond the edge."""


def edges(ned_p_m: Vec3, config: LimiterConfig) -> Edges:
    """The edges as seen from a position.

    The fence is judged side by side, each by its nearest point: at an inward corner that is the corner itself, so a
    polygon need not be convex. From outside, the way back in is free and every other way is not.

    Args:
        ned_p_m: position from home, NED, m.
        config: the edges.
    """
    names: list[Edge] = []
    normals: list[Vec3] = []
    rooms: list[float] = []
    height_m = -ned_p_m[2]
    if config.floor_m is not None:
        names.append("floor")
        normals.append((0.0, 0.0, 1.0))
        rooms.append(height_m - config.floor_m)
    if config.ceiling_m is not None:
        names.append("ceiling")
        normals.append((0.0, 0.0, -1.0))
        rooms.append(config.ceiling_m - height_m)
    if config.fence:
        for normal, room_m in _sides((ned_p_m[0], ned_p_m[1]), np.array(config.fence)):
            names.append("fence")
            normals.append(normal)
            rooms.append(room_m)
    return Edges(tuple(names), np.array(normals).reshape(-1, 3), np.array(rooms))


def inside(place_m: tuple[float, float], corners_m: Array) -> bool:
    """Whether a place (north, east) lies in a polygon (C, 2), by the parity of its crossings."""
    north, east = place_m
    n, e = corners_m[:, 0], corners_m[:, 1]
    n2, e2 = np.roll(n, -1), np.roll(e, -1)
    spans = (e > east) != (e2 > east)
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = n + (east - e) / (e2 - e) * (n2 - n)
    return bool(np.count_nonzero(spans & (north < crossing)) % 2)


def _sides(place_m: tuple[float, float], corners_m: Array) -> list[tuple[Vec3, float]]:
    """Outward normal and room of each side of the polygon that is near; from outside, of the nearest one alone."""
    place = np.array(place_m)
    starts, ends = corners_m, np.roll(corners_m, -1, axis=0)
    along = ends - starts
    length2 = np.maximum((along * along).sum(axis=1), 1e-12)
    share = np.clip(((place - starts) * along).sum(axis=1) / length2, 0.0, 1.0)
    offset = starts + share[:, None] * along - place
    distance = np.sqrt((offset * offset).sum(axis=1))
    within = inside(place_m, corners_m)
    # On the line itself the side's own normal serves; which of the two is outward, a step along it tells.
    across = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.sqrt(length2)[:, None]
    found: list[tuple[Vec3, float]] = []
    order = range(len(distance)) if within else [int(distance.argmin())]
    for k in order:
        if distance[k] > _FAR_M:
            continue
        if distance[k] > 1e-6:
            n, e = (offset[k] / distance[k]) * (1.0 if within else -1.0)
        else:
            n, e = across[k]
            if inside((place[0] + 1e-3 * n, place[1] + 1e-3 * e), corners_m):
                n, e = -n, -e
        found.append(((float(n), float(e), 0.0), float(distance[k]) if within else 0.0))
    return found
