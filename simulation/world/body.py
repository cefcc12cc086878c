"""The human body of the simulated world: parts, joints, surfaces, and where every part is in a stance.

Lengths are fractions of the height, after Drillis & Contini 1966 (Body Segment Parameters, fig. 1); girths are those of
an adult of middle build. Frame of a part: x forward, y left, z up while the body stands; its origin is its joint.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from common.geometry.rotation import quat_to_matrix
from common.messages import Quat
from simulation.world.meshes import Mesh, outward

Array = NDArray[np.float64]
Tile = tuple[float, float, float, float]

ROOT = "pelvis"
HIP_HEIGHT = 0.53
"""Height of the root's joint while the body stands with straight legs."""
_SECTORS = 14
_TILE_MARGIN = 0.05

TILES: dict[str, Tile] = {
    "head": (0.0, 0.0, 0.5, 0.5),
    "chest": (0.5, 0.0, 1.0, 0.5),
    "pelvis": (0.0, 0.5, 0.25, 0.75),
    "thigh": (0.25, 0.5, 0.5, 0.75),
    "shin": (0.5, 0.5, 0.75, 0.75),
    "upper_arm": (0.75, 0.5, 1.0, 0.75),
    "forearm": (0.0, 0.75, 0.25, 1.0),
    "hand": (0.25, 0.75, 0.5, 1.0),
    "foot": (0.5, 0.75, 0.75, 1.0),
    "hair": (0.75, 0.75, 1.0, 1.0),
}
"""Where each part's skin and clothes lie in a person's picture: left, top, right, bottom, as fractions."""


@dataclass(frozen=True)
class Part:
    """One rigid part of the body."""

    name: str
    """Its name; the left and right ones end in `_l`, `_r`."""
    parent: str
    """Name of the part that it hangs on; empty for the root."""
    joint: tuple[float, float, float]
    """Place of its joint in the parent's frame."""
    tile: str
    """Its skin: a key of `TILES`."""
    rings: Array
    """(N, 4) from one end to the other: place along the axis, shift of the centre across it, the two half widths."""
    lying: bool = False
    """Whether the axis is x (a foot) instead of z."""


