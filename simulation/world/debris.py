"""What lies about in the simulated world and is no person: stones, rubble, timber, luggage, figures without shape."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulation.world.gl import mujoco
from simulation.world.meshes import Mesh, lump_mesh, ring_mesh
from simulation.world.objects import yaw_quat
from simulation.world.objects_config import ThingConfig, rgb
from simulation.world.textures import Picture, Rgb, blend, grain, leaves, planks, value_noise

Array = NDArray[np.float64]


@dataclass(frozen=True)
class _Maker:
    """Where the geoms of one thing go."""

    builder: Any
    body: Any
    group: int
    rng: np.random.Generator

    def add(self, kind: Any, size: list[float], pos: list[float], material: str, turn: Array | None = None) -> None:
        quat = np.array([1.0, 0.0, 0.0, 0.0]) if turn is None else turn
        self.body.add_geom(type=kind, size=size, pos=pos, quat=quat.tolist(), material=material, group=self.group)

    def add_mesh(self, mesh: Mesh, pos: list[float], material: str, turn: Array | None = None) -> None:
        quat = np.array([1.0, 0.0, 0.0, 0.0]) if turn is None else turn
        self.body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=self.builder.mesh(mesh),
            pos=pos,
            quat=quat.tolist(),
            material=material,
            group=self.group,
        )

    def material(self, picture: Picture) -> str:
        return self.builder.material(picture)


def add_thing(builder: Any, name: str, thing: ThingConfig, rng: np.random.Generator, group: int) -> None:
    """Put a thing on the ground.

    Args:
        builder: makes meshes (`mesh`) and materials (`material`) in its specification (`spec`).
        name: of the body.
        thing: what and where.
        rng: its shape.
        group: of the geoms.
    """
    body = builder.spec.worldbody.add_body(
        name=name, pos=[thing.north_m, -thing.east_m, 0.0], quat=yaw_quat(math.radians(thing.heading_deg))
    )
    _MAKERS[thing.kind](_Maker(builder, body, group, rng), thing.size_m, rgb(thing.colour))


def _stone(rng: np.random.Generator, colour: Rgb) -> Picture:
    dark = (int(colour[0] * 0.55), int(colour[1] * 0.55), int(colour[2] * 0.55))
    picture = blend(dark, colour, value_noise(rng, 128, 4, 5))
    return np.clip(picture + grain(rng, 128, 9)[..., None], 0, 255).astype(np.uint8)


def _cloth(rng: np.random.Generator, colour: Rgb) -> Picture:
    folds = 0.75 + 0.5 * value_noise(rng, 128, 3, 3)
    return np.clip(np.array(colour, np.float32) * folds[..., None], 0, 255).astype(np.uint8)


def _rock(maker: _Maker, size: float, colour: Rgb) -> None:
    half = np.array([0.5, maker.rng.uniform(0.32, 0.48), maker.rng.uniform(0.25, 0.4)]) * size
    maker.add_mesh(lump_mesh(maker.rng, half, 0.14), [0, 0, 0.55 * half[2]], maker.material(_stone(maker.rng, colour)))


def _rubble(maker: _Maker, size: float, colour: Rgb) -> None:
    stone = maker.material(_stone(maker.rng, colour))
    for _ in range(9):
        reach, angle = 0.42 * size * math.sqrt(maker.rng.random()), maker.rng.uniform(0.0, math.tau)
        half = maker.rng.uniform(0.04, 0.17, 3) * size
        high = half.min() + (0.5 * size - reach) * maker.rng.uniform(0.05, 0.4)
        place = [reach * math.cos(angle), reach * math.sin(angle), float(high)]
        turn = maker.rng.normal(size=4)
        maker.add(mujoco.mjtGeom.mjGEOM_BOX, half.tolist(), place, stone, turn / np.linalg.norm(turn))


def _planks(maker: _Maker, size: float, colour: Rgb) -> None:
    for layer in range(3):
        wood = maker.material(planks(maker.rng, 128, colour, 3))
        angle = maker.rng.normal(0.0, 0.35)
        turn = np.array([math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2)])
        half = [size * maker.rng.uniform(0.35, 0.5), 0.07 + 0.03 * maker.rng.random(), 0.018]
        place = [0.0, float(maker.rng.normal(0.0, 0.12)), 0.02 + 0.04 * layer]
        maker.add(mujoco.mjtGeom.mjGEOM_BOX, half, place, wood, turn)


def _crate(maker: _Maker, size: float, colour: Rgb) -> None:
    half = np.array([0.5, maker.rng.uniform(0.3, 0.5), maker.rng.uniform(0.2, 0.45)]) * size
    wood = maker.material(planks(maker.rng, 128, colour, 6))
    maker.add(mujoco.mjtGeom.mjGEOM_BOX, half.tolist(), [0, 0, float(half[2])], wood)


def _bag(maker: _Maker, size: float, colour: Rgb) -> None:
    half = np.array([0.5, maker.rng.uniform(0.22, 0.3), maker.rng.uniform(0.16, 0.22)]) * size
    cloth = maker.material(_cloth(maker.rng, colour))
    maker.add_mesh(lump_mesh(maker.rng, half, 0.06), [0, 0, 0.9 * half[2]], cloth)
    strap = maker.material(_cloth(maker.rng, (40, 38, 36)))
    for x in (-0.15, 0.15):
        size_m = [0.02, float(half[1] * 0.9), 0.02]
        maker.add(mujoco.mjtGeom.mjGEOM_BOX, size_m, [x * size, 0.0, float(1.85 * half[2])], strap)


def _pipe(maker: _Maker, size: float, colour: Rgb) -> None:
    radius = maker.rng.uniform(0.05, 0.12)
    along = np.array([0.5**0.5, 0.0, 0.5**0.5, 0.0])
    rust = maker.material(_stone(maker.rng, colour))
    maker.add(mujoco.mjtGeom.mjGEOM_CYLINDER, [radius, size / 2, 0], [0, 0, radius], rust, along)


def _tyre(maker: _Maker, size: float, colour: Rgb) -> None:
    thick = 0.17 * size
    rubber = maker.material(_stone(maker.rng, colour))
    maker.add_mesh(ring_mesh(size / 2 - thick, thick), [0, 0, thick], rubber)


def _branch(maker: _Maker, size: float, colour: Rgb) -> None:
    bark = maker.material(_stone(maker.rng, colour))
    foliage = maker.material(leaves(maker.rng, 128, (74, 104, 44)))
    capsule = mujoco.mjtGeom.mjGEOM_CAPSULE
    for start, angle, length in ((-0.5, 0.1, 1.0), (-0.2, 0.7, 0.5), (0.0, -0.6, 0.45), (0.15, 0.5, 0.35)):
        angle += maker.rng.normal(0.0, 0.15)
        half = 0.5 * length * size
        # About z after lying down along x.
        lying, about = np.array([0.5**0.5, 0.0, 0.5**0.5, 0.0]), np.array([math.cos(angle / 2), math.sin(angle / 2)])
        turn = np.array([about[0] * lying[0], -about[1] * lying[2], about[0] * lying[2], about[1] * lying[0]])
        place = [start * size + half * math.cos(angle), half * math.sin(angle), 0.05]
        maker.add(capsule, [0.03, half, 0], place, bark, turn)
    crown = np.array([0.28, 0.22, 0.12]) * size
    maker.add_mesh(lump_mesh(maker.rng, crown, 0.3), [0.3 * size, 0.0, 0.8 * crown[2]], foliage)


def _dummy(maker: _Maker, size: float, colour: Rgb) -> None:
    """A rolled-up mattress: as long and thick as a trunk with legs, the same all along."""
    half = np.array([0.5 * size, 0.16, 0.15])
    cloth = _cloth(maker.rng, colour)
    cloth[:, ::16] = np.clip(cloth[:, ::16].astype(np.int16) + 60, 0, 255).astype(np.uint8)
    maker.add_mesh(lump_mesh(maker.rng, half, 0.03, blunt=5.0), [0, 0, float(half[2])], maker.material(cloth))


_MAKERS: dict[str, Callable[[_Maker, float, Rgb], None]] = {
    "rock": _rock,
    "rubble": _rubble,
    "planks": _planks,
    "crate": _crate,
    "bag": _bag,
    "pipe": _pipe,
    "tyre": _tyre,
    "branch": _branch,
    "dummy": _dummy,
}
