"""People of the simulated world: their bodies in the MuJoCo model, and where they are and how they move at a time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.geometry.rotation import quat_multiply
from common.messages import Vec3
from simulation.world.body import PARTS, ROOT, Part, Stance, hair, root_height, surface
from simulation.world.body_paint import Outfit
from simulation.world.gl import mujoco
from simulation.world.objects_config import PersonConfig, rgb
from simulation.world.path import car_path
from simulation.world.stances import STRIDE, stance, walking

Array = NDArray[np.float64]

_WALKING_M_S = 0.1
_SAMPLED = 0.3
"""Triangles of at least this share of the largest one of a part stand for its surface."""
_HEAD = "head"
# What sits on the head besides hair: place and half axes in body heights.
_FEATURES = (
    ((0.061, 0.0, 0.083), (0.011, 0.0075, 0.014), 0.96),  # nose
    ((-0.002, 0.043, 0.090), (0.010, 0.005, 0.016), 0.92),  # ears
    ((-0.002, -0.043, 0.090), (0.010, 0.005, 0.016), 0.92),
)
_THUMB = ((0.022, 0.0, -0.03), (0.008, 0.008, 0.024))


def outfit_of(person: PersonConfig) -> Outfit:
    """What a person wears."""
    return Outfit(
        skin=rgb(person.skin),
        hair=rgb(person.hair),
        shirt=rgb(person.shirt),
        trousers=rgb(person.trousers),
        shoes=rgb(person.shoes),
        short_sleeves=person.short_sleeves,
        shorts=person.shorts,
        pattern=person.pattern,
    )


def add_person(builder: Any, name: str, person: PersonConfig, material: str, group: int) -> None:
    """Make a person's body: parts on ball joints, the root placed freely.

    Args:
        builder: makes meshes (`mesh`) in its specification (`spec`).
        name: of the root body; the parts are `name part`.
        person: size, build, hair.
        material: of skin and clothes, painted by `body_paint.paint`.
        group: of the geoms.
    """
    bodies: dict[str, Any] = {}
    for part in PARTS:
        if part.name == ROOT:
            body = builder.spec.worldbody.add_body(name=name, mocap=True)
        else:
            place = np.array(part.joint) * person.height_m
            body = bodies[part.parent].add_body(name=f"{name} {part.name}", pos=place.tolist())
            body.add_joint(name=f"{name} {part.name}", type=mujoco.mjtJoint.mjJNT_BALL)
        bodies[part.name] = body
        _add_surface(builder, body, part, person, material, group)
    _add_surface(builder, bodies[_HEAD], hair(person.long_hair), person, material, group)
    skin = np.array(rgb(person.skin)) / 255.0
    for place, axes, bright in _FEATURES:
        _add_ellipsoid(bodies[_HEAD], place, axes, skin * bright, person.height_m, group)
    for hand in ("hand_l", "hand_r"):
        _add_ellipsoid(bodies[hand], *_THUMB, skin, person.height_m, group)


def _add_surface(builder: Any, body: Any, part: Part, person: PersonConfig, material: str, group: int) -> None:
    mesh = builder.mesh(surface(part, person.height_m, person.build))
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=mesh, material=material, group=group)


def _add_ellipsoid(
    body: Any,
    place: tuple[float, float, float],
    axes: tuple[float, float, float],
    colour: Array,
    height_m: float,
    group: int,
) -> None:
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_ELLIPSOID,
        size=[height_m * a for a in axes],
        pos=[height_m * p for p in place],
        rgba=[*np.clip(colour, 0.0, 1.0).tolist(), 1.0],
        group=group,
    )


@dataclass(frozen=True)
class PartSamples:
    """Points on the surface of one part."""

    body: int
    """Number of the part's body in the model."""
    head: bool
    """Whether the part is the head."""
    points_m: Array
    """(S, 3) in the part's frame."""
    area_m2: float
    """Of its surface, m²."""


class Person:
    """Moves one person of a model along their way and through their motions.

    Args:
        model: the `mujoco.MjModel`.
        label: name of the person's body.
        person: their section.
    """

    def __init__(self, model: Any, label: str, person: PersonConfig):
        self.label = label
        """Name of the person's body."""
        self.body = int(model.body(label).id)
        """Number of that body: the root of all parts."""
        self._person = person
        self._path, self._stride_m = car_path(person), STRIDE * person.height_m
        self._mocap = int(model.body(label).mocapid[0])
        named = [part.name for part in PARTS if part.name != ROOT]
        self._address = {name: int(model.joint(f"{label} {name}").qposadr[0]) for name in named}
        self._still: tuple[Stance, float] | None = None
        self.samples = tuple(self._samples(model))
        """Points on every part, for what of the person is seen."""

    def place(self, data: Any, walked_s: float) -> None:
        """Put the person where they are at a time since they set off, s (negative: at the start)."""
        motion = self._path.at(walked_s)
        (north, east), velocity = motion.ned_p_m[0], motion.ned_v_m_s[0]
        speed = math.hypot(*velocity)
        # On the way back of a ping-pong a car reverses; a person turns round.
        heading = math.atan2(velocity[1], velocity[0]) if speed > 0.5 * _WALKING_M_S else float(motion.heading_rad[0])
        held, height_m = self._held(walked_s, speed, float(motion.along_m[0]))
        turn = (math.cos(heading / 2), 0.0, 0.0, -math.sin(heading / 2))
        data.mocap_pos[self._mocap] = (north, -east, height_m)
        data.mocap_quat[self._mocap] = quat_multiply(turn, held.q)
        for name, address in self._address.items():
            data.qpos[address : address + 4] = held.turns.get(name, (1.0, 0.0, 0.0, 0.0))

    def ned_v_m_s(self, walked_s: float) -> Vec3:
        """Velocity, NED, m/s, at that time."""
        north, east = self._path.at(walked_s).ned_v_m_s[0]
        return (float(north), float(east), 0.0)

    def _held(self, walked_s: float, speed_m_s: float, along_m: float) -> tuple[Stance, float]:
        """Stance and height of the root's joint above the ground, m."""
        person = self._person
        if speed_m_s > _WALKING_M_S:
            held = walking(math.tau * along_m / self._stride_m, speed_m_s)
        elif person.posture in ("jumping", "waving"):
            held = stance(person.posture, person.limbs, max(walked_s, 0.0))
        else:
            if self._still is None:
                still = stance(person.posture, person.limbs)
                self._still = (still, person.height_m * root_height(still, person.build))
            return self._still
        return held, person.height_m * root_height(held, person.build)

    def _samples(self, model: Any) -> list[PartSamples]:
        person, found = self._person, []
        for part in PARTS:
            body = int(model.body(self.label if part.name == ROOT else f"{self.label} {part.name}").id)
            mesh = surface(part, person.height_m, person.build)
            a, b, c = (mesh.vertices_m[mesh.faces[:, k]] for k in range(3))
            areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
            # The middles of the larger triangles: the small ones crowd at the ends.
            large = areas > _SAMPLED * areas.max()
            found.append(PartSamples(body, part.name == _HEAD, ((a + b + c) / 3)[large], float(areas.sum())))
        return found
