"""Solids of revolution with painted surfaces: a person, a head, a bin, a pillar.

What is seen of them changes with an out-of-plane turn as it really does: new surface comes round, the old goes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np

ROWS = 96
"""Rows of every surface."""


class Solid:
    """A solid of revolution with a painted surface.

    Args:
        surface: what is painted around it, (rows, columns, 3) BGR; the first column's middle faces its front.
        profile: radius of each row against its height, (rows,).
        height_m: height.
        flat: depth over width of its cross-section.
    """

    def __init__(self, surface: np.ndarray, profile: np.ndarray, height_m: float, flat: float = 1.0):
        self.height_m, self._flat = height_m, flat
        self._surface, self._radius = surface, float(profile.max())
        rows, around = surface.shape[0], surface.shape[1]
        columns = 2 * math.ceil(self._radius * rows) + 2
        across = (np.arange(columns) - (columns - 1) / 2)[None, :] / (profile[:, None] * rows)
        self.mask = (np.abs(across) < 1.0).astype(np.uint8) * 255
        """What of its picture is it, (rows, columns), 255 or 0."""
        angle = np.arcsin(np.clip(across, -1.0, 1.0))
        self._shade = (0.55 + 0.45 * np.cos(angle)).astype(np.float32)[..., None]
        self._column = angle / (2 * math.pi) * around
        self._row = np.repeat(np.arange(rows, dtype=np.float32)[:, None], columns, axis=1)

    def picture(self, aspect_rad: float) -> tuple[np.ndarray, np.ndarray]:
        """What is seen of it, (rows, columns, 3), and its mask, turned by an angle."""
        around = self._surface.shape[1]
        columns = (self._column + aspect_rad / (2 * math.pi) * around) % around
        seen = cv2.remap(
            self._surface, columns.astype(np.float32), self._row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP
        )
        return (seen * self._shade).astype(np.uint8), self.mask

    def width_m(self, aspect_rad: float) -> float:
        """Width as seen when turned by an angle."""
        return 2 * self._radius * self.height_m * self.squeeze(aspect_rad)

    def squeeze(self, aspect_rad: float) -> float:
        """How much narrower than from the front it looks."""
        return math.hypot(math.cos(aspect_rad), self._flat * math.sin(aspect_rad))


def blotches(rng: np.random.Generator, rows: int, columns: int, base: Sequence[float]) -> np.ndarray:
    """Paint (rows, columns, 3) that varies about a colour, as float."""
    picture = np.full((rows, columns, 3), base, np.float32)
    for shrink, strength in ((32, 14), (8, 10), (2, 6)):
        small = rng.standard_normal((max(2, rows // shrink), max(2, columns // shrink), 3), np.float32)
        picture += strength * cv2.resize(small, (columns, rows), interpolation=cv2.INTER_CUBIC)
    return picture


def _print(rng: np.random.Generator, rows: int, around: int) -> np.ndarray:
    """What is on cloth, (rows, columns, 3), to be added: patches of another tone, some 8 cm large, and finer folds."""
    picture = blotches(rng, rows, around, (0, 0, 0))
    for _ in range(60):
        row, column = int(rng.integers(0, rows - 4)), int(rng.integers(0, around - 8))
        picture[row : row + int(rng.integers(2, 6)), column : column + int(rng.integers(3, 12))] += rng.uniform(-70, 70)
    return picture


def _stops(stops: Sequence[tuple[float, float]]) -> np.ndarray:
    at, radius = zip(*stops, strict=True)
    return np.interp(np.linspace(0.0, 1.0, ROWS), at, radius)


_PERSON = ((0.0, 0.03), (0.03, 0.05), (0.10, 0.05), (0.13, 0.03), (0.16, 0.11), (0.2, 0.14), (0.5, 0.12))
_LEGS = ((0.55, 0.12), (0.75, 0.09), (0.98, 0.07), (1.0, 0.09))
_HEAD = ((0.0, 0.12), (0.15, 0.3), (0.45, 0.36), (0.75, 0.3), (0.92, 0.18), (1.0, 0.17))
_BIN = ((0.0, 0.36), (0.06, 0.36), (0.07, 0.33), (0.97, 0.25), (1.0, 0.25))


def person(rng: np.random.Generator, paint: dict[str, np.ndarray] | None = None) -> tuple[Solid, dict[str, np.ndarray]]:
    """A person of 1.75 m in drawn clothes, and the paint, for another in the same clothes, whose folds are other ones.

    Args:
        rng: draws them.
        paint: of somebody else.
    """
    names = ("skin", "hair", "shirt", "pack", "trousers", "mark")
    colours = paint or {name: rng.uniform(20, 230, 3) for name in names}
    around = 192
    surface = np.empty((ROWS, around, 3), np.float32)
    angle = np.abs((np.arange(around) / around * 2 * math.pi + math.pi) % (2 * math.pi) - math.pi)
    front = angle < 1.4
    surface[:13] = np.where(front[None, :, None], colours["skin"], colours["hair"])
    surface[:4] = colours["hair"]
    surface[13:52] = np.where((angle < 1.9)[None, :, None], colours["shirt"], colours["pack"])
    surface[52:] = colours["trousers"]
    surface[22:34, angle < 0.5] = colours["mark"]
    surface[40:46, (angle > 2.2) & (angle < 3.0)] = colours["mark"]
    for row in (6, 7):
        surface[row, (angle > 0.25) & (angle < 0.55)] = 20
    surface[55:, angle < 0.12] *= 0.5
    surface[55:, angle > 3.0] *= 0.5
    surface[13:] += _print(rng, ROWS - 13, around)  # clothes have folds, seams and prints
    return Solid(np.clip(surface, 0, 255).astype(np.uint8), _stops((*_PERSON, *_LEGS)), 1.75, 0.65), colours


def head(rng: np.random.Generator) -> Solid:
    """A face with hair behind, 0.28 m high."""
    around = 256
    surface = np.empty((ROWS, around, 3), np.float32)
    skin, hair = np.array([120, 160, 210]) * rng.uniform(0.6, 1.05), rng.uniform(15, 90, 3)
    angle = (np.arange(around) / around * 2 * math.pi + math.pi) % (2 * math.pi) - math.pi
    turned = np.abs(angle)
    surface[:] = np.where((turned < 1.5)[None, :, None], skin, hair)
    surface[:22] = hair
    for side in (-0.42, 0.42):
        eye = np.abs(angle - side) < 0.17
        surface[34:37, np.abs(angle - side) < 0.24] = hair * 0.8
        surface[41:46, eye] = (235, 235, 235)
        surface[41:46, np.abs(angle - side) < 0.07] = (40, 30, 25)
    surface[44:60, turned < 0.08] = skin * 0.8
    surface[60:62, turned < 0.16] = skin * 0.6
    surface[69:73, turned < 0.34] = (70, 60, 160)
    surface[40:60, (turned > 1.35) & (turned < 1.6)] = skin * 0.75
    surface[86:] = rng.uniform(30, 220, 3)
    surface += blotches(rng, ROWS, around, (0, 0, 0)) * 0.35
    return Solid(np.clip(surface, 0, 255).astype(np.uint8), _stops(_HEAD), 0.28, 0.95)


def bin_(rng: np.random.Generator) -> Solid:
    """A recycling bin of 0.35 m: a tapered tub with a rim, a sign on its front, another behind."""
    around = 256
    body = rng.uniform(30, 200, 3)
    surface = blotches(rng, ROWS, around, body.tolist())
    angle = (np.arange(around) / around * 2 * math.pi + math.pi) % (2 * math.pi) - math.pi
    surface[:7] = body * 0.6
    surface[30:66, np.abs(angle) < 0.55] = (230, 230, 230)
    ring = np.hypot(np.arange(ROWS)[:, None] - 48, (angle * around / (2 * math.pi))[None, :])
    surface[(ring > 7) & (ring < 13)] = (30, 140, 40)
    surface[38:58, np.abs(np.abs(angle) - math.pi) < 0.4] = rng.uniform(20, 230, 3)
    surface[20:90:10] *= 0.85
    return Solid(np.clip(surface, 0, 255).astype(np.uint8), _stops(_BIN), 0.35)


def pillar(rng: np.random.Generator, width_m: float, height_m: float) -> Solid:
    """A round pillar, or a big bin: what hides a target."""
    surface = blotches(rng, ROWS, 128, rng.uniform(60, 190, 3).tolist())
    surface[::9] *= 0.7
    return Solid(np.clip(surface, 0, 255).astype(np.uint8), np.full(ROWS, width_m / height_m / 2), height_m)