# Rows: z, centre in x, half depth (x), half width (y).
_PELVIS = np.array(
    [
        (0.092, 0.000, 0.056, 0.079),
        (0.060, 0.000, 0.059, 0.084),
        (0.020, -0.003, 0.064, 0.094),
        (-0.020, -0.006, 0.064, 0.092),
        (-0.050, -0.004, 0.050, 0.078),
        (-0.066, 0.000, 0.026, 0.040),
        (-0.072, 0.000, 0.004, 0.006),
    ]
)
_CHEST = np.array(
    [
        (0.250, -0.006, 0.004, 0.005),
        (0.246, -0.006, 0.030, 0.036),
        (0.232, -0.006, 0.039, 0.066),
        (0.214, -0.005, 0.048, 0.096),
        (0.190, -0.002, 0.057, 0.104),
        (0.150, 0.002, 0.064, 0.100),
        (0.100, 0.002, 0.064, 0.093),
        (0.050, 0.001, 0.060, 0.085),
        (0.000, 0.000, 0.057, 0.080),
        (-0.030, 0.000, 0.054, 0.077),
        (-0.034, 0.000, 0.010, 0.012),
    ]
)
_HEAD = np.array(
    [
        (0.1700, -0.004, 0.004, 0.003),
        (0.1660, -0.003, 0.024, 0.019),
        (0.1560, -0.001, 0.042, 0.034),
        (0.1410, 0.001, 0.052, 0.041),
        (0.1220, 0.003, 0.056, 0.0435),
        (0.1020, 0.005, 0.055, 0.0430),
        (0.0820, 0.008, 0.051, 0.0400),
        (0.0630, 0.013, 0.044, 0.0350),
        (0.0470, 0.019, 0.034, 0.0280),
        (0.0370, 0.014, 0.034, 0.0250),
        (0.0300, -0.001, 0.034, 0.0290),
        (0.0100, -0.004, 0.033, 0.0310),
        (-0.0200, -0.007, 0.036, 0.0400),
        (-0.0240, -0.007, 0.005, 0.005),
    ]
)
_HAIR_SHORT = np.array(
    [
        (0.1770, -0.006, 0.004, 0.003),
        (0.1720, -0.005, 0.030, 0.024),
        (0.1600, -0.003, 0.049, 0.040),
        (0.1440, -0.001, 0.057, 0.047),
        (0.1300, -0.006, 0.056, 0.0485),
        (0.1100, -0.014, 0.048, 0.0475),
        (0.0850, -0.020, 0.038, 0.0420),
        (0.0600, -0.022, 0.026, 0.0320),
        (0.0450, -0.020, 0.004, 0.005),
    ]
)
_HAIR_LONG = np.array(
    [
        *_HAIR_SHORT[:5].tolist(),
        (0.1100, -0.012, 0.052, 0.0510),
        (0.0850, -0.016, 0.048, 0.0530),
        (0.0550, -0.024, 0.040, 0.0540),
        (0.0150, -0.034, 0.032, 0.0540),
        (-0.0250, -0.042, 0.026, 0.0500),
        (-0.0550, -0.046, 0.016, 0.0400),
        (-0.0620, -0.046, 0.003, 0.006),
    ]
)
_UPPER_ARM = np.array(
    [
        (0.034, 0.000, 0.004, 0.004),
        (0.029, 0.000, 0.018, 0.018),
        (0.012, 0.000, 0.030, 0.030),
        (-0.015, 0.000, 0.033, 0.031),
        (-0.060, 0.001, 0.031, 0.028),
        (-0.110, 0.001, 0.028, 0.025),
        (-0.160, 0.000, 0.024, 0.022),
        (-0.180, 0.000, 0.021, 0.020),
        (-0.190, 0.000, 0.004, 0.004),
    ]
)
_FOREARM = np.array(
    [
        (0.016, 0.000, 0.004, 0.004),
        (0.010, 0.000, 0.019, 0.018),
        (-0.010, 0.000, 0.024, 0.022),
        (-0.045, 0.000, 0.025, 0.022),
        (-0.090, 0.000, 0.021, 0.018),
        (-0.130, 0.000, 0.017, 0.014),
        (-0.150, 0.000, 0.016, 0.013),
        (-0.154, 0.000, 0.003, 0.003),
    ]
)
_HAND = np.array(
    [
        (0.008, 0.000, 0.003, 0.003),
        (0.004, 0.000, 0.015, 0.011),
        (-0.015, 0.001, 0.020, 0.0120),
        (-0.040, 0.002, 0.024, 0.0115),
        (-0.062, 0.001, 0.023, 0.0090),
        (-0.085, 0.000, 0.019, 0.0075),
        (-0.102, -0.002, 0.011, 0.0060),
        (-0.106, -0.002, 0.003, 0.002),
    ]
)
_THIGH = np.array(
    [
        (0.046, 0.000, 0.005, 0.005),
        (0.036, 0.000, 0.032, 0.028),
        (0.005, 0.000, 0.052, 0.046),
        (-0.050, 0.002, 0.051, 0.047),
        (-0.110, 0.003, 0.046, 0.042),
        (-0.170, 0.002, 0.040, 0.036),
        (-0.225, 0.001, 0.034, 0.032),
        (-0.255, 0.001, 0.029, 0.028),
        (-0.268, 0.000, 0.005, 0.005),
    ]
)
_SHIN = np.array(
    [
        (0.022, 0.000, 0.005, 0.005),
        (0.014, 0.001, 0.026, 0.025),
        (-0.015, 0.000, 0.031, 0.030),
        (-0.065, -0.007, 0.033, 0.031),
        (-0.120, -0.006, 0.029, 0.027),
        (-0.180, -0.003, 0.022, 0.020),
        (-0.225, -0.002, 0.019, 0.018),
        (-0.246, -0.002, 0.019, 0.018),
        (-0.252, 0.000, 0.004, 0.004),
    ]
)
# Along x: place, centre in z, half height (z), half width (y).
_FOOT = np.array(
    [
        (-0.044, -0.020, 0.004, 0.004),
        (-0.041, -0.018, 0.018, 0.018),
        (-0.028, -0.014, 0.025, 0.022),
        (0.000, -0.011, 0.028, 0.024),
        (0.030, -0.017, 0.022, 0.026),
        (0.065, -0.023, 0.016, 0.030),
        (0.092, -0.026, 0.013, 0.028),
        (0.108, -0.028, 0.010, 0.019),
        (0.113, -0.028, 0.003, 0.005),
    ]
)


