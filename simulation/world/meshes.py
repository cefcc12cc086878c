"""Meshes of cars, crowns and roofs: vertices in metres, faces as vertex indices, texture coordinates of 0 to 1."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Mesh:
    """Triangles with one texture coordinate a vertex."""

    vertices_m: Array
    """Vertices, (V, 3), x forward, y left, z up, m."""
    faces: NDArray[np.int32]
    """Vertex indices, (F, 3), anticlockwise seen from outside."""
    uv: Array
    """Texture coordinates, (V, 2): along the columns and down the rows of the picture."""


# Side view of the car: (fraction of the length from the rear, fraction of the height).
_CAR_PROFILE = np.array(
    [
        (0.0, 0.30),
        (0.02, 0.50),
        (0.06, 0.58),
        (0.20, 0.62),
        (0.31, 0.95),
        (0.36, 1.0),
        (0.56, 1.0),
        (0.61, 0.95),
        (0.74, 0.62),
        (0.94, 0.52),
        (0.985, 0.42),
        (1.0, 0.28),
    ]
)
CAR_BELT = 0.6
"""Height of the outline that shows from above (bonnet, doors, boot), as a fraction of the car's height."""


def car_mesh(length_m: float, width_m: float, height_m: float) -> Mesh:
    """Body of a car, its centre at the origin, standing on z = 0: a grid draped over the side view, with a skirt."""
    along = np.unique(np.concatenate((_CAR_PROFILE[:, 0], np.linspace(0, 1, 13))))
    across = np.array([-1.0, -0.93, -0.8, -0.66, 0.0, 0.66, 0.8, 0.93, 1.0])
    top = np.interp(along, _CAR_PROFILE[:, 0], _CAR_PROFILE[:, 1])
    # Rounded corners of the plan view, and a cabin that is narrower at the roof than at the belt.
    plan = 1.0 - 0.22 * np.clip((np.abs(along - 0.5) - 0.38) / 0.12, 0, 1) ** 2
    shoulder = np.interp(np.abs(across), [0, 0.66, 0.8, 0.93, 1.0], [1.0, 1.0, 0.92, 0.0, 0.0])
    edge = np.interp(np.abs(across), [0, 0.93, 1.0], [1.0, 1.0, 0.86])
    low = np.minimum(top, CAR_BELT)
    z = (low[:, None] + (top - low)[:, None] * shoulder) * edge
    x = np.broadcast_to((along - 0.5)[:, None] * length_m, z.shape)
    y = plan[:, None] * across[None, :] * width_m / 2
    grid = np.stack((x, y, z * height_m), axis=-1)
    uv = np.stack(np.broadcast_arrays(along[:, None], 0.5 - 0.5 * across[None, :]), axis=-1)
    return _skirted(grid, uv, floor_m=0.12 * height_m)


def _skirted(grid: Array, uv: Array, floor_m: float) -> Mesh:
    """Mesh of a grid (A, B, 3), with its border drawn down to a floor."""
    rows, columns = grid.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = [np.stack((a, b, c), -1).reshape(-1, 3), np.stack((a, c, d), -1).reshape(-1, 3)]
    border = np.concatenate((index[:, 0], index[-1, 1:], index[-2::-1, -1], index[0, -2::-1]))
    skirt = grid.reshape(-1, 3)[border].copy()
    skirt[:, 2] = floor_m
    below = np.arange(len(border)) + rows * columns
    i, j = np.arange(len(border) - 1), np.arange(1, len(border))
    faces.append(np.stack((border[i], below[i], below[j]), -1))
    faces.append(np.stack((border[i], below[j], border[j]), -1))
    vertices = np.concatenate((grid.reshape(-1, 3), skirt))
    coordinates = np.concatenate((uv.reshape(-1, 2), uv.reshape(-1, 2)[border]))
    return Mesh(vertices, np.concatenate(faces).astype(np.int32), coordinates)


def crown_mesh(rng: np.random.Generator, radius_m: float, flatness: float = 0.7) -> Mesh:
    """Crown of a tree around the origin: a lumpy dome whose leaves are wrapped from above.

    Args:
        rng: source of randomness.
        radius_m: mean radius, m.
        flatness: height over width.
    """
    rings, sectors = 7, 14
    polar = np.linspace(0, np.pi * 0.85, rings)
    turn = np.linspace(0, 2 * np.pi, sectors + 1)
    lumps = rng.uniform(0.82, 1.18, (rings, sectors))
    lumps[0] = lumps[0].mean()
    lumps = np.concatenate((lumps, lumps[:, :1]), axis=1)
    radius = radius_m * lumps
    x = radius * np.sin(polar)[:, None] * np.cos(turn)
    y = radius * np.sin(polar)[:, None] * np.sin(turn)
    z = radius * np.cos(polar)[:, None] * flatness
    index = np.arange(rings * (sectors + 1)).reshape(rings, sectors + 1)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    # At the top ring a and d are the same point: only the second triangle has an area.
    faces = np.concatenate((np.stack((a, b, c), -1).reshape(-1, 3), np.stack((a, c, d), -1)[1:].reshape(-1, 3)))
    vertices = np.stack((x, y, z), -1).reshape(-1, 3)
    # Polar angle, not x and y: the sides would smear.
    reach = (polar / np.pi)[:, None] * np.ones(sectors + 1)
    uv = np.stack((0.5 + reach * np.cos(turn), 0.5 + reach * np.sin(turn)), -1).reshape(-1, 2)
    return Mesh(vertices, faces.astype(np.int32), uv)


