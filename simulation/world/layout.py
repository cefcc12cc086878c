"""Where roads run and where trees and houses stand: decided once from the scenario and its seed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulation.world.path import CarPath
from simulation.world.scenario import ScenarioConfig

Array = NDArray[np.float64]

SHADOW_NE_PER_M = (-0.35, 0.45)
"""Where the top of something 1 m high throws its shadow, (north, east) m: the sun stands in the north-west."""
# The car keeps to the right-hand lane: the middle of the road runs this part of its width to the left.
_LANE_OFFSET = 0.24
# A trunk stands just beyond the edge of the car's lane.
_TRUNK_OFFSET = 0.5 - _LANE_OFFSET + 0.08
_CLEAR_OF_HOME_M = 2.2
_ATTEMPTS = 60


@dataclass(frozen=True)
class Road:
    """A road as it is painted."""

    ne_points_m: Array
    """Middle line, (N, 2): north, east, m."""
    width_m: float
    """Width, m."""


@dataclass(frozen=True)
class Tree:
    """A tree or bush."""

    ne_m: tuple[float, float]
    """Place of the crown, m."""
    radius_m: float
    """Radius of the crown, m."""
    height_m: float
    """Height of the crown's centre, m."""
    shade: int
    """Which of the foliage textures."""
    ne_trunk_m: tuple[float, float]
    """Place of the trunk, m."""


@dataclass(frozen=True)
class House:
    """A house with a gable roof."""

    ne_m: tuple[float, float]
    """Centre, m."""
    length_m: float
    """Length along the ridge, m."""
    width_m: float
    """Width, m."""
    wall_m: float
    """Height of the eaves, m."""
    rise_m: float
    """Height of the ridge above the eaves, m."""
    heading_rad: float
    """Direction of the ridge, rad from north."""
    shade: int
    """Which of the roof textures."""


@dataclass(frozen=True)
class Layout:
    """Everything that stands still."""

    roads: tuple[Road, ...]
    """The roads."""
    trees: tuple[Tree, ...]
    """Trees and bushes, overhanging ones included."""
    houses: tuple[House, ...]
    """Houses."""


def lay_out(scenario: ScenarioConfig, path: CarPath, rng: np.random.Generator) -> Layout:
    """Layout of a scenario: roads along its paths, overhanging trees where it says, the rest beside the roads.

    Args:
        scenario: the scenario.
        path: way of the chased car.
        rng: source of randomness.
    """
    ground = scenario.ground
    roads = [Road(np.array(r.points, dtype=float), r.width_m) for r in ground.roads]
    if ground.road and len(path.t_s) > 1:
        roads.append(Road(_beside(path.polyline(), _LANE_OFFSET * ground.road_width_m), ground.road_width_m))
    taken = [(np.array((d.north_m, d.east_m)), 1.2) for d in scenario.distractors if not d.path.waypoints]
    taken += [(np.array((o.north_m, o.east_m)), 1.0 + o.span_m / 2) for o in scenario.occluders]
    taken.append((np.zeros(2), _CLEAR_OF_HOME_M))
    houses = _houses(ground.houses, ground.size_m, roads, taken, rng)
    trees = [
        _overhanging(o.north_m, o.east_m, o.heading_deg, o.width_m, o.height_m, ground.road_width_m)
        for o in scenario.occluders
        if o.kind == "tree"
    ]
    trees += _trees(ground.trees, ground.size_m, roads, taken, rng)
    return Layout(tuple(roads), tuple(trees), tuple(houses))


def _beside(points: Array, left_m: float) -> Array:
    """Line (N, 2) to the left of a line in (north, east)."""
    along = np.gradient(points, axis=0)
    if np.allclose(points[0], points[-1]):
        along[0] = along[-1] = points[1] - points[-2]
    along /= np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9)[:, None]
    # Left of north is west: (n, e) turned by -90 degrees is (e, -n).
    return points + left_m * np.column_stack((along[:, 1], -along[:, 0]))


def _overhanging(
    north_m: float, east_m: float, heading_deg: float, width_m: float, height_m: float, road_width_m: float
) -> Tree:
    """Tree whose crown hangs above the road, its trunk beside it."""
    heading, reach = np.deg2rad(heading_deg), _TRUNK_OFFSET * road_width_m
    trunk = (north_m + reach * float(np.cos(heading)), east_m + reach * float(np.sin(heading)))
    return Tree((north_m, east_m), width_m / 2, height_m, 0, trunk)


def _free(place: Array, radius_m: float, roads: list[Road], taken: list[tuple[Array, float]]) -> bool:
    for centre, clearance in taken:
        if float(np.hypot(*(place - centre))) < clearance + radius_m:
            return False
    for road in roads:
        distance = np.hypot(*(road.ne_points_m - place).T).min()
        if distance < road.width_m / 2 + radius_m + 0.35:
            return False
    return True


def _place(
    radius_m: float, size_m: float, roads: list[Road], taken: list[tuple[Array, float]], rng: np.random.Generator
) -> tuple[float, float] | None:
    """A free place, nearer to the roads than chance would have it; None when none was found."""
    reach = 0.5 * size_m - 2.0
    for _ in range(_ATTEMPTS):
        if roads and rng.random() < 0.8:
            road = roads[int(rng.integers(len(roads)))].ne_points_m
            place = road[int(rng.integers(len(road)))] + rng.normal(0.0, 2.6, 2)
        else:
            place = rng.uniform(-reach, reach, 2)
        if np.abs(place).max() < reach and _free(place, radius_m, roads, taken):
            taken.append((place, radius_m))
            return float(place[0]), float(place[1])
    return None


def _trees(
    count: int, size_m: float, roads: list[Road], taken: list[tuple[Array, float]], rng: np.random.Generator
) -> list[Tree]:
    trees = []
    for _ in range(count):
        bush = rng.random() < 0.4
        radius = float(rng.uniform(0.25, 0.45) if bush else rng.uniform(0.5, 1.0))
        height = 0.6 * radius if bush else float(rng.uniform(0.9, 1.3)) + 0.4 * radius
        place = _place(radius, size_m, roads, taken, rng)
        if place is not None:
            trees.append(Tree(place, radius, height, int(rng.integers(3)), place))
    return trees


def _houses(
    count: int, size_m: float, roads: list[Road], taken: list[tuple[Array, float]], rng: np.random.Generator
) -> list[House]:
    houses = []
    for _ in range(count):
        length, width = float(rng.uniform(2.2, 3.2)), float(rng.uniform(1.6, 2.2))
        place = _place(0.5 * float(np.hypot(length, width)) + 0.3, size_m, roads, taken, rng)
        if place is not None:
            houses.append(
                House(
                    place,
                    length,
                    width,
                    float(rng.uniform(0.9, 1.3)),
                    float(rng.uniform(0.5, 0.8)),
                    float(rng.uniform(0, np.pi)),
                    int(rng.integers(2)),
                )
            )
    return houses