def _limbs() -> list[Part]:
    parts = []
    for side, sign in (("l", 1.0), ("r", -1.0)):
        parts += [
            Part(f"upper_arm_{side}", "chest", (-0.004, sign * 0.114, 0.196), "upper_arm", _UPPER_ARM),
            Part(f"forearm_{side}", f"upper_arm_{side}", (0.0, 0.0, -0.176), "forearm", _FOREARM),
            Part(f"hand_{side}", f"forearm_{side}", (0.0, 0.0, -0.148), "hand", _HAND),
            Part(f"thigh_{side}", "pelvis", (0.0, sign * 0.050, -0.006), "thigh", _THIGH),
            Part(f"shin_{side}", f"thigh_{side}", (0.0, 0.0, -0.245), "shin", _SHIN),
            Part(f"foot_{side}", f"shin_{side}", (0.0, 0.0, -0.240), "foot", _FOOT, lying=True),
        ]
    return parts


PARTS: tuple[Part, ...] = (
    Part("pelvis", "", (0.0, 0.0, 0.0), "pelvis", _PELVIS),
    Part("chest", "pelvis", (0.0, 0.0, 0.075), "chest", _CHEST),
    Part("head", "chest", (-0.002, 0.0, 0.225), "head", _HEAD),
    *_limbs(),
)
"""All parts, each after its parent."""


@dataclass(frozen=True)
class Stance:
    """How a body holds itself and lies: turns of the joints, and of the whole."""

    turns: Mapping[str, Quat]
    """Quaternion of each part about its joint, in the parent's frame; parts that are not named hang straight."""
    q: Quat = (1.0, 0.0, 0.0, 0.0)
    """Quaternion of the root in the person's own frame (x where they look or, lying, where the head is; z up)."""
    lift: float = 0.0
    """How far the lowest point is above the ground."""


def hair(long: bool) -> Part:
    """Hair of the head, in the head's frame."""
    return Part("hair", "head", (0.0, 0.0, 0.0), "hair", _HAIR_LONG if long else _HAIR_SHORT)


def surface(part: Part, height_m: float, build: float) -> Mesh:
    """Closed surface of a part in its own frame, m.

    Args:
        part: which.
        height_m: of the body, m.
        build: factor on all girths.
    """
    wide = replace(part, rings=part.rings * [1.0, 1.0, build, build]) if part.tile not in ("head", "hair") else part
    mesh = _unit_surface(wide)
    return Mesh(mesh.vertices_m * height_m, mesh.faces, mesh.uv)


def _unit_surface(part: Part) -> Mesh:
    turn = np.linspace(-np.pi, np.pi, _SECTORS + 1)
    along, centre, deep, wide = part.rings.T
    first = centre[:, None] + deep[:, None] * np.cos(turn)
    side = wide[:, None] * np.sin(turn)
    axis = np.broadcast_to(along[:, None], first.shape)
    # A foot is a limb laid forward: what is forward on a limb is then up.
    grid = np.stack((axis, side, first) if part.lying else (first, side, axis), axis=-1)
    rows, columns = grid.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate([np.stack((a, b, c), -1).reshape(-1, 3), np.stack((a, c, d), -1).reshape(-1, 3)])
    vertices = grid.reshape(-1, 3)
    faces = outward(vertices, faces)
    left, top, right, bottom = TILES[part.tile]
    share = np.abs(along - along[0]) / abs(along[-1] - along[0])
    inner = _TILE_MARGIN + (1.0 - 2.0 * _TILE_MARGIN) * np.stack(
        np.broadcast_arrays(np.linspace(0.0, 1.0, columns)[None, :], share[:, None]), axis=-1
    )
    uv = np.array([left, top]) + inner.reshape(-1, 2) * [right - left, bottom - top]
    return Mesh(vertices, faces.astype(np.int32), uv)


def places(stance: Stance) -> dict[str, tuple[Array, Array]]:
    """Place (3,) and attitude (3, 3) of every part's frame in the person's own frame, the root's joint at its origin;
    in heights of the body."""
    found: dict[str, tuple[Array, Array]] = {}
    for part in PARTS:
        turn = quat_to_matrix(stance.turns.get(part.name, (1.0, 0.0, 0.0, 0.0)))
        if not part.parent:
            found[part.name] = (np.zeros(3), quat_to_matrix(stance.q) @ turn)
            continue
        p, r = found[part.parent]
        found[part.name] = (p + r @ np.array(part.joint), r @ turn)
    return found


def root_height(stance: Stance, build: float) -> float:
    """Height of the root's joint at which the lowest point of the body is `lift` above the ground, in heights."""
    lowest = min(
        float((p[2] + _skin(name, build) @ r[2]).min())  # the third row of r: heights of the part's own axes
        for name, (p, r) in places(stance).items()
    )
    return stance.lift - lowest


@cache
def _skin(name: str, build: float) -> Array:
    part = next(p for p in PARTS if p.name == name)
    return surface(part, 1.0, build).vertices_m
