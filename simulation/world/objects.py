"""Barrels, walls and people: their bodies in the MuJoCo model, how people walk, and how near everything is.

A person is made of capsules with a head: the limbs swing about shoulders and hips in step with the way walked.
Lengths are fractions of the height, after Drillis & Contini 1966 (Body Segment Parameters, fig. 1), rounded.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.messages import Vec3
from simulation.world.gl import mujoco
from simulation.world.objects_config import BarrelConfig, PersonConfig, WallConfig, rgb
from simulation.world.path import car_path
from simulation.world.scenario import ScenarioConfig

Array = NDArray[np.float64]

VEHICLE_POINT = "vehicle"
"""Body that is put where the vehicle is, for distances."""
_POINT_M = 1e-3
_FAR_M = 1e3
# (name, joint height, side, lower end, radius, phase): fractions of the height; side and phase by sign.
_LIMBS = (
    ("left leg", 0.53, -0.055, 0.045, 0.043, 1.0),
    ("right leg", 0.53, 0.055, 0.045, 0.043, -1.0),
    ("left arm", 0.80, -0.125, 0.40, 0.027, -1.0),
    ("right arm", 0.80, 0.125, 0.40, 0.027, 1.0),
)
_LEG_SWING_RAD, _ARM_SWING_RAD = 0.42, 0.35
_STRIDE = 0.8
"""Length of a double step as a fraction of the height, at an easy pace."""
_STANDING_M_S = 0.05


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


def add_person(world: Any, name: str, person: PersonConfig, group: int) -> None:
    """Make a person, who looks along the body's x axis."""
    height, capsule = person.height_m, mujoco.mjtGeom.mjGEOM_CAPSULE
    body = world.add_body(name=name, mocap=True)
    for z, radius, colour in ((0.55, 0.085, person.trousers), (0.74, 0.09, person.shirt)):
        body.add_geom(
            type=capsule,
            fromto=[0, -0.05 * height, z * height, 0, 0.05 * height, z * height],
            size=[radius * height, 0, 0],
            rgba=_rgba(colour),
            group=group,
        )
    body.add_geom(
        type=capsule,
        fromto=[0, 0, 0.58 * height, 0, 0, 0.77 * height],
        size=[0.085 * height, 0, 0],
        rgba=_rgba(person.shirt),
        group=group,
    )
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_ELLIPSOID,
        size=[0.056 * height, 0.046 * height, 0.068 * height],
        pos=[0, 0, 0.932 * height],
        rgba=_rgba(person.skin),
        group=group,
    )
    for limb, top, side, bottom, radius, _ in _LIMBS:
        part = body.add_body(name=f"{name} {limb}", pos=[0, -side * height, top * height])
        part.add_joint(name=f"{name} {limb}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 1, 0])
        part.add_geom(
            type=capsule,
            fromto=[0, 0, 0, 0, 0, -(top - bottom) * height],
            size=[radius * height, 0, 0],
            rgba=_rgba(person.trousers if limb.endswith("leg") else person.shirt),
            group=group,
        )


def add_vehicle_point(world: Any, group: int) -> None:
    """The point whose distance from everything is measured; it is not drawn."""
    body = world.add_body(name=VEHICLE_POINT, mocap=True)
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, name=VEHICLE_POINT, size=[_POINT_M, 0, 0], group=group)


class Walker:
    """Moves one person of a model along their way.

    Args:
        model: the `mujoco.MjModel`.
        label: name of the person's body.
        person: their section.
    """

    def __init__(self, model: Any, label: str, person: PersonConfig):
        self.label = label
        """Name of the person's body."""
        self._path, self._stride_m = car_path(person), _STRIDE * person.height_m
        self._mocap = int(model.body(label).mocapid[0])
        self._limbs = [
            (int(model.joint(f"{label} {limb}").qposadr[0]), phase, _swing(limb)) for limb, *_, phase in _LIMBS
        ]

    def place(self, data: Any, walked_s: float) -> None:
        """Put the person where they are at a time since they set off, s (negative: at the start)."""
        motion = self._path.at(walked_s)
        (north, east), velocity = motion.ned_p_m[0], motion.ned_v_m_s[0]
        speed = math.hypot(*velocity)
        # On the way back of a ping-pong a car reverses; a person turns round.
        heading = math.atan2(velocity[1], velocity[0]) if speed > _STANDING_M_S else float(motion.heading_rad[0])
        data.mocap_pos[self._mocap] = (north, -east, 0.0)
        data.mocap_quat[self._mocap] = yaw_quat(heading)
        stride = math.sin(2.0 * math.pi * float(motion.along_m[0]) / self._stride_m) * min(speed, 1.0)
        for address, phase, swing in self._limbs:
            data.qpos[address] = phase * swing * stride

    def ned_v_m_s(self, walked_s: float) -> Vec3:
        """Velocity, NED, m/s, at that time."""
        north, east = self._path.at(walked_s).ned_v_m_s[0]
        return (float(north), float(east), 0.0)


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
    counts = (("barrel", scenario.barrels), ("wall", scenario.walls), ("person", scenario.people))
    objects = []
    for kind, sections in counts:
        for number in range(1, len(sections) + 1):
            body = model.body(f"{kind} {number}").id
            of_body = np.flatnonzero(model.body_rootid[model.geom_bodyid] == body)
            objects.append(StandingObject(f"{kind} {number}", int(body), tuple(int(g) for g in of_body)))
    return tuple(objects)


def _swing(limb: str) -> float:
    return _LEG_SWING_RAD if limb.endswith("leg") else _ARM_SWING_RAD


def _rgba(colour: str) -> list[float]:
    return [*(c / 255 for c in rgb(colour)), 1.0]