def gable_mesh(length_m: float, width_m: float, rise_m: float, overhang_m: float = 0.08) -> Mesh:
    """Gable roof, its eaves at z = 0 and its ridge along x: two tiled slopes and two gables."""
    lx, ly = length_m / 2 + overhang_m, width_m / 2 + overhang_m
    slopes = np.array(
        [
            (-lx, -ly, 0),
            (lx, -ly, 0),
            (lx, 0, rise_m),
            (-lx, 0, rise_m),
            (lx, ly, 0),
            (-lx, ly, 0),
            (-lx, 0, rise_m),
            (lx, 0, rise_m),
        ],
        dtype=float,
    )
    quad_uv = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    gables = np.array([(lx, -ly, 0), (lx, ly, 0), (lx, 0, rise_m), (-lx, ly, 0), (-lx, -ly, 0), (-lx, 0, rise_m)])
    faces = np.array([(0, 1, 2), (0, 2, 3), (4, 5, 6), (4, 6, 7), (8, 9, 10), (11, 12, 13)])
    uv = np.array(quad_uv + quad_uv + [(0.02, 0.02)] * 6)
    return Mesh(np.concatenate((slopes, gables)), faces.astype(np.int32), uv)


def lump_mesh(rng: np.random.Generator, half_m: Array, roughness: float, blunt: float = 2.0) -> Mesh:
    """Something roundish around the origin: an ellipsoid with lumps.

    Args:
        rng: the lumps.
        half_m: (3,) half axes, m.
        roughness: standard deviation of the lumps, as a fraction of the radius.
        blunt: exponent of the superellipse along x: 2 for an ellipsoid, more for a roll with flat ends.
    """
    rings, sectors = 9, 14
    polar, turn = np.linspace(0.02, np.pi - 0.02, rings), np.linspace(0.0, 2 * np.pi, sectors + 1)
    lumps = 1.0 + roughness * rng.normal(size=(rings, sectors)).clip(-2.0, 2.0)
    lumps[[0, -1]] = 1.0
    lumps = np.concatenate((lumps, lumps[:, :1]), axis=1)
    along = np.cos(polar)
    girth = (1.0 - np.abs(along) ** blunt) ** (1.0 / blunt)
    x = half_m[0] * along[:, None] * np.ones(sectors + 1)
    y = half_m[1] * (girth[:, None] * lumps) * np.cos(turn)
    z = half_m[2] * (girth[:, None] * lumps) * np.sin(turn)
    return _wrapped(np.stack((x, y, z), axis=-1))


def ring_mesh(radius_m: float, thickness_m: float) -> Mesh:
    """Torus around z at the origin.

    Args:
        radius_m: of the middle of the tube, m.
        thickness_m: radius of the tube, m.
    """
    around, tube = np.linspace(0.0, 2 * np.pi, 21), np.linspace(0.0, 2 * np.pi, 11)
    reach = radius_m + thickness_m * np.cos(tube)[None, :]
    x, y = reach * np.cos(around)[:, None], reach * np.sin(around)[:, None]
    z = np.broadcast_to(thickness_m * np.sin(tube)[None, :], x.shape)
    return _wrapped(np.stack((x, y, z), axis=-1))


def _wrapped(grid: Array) -> Mesh:
    """Mesh of a grid (A, B, 3) that closes upon itself, its picture stretched over it once."""
    rows, columns = grid.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate((np.stack((a, b, c), -1).reshape(-1, 3), np.stack((a, c, d), -1).reshape(-1, 3)))
    vertices = grid.reshape(-1, 3)
    uv = np.stack(
        np.broadcast_arrays(np.linspace(0.0, 1.0, columns)[None, :], np.linspace(0.0, 1.0, rows)[:, None]), -1
    )
    return Mesh(vertices, outward(vertices, faces).astype(np.int32), uv.reshape(-1, 2))


def outward(vertices_m: Array, faces: NDArray[np.int_]) -> NDArray[np.int_]:
    """Faces of a closed surface, anticlockwise seen from outside: turned round where they enclose a negative volume."""
    a, b, c = (vertices_m[faces[:, k]] for k in range(3))
    return faces if float(np.einsum("ij,ij", a, np.cross(b, c))) > 0 else faces[:, ::-1]
