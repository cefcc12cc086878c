"""Barrels and walls: their bodies in the MuJoCo model, and how near everything that stands there is."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulation.world.gl import mujoco
from simulation.world.objects_config import BarrelConfig, WallConfig, rgb
from simulation.world.scenario import ScenarioConfig

Array = NDArray[np.float64]

VEHICLE_POINT = "vehicle"
"""Body that is put where the vehicle is, for distances."""
_POINT_M = 1e-3
_FAR_M = 1e3


def yaw_quat(heading_rad: float) -> list[float]:
    """Rotation in MuJoCo's frame of something that looks along a heading."""
    return [math.cos(heading_rad / 2), 0.0, 0.0, -math.sin(heading_rad / 2)]


def add_barrel(world: Any, name: str, barrel: BarrelConfig, group: int) -> None:
    """Put a barrel on the ground."""
    body = world.add_body(name=name, pos=[barrel.north_m, -barrel.east_m, 0])
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[barrel.radius_m, barrel.height_m / 2, 0],
        pos=[0, 0, barrel.height_m / 2],
        rgba=_rgba(barrel.colour),
        group=group,
    )


def add_wall(world: Any, name: str, wall: WallConfig, group: int) -> None:
    """Put up a wall."""
    (n0, e0), (n1, e1) = wall.start, wall.end
    heading = math.atan2(e1 - e0, n1 - n0)
    body = world.add_body(name=name, pos=[(n0 + n1) / 2, -(e0 + e1) / 2, 0], quat=yaw_quat(heading))
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[math.dist(wall.start, wall.end) / 2, wall.thickness_m / 2, wall.height_m / 2],
        pos=[0, 0, wall.height_m / 2],
        rgba=_rgba(wall.colour),
        group=group,
    )


def add_vehicle_point(world: Any, group: int) -> None:
    """The point whose distance from everything is measured; it is not drawn."""
    body = world.add_body(name=VEHICLE_POINT, mocap=True)
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, name=VEHICLE_POINT, size=[_POINT_M, 0, 0], group=group)


@dataclass(frozen=True)
class StandingObject:
    """A barrel, wall or person of a model."""

    label: str
    """Name of its body."""
    body: int
    """Number of that body."""
    geoms: tuple[int, ...]
    """Numbers of the geoms of its body and of the bodies below it."""

    def nearest(self, model: Any, data: Any) -> tuple[float, Array]:
        """Distance of its surface from the vehicle's point, m, negative inside, and the nearest point (3,), NWU, m."""
        point, segment = model.geom(VEHICLE_POINT).id, np.zeros(6)
        best_m, best = math.inf, segment
        for geom in self.geoms:
            distance = mujoco.mj_geomDistance(model, data, point, geom, _FAR_M, segment)
            if distance < best_m:
                best_m, best = distance, segment.copy()
        return float(best_m) + _POINT_M, best[3:]


def standing_objects(model: Any, scenario: ScenarioConfig) -> tuple[StandingObject, ...]:
    """Barrels, walls and people of a model."""
    counts = (
        ("barrel", scenario.barrels),
        ("wall", scenario.walls),
        ("thing", scenario.things),
        ("person", scenario.people),
    )
    objects = []
    for kind, sections in counts:
        for number in range(1, len(sections) + 1):
            body = model.body(f"{kind} {number}").id
            of_body = np.flatnonzero(model.body_rootid[model.geom_bodyid] == body)
            objects.append(StandingObject(f"{kind} {number}", int(body), tuple(int(g) for g in of_body)))
    return tuple(objects)


def _rgba(colour: str) -> list[float]:
    return [*(c / 255 for c in rgb(colour)), 1.0]
