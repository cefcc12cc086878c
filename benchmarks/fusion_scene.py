"""Rendered sequences with exact truth: a painted box with six different sides, and what makes following it hard.

A solid box turns about its axes in front of ground that the camera pans over, under weak perspective: a side that turns
away takes its picture with it, another comes into view. Hardships, each of a strength drawn with the sequence: size,
rotation out of the plane, occlusion, motion blur, light, things that look alike, shake.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import cv2
import numpy as np

from common.tracking.base import Box

WIDTH, HEIGHT = 480, 360
RATE_HZ = 20.0
HARDSHIPS = ("scale", "rotation", "occlusion", "blur", "light", "distractors", "shake")
_MARGIN = 260
"""Ground beyond the picture's edges that the camera may pan over, px."""
_VISIBLE = 0.35
"""Share of the target that must be seen for it to count as visible."""
_TEXTURE = 48
"""Side of the picture on each side of a box, px."""
_NOISE = 7.0
"""Standard deviation of the sensor's noise, grey levels."""
_NOISE_PLACES = 96
"""Rows and columns by which the field of noise is larger than a picture."""

Wave = Callable[[float], float]


@dataclass(frozen=True)
class Sequence:
    """One sequence, described wholly by its seed."""

    name: str
    hardships: tuple[str, ...]
    seed: tuple[int, ...]
    frames: int

    def pictures(self) -> Iterator[tuple[np.ndarray, Box | None]]:
        """Picture (H, W, 3) uint8 and the target's upright box, None while it is hidden, at `RATE_HZ`."""
        return _Stage(self).pictures()


def sequences(seed: int, frames: int) -> list[Sequence]:
    """Each hardship with a lesser one beside it, then mixtures of three; all from one seed."""
    rng = np.random.default_rng(seed)
    chosen = [(h,) for h in HARDSHIPS]
    while len(chosen) < 14:
        three = tuple(sorted(rng.choice(len(HARDSHIPS), 3, replace=False).tolist()))
        named = tuple(HARDSHIPS[i] for i in three)
        if named not in chosen:
            chosen.append(named)
    return [Sequence("+".join(h), h, (seed, index), frames) for index, h in enumerate(chosen)]


def _wave(rng: np.random.Generator, size: float, period_s: tuple[float, float]) -> Wave:
    """A sum of three sines of random phases that starts at zero, of about this size."""
    periods, phases = rng.uniform(*period_s, 3), rng.uniform(0, 2 * math.pi, 3)
    parts = rng.dirichlet(np.ones(3)) * size
    return lambda t: float((parts * (np.sin(2 * math.pi * t / periods + phases) - np.sin(phases))).sum())


def _texture(rng: np.random.Generator, base: np.ndarray) -> np.ndarray:
    """A side's picture: its colour, soft blotches, some marks."""
    picture = np.full((_TEXTURE, _TEXTURE, 3), base, np.float32)
    soft = cv2.GaussianBlur(rng.standard_normal((_TEXTURE, _TEXTURE, 3)).astype(np.float32), (0, 0), 4.0)
    picture += 22.0 * soft / soft.std()
    for _ in range(rng.integers(2, 5)):
        corner, side = rng.integers(0, _TEXTURE - 12, 2), rng.integers(6, 26, 2)
        colour = np.clip(base + rng.normal(0.0, 55.0, 3), 10, 245)
        cv2.rectangle(picture, corner.tolist(), (corner + side).tolist(), colour.tolist(), -1)
    return np.clip(picture, 0, 255).astype(np.uint8)


def _ground(rng: np.random.Generator) -> np.ndarray:
    """Blotched ground with things on it, larger than the picture."""
    rows, columns = HEIGHT + 2 * _MARGIN, WIDTH + 2 * _MARGIN
    ground = np.full((rows, columns, 3), rng.uniform(80, 150, 3), np.float32)
    for sigma, strength in ((40, 16), (8, 14), (2, 12)):
        small = rng.standard_normal((rows // sigma * 2 + 2, columns // sigma * 2 + 2, 3), np.float32)
        ground += strength * cv2.resize(small, (columns, rows), interpolation=cv2.INTER_CUBIC)
    for _ in range(60):
        center = (float(rng.uniform(0, columns)), float(rng.uniform(0, rows)))
        shape = (center, rng.uniform(10, 90, 2).tolist(), float(rng.uniform(0, 180)))
        corners = cv2.boxPoints(shape).astype(np.int32)
        cv2.fillPoly(ground, [corners], rng.uniform(30, 220, 3).tolist())
    return np.clip(cv2.GaussianBlur(ground, (0, 0), 0.8), 0, 255).astype(np.uint8)


_CORNERS = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], float) / 2
_SIDES = ((0, 1, 3, 2), (5, 4, 6, 7), (4, 0, 2, 6), (1, 5, 7, 3), (4, 5, 1, 0), (2, 3, 7, 6))
"""Corners of each side, in order around it from the upper left, as seen from outside."""


@dataclass(frozen=True)
class _Solid:
    """A box with a picture on each side."""

    size_px: np.ndarray
    textures: list[np.ndarray]

    def corners(self, angles: tuple[float, float, float], scale: float) -> np.ndarray:
        """Corners (8, 3) about the centre, x right, y down, z away, after yaw, pitch and roll, rad."""
        (cy, sy), (cp, sp), (cr, sr) = ((math.cos(a), math.sin(a)) for a in angles)
        yaw = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
        pitch = np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])
        roll = np.array([[cr, -sr, 0], [sr, cr, 0], [0, 0, 1]])
        return scale * (_CORNERS * self.size_px) @ (roll @ pitch @ yaw).T

    def draw(self, frame: np.ndarray, mask: np.ndarray, center: np.ndarray, corners: np.ndarray, value: int) -> None:
        """Paint it into the frame (H, W, 3), and its number into the mask (H, W)."""
        flat = corners[:, :2] + center
        low = np.maximum(0, np.floor(flat.min(axis=0)) - 1).astype(int)
        high = np.minimum((WIDTH, HEIGHT), np.ceil(flat.max(axis=0)) + 2).astype(int)
        if (high <= low).any():
            return
        part = frame[low[1] : high[1], low[0] : high[0]]
        marks = mask[low[1] : high[1], low[0] : high[0]]
        side = (int(high[0] - low[0]), int(high[1] - low[1]))
        source = np.array([[0, 0], [_TEXTURE, 0], [0, _TEXTURE]], np.float32) - 0.5
        for index, texture in zip(_SIDES, self.textures, strict=True):
            across, down = corners[index[1]] - corners[index[0]], corners[index[3]] - corners[index[0]]
            normal = np.cross(across, down)
            if normal[2] <= 1e-6:  # turned away
                continue
            where = (flat[[index[0], index[1], index[3]]] - low).astype(np.float32)
            matrix = cv2.getAffineTransform(source, where)
            shade = 0.7 + 0.3 * normal[2] / float(np.linalg.norm(normal))
            seen = cv2.warpAffine(np.full((_TEXTURE, _TEXTURE), 255, np.uint8), matrix, side) > 127
            picture = cv2.warpAffine(texture, matrix, side, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            part[seen] = np.clip(picture[seen] * shade, 0, 255)
            marks[seen] = value


def _solid(rng: np.random.Generator, like: _Solid | None = None) -> _Solid:
    """A new one, or one of the same paint, half of its sides the same and half with other marks."""
    if like is None:
        base = rng.uniform(40, 210, 3)
        height = rng.uniform(52, 72)
        width = height * rng.uniform(0.6, 1.1)
        size = np.array([width, height, width * rng.uniform(0.8, 1.0)])
        return _Solid(size, [_texture(rng, np.clip(base + rng.normal(0, 25, 3), 20, 235)) for _ in _SIDES])
    textures = [t if rng.random() < 0.5 else _texture(rng, t.mean(axis=(0, 1))) for t in like.textures]
    return _Solid(like.size_px * rng.uniform(0.9, 1.1, 3), textures)


@dataclass
class _Stage:
    """What a sequence draws on."""

    sequence: Sequence
    rng: np.random.Generator = field(init=False)

    def __post_init__(self) -> None:
        self.rng = rng = np.random.default_rng(self.sequence.seed)
        hard = {
            h: (rng.uniform(0.75, 1.0) if h in self.sequence.hardships else rng.uniform(0.0, 0.1)) for h in HARDSHIPS
        }
        self.hard = hard
        self.duration_s = self.sequence.frames / RATE_HZ
        self.ground = _ground(rng)
        self.target = _solid(rng)
        self.path = _wave(rng, 170.0, (2.5, 6.0)), _wave(rng, 110.0, (2.5, 6.0))
        self.pan = _wave(rng, 80.0, (4.0, 9.0)), _wave(rng, 60.0, (4.0, 9.0))
        self.grow = _wave(rng, 1.0 * hard["scale"], (5.0, 10.0))
        turn = hard["rotation"]
        self.turns = tuple(_wave(rng, most * turn, (5.0, 10.0)) for most in (2.4, 0.3, 0.25))
        self.light = _wave(rng, 0.8 * hard["light"], (1.5, 5.0))
        self.shadow = rng.uniform(0, 2 * math.pi), hard["light"]
        self.hides = self._events(2 if hard["occlusion"] > 0.5 else 0, 0.8, 1.8)
        self.flicker = self._events(2 if hard["light"] > 0.5 else 0, 0.4, 1.0)
        self.blurs = self._events(3 if hard["blur"] > 0.5 else 0, 0.5, 1.5)
        self.occluder = _solid(rng)
        # One field, read at another place for each picture: drawing anew costs as much as a tracker.
        places = (HEIGHT + _NOISE_PLACES, WIDTH + _NOISE_PLACES, 3)
        self.noise = np.float32(_NOISE) * rng.standard_normal(places, np.float32)
        self.others = [_solid(rng, self.target) for _ in range(round(4 * hard["distractors"]))]
        self.other_paths = [(_wave(rng, 150.0, (3.0, 6.0)), _wave(rng, 90.0, (3.0, 6.0))) for _ in self.others]
        self.starts = [rng.uniform([60, 60], [WIDTH - 60, HEIGHT - 60]) for _ in self.others]
        self.passes = [rng.uniform(0.25, 0.9) * self.duration_s for _ in self.others]

    def _events(self, count: int, shortest_s: float, longest_s: float) -> list[tuple[float, float]]:
        """Begin and length, s, of events spread over the sequence, none in its first tenth."""
        share = 0.9 * self.duration_s / max(count, 1)
        lengths = self.rng.uniform(shortest_s, longest_s, count)
        begins = 0.1 * self.duration_s + share * (np.arange(count) + self.rng.uniform(0.0, 0.6, count))
        return list(zip(begins.tolist(), lengths.tolist(), strict=True))

    def pictures(self) -> Iterator[tuple[np.ndarray, Box | None]]:
        jitter, before = np.zeros(2), None
        for number in range(self.sequence.frames):
            t_s = number / RATE_HZ
            if number:
                kick = self.rng.normal(0.0, 1.0, 2) * 12.0 * self.hard["shake"]
                if self.rng.random() < 0.1 * self.hard["shake"]:
                    kick += self.rng.normal(0.0, 45.0, 2)
                jitter = np.clip(0.7 * jitter + kick, -110, 110)
            view = np.array([self.pan[0](t_s), self.pan[1](t_s)]) + jitter
            center = np.array([WIDTH / 2 + self.path[0](t_s), HEIGHT / 2 + self.path[1](t_s)])
            center = np.clip(center, 45, np.array([WIDTH, HEIGHT]) - 45) + jitter
            frame, mask = self._ground_at(view), np.zeros((HEIGHT, WIDTH), np.uint8)
            self._draw_others(frame, mask, t_s, center, jitter)
            turns = self.turns[0](t_s), self.turns[1](t_s), self.turns[2](t_s)
            corners = self.target.corners(turns, math.exp(self.grow(t_s)))
            self.target.draw(frame, mask, center, corners, 1)
            whole = max(1, int((mask == 1).sum()))
            self._hide(frame, mask, t_s, center, corners)
            seen = int((mask == 1).sum()) / whole
            low, high = corners[:, :2].min(axis=0) + center, corners[:, :2].max(axis=0) + center
            inside = np.maximum(0, np.minimum(high, (WIDTH, HEIGHT)) - np.maximum(low, 0)).prod() / (high - low).prod()
            box = (float(low[0]), float(low[1]), float(high[0] - low[0]), float(high[1] - low[1]))
            moved = np.zeros(2) if before is None else center - before
            before = center
            yield self._exposed(frame, t_s, moved), box if seen * inside >= _VISIBLE else None

    def _ground_at(self, view: np.ndarray) -> np.ndarray:
        matrix = np.array([[1.0, 0.0, _MARGIN - view[0]], [0.0, 1.0, _MARGIN - view[1]]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        return cv2.warpAffine(self.ground, matrix, (WIDTH, HEIGHT), flags=flags, borderMode=cv2.BORDER_REFLECT)

    def _draw_others(
        self, frame: np.ndarray, mask: np.ndarray, t_s: float, center: np.ndarray, jitter: np.ndarray
    ) -> None:
        for other, path, start, meets_s in zip(self.others, self.other_paths, self.starts, self.passes, strict=True):
            place = start + np.array([path[0](t_s), path[1](t_s)]) + jitter
            near = math.exp(-(((t_s - meets_s) / 0.8) ** 2))  # comes close beside the target once
            place = (1 - near) * place + near * (center + np.array([1.1 * self.target.size_px[0], 8.0]))
            turns = tuple(0.7 * turn(t_s + 1.0) for turn in self.turns)
            other.draw(frame, mask, place, other.corners((turns[0], turns[1], turns[2]), 1.0), 2)

    def _hide(self, frame: np.ndarray, mask: np.ndarray, t_s: float, center: np.ndarray, corners: np.ndarray) -> None:
        reach = float(np.abs(corners[:, :2]).max()) * 2.6
        for begin_s, length_s in self.hides:
            along = (t_s - begin_s) / length_s
            if -0.5 <= along <= 1.5:
                offset = np.array([2.4 * (along - 0.5) * reach, 0.1 * reach])
                slab = self.occluder.corners((0.0, 0.0, 0.1), 1.0) / self.occluder.size_px.max() * reach
                self.occluder.draw(frame, mask, center + offset, slab, 3)

    def _exposed(self, frame: np.ndarray, t_s: float, moved: np.ndarray) -> np.ndarray:
        """Motion blur, light and noise."""
        length = 0.5 * float(np.hypot(*moved)) * self.hard["blur"]
        if any(b <= t_s < b + n for b, n in self.blurs):
            length += 30.0 * self.hard["blur"]
        if length > 1.5:
            frame = cv2.filter2D(frame, -1, _streak(length, math.atan2(moved[1], moved[0])))
        gain = math.exp(min(0.5, self.light(t_s)))
        if any(b <= t_s < b + n for b, n in self.flicker):
            gain *= 0.2
        angle, strength = self.shadow
        x, y = np.linspace(-1, 1, WIDTH, dtype=np.float32), np.linspace(-1, 1, HEIGHT, dtype=np.float32)[:, None]
        slope = 1.0 + 0.7 * strength * (x * math.cos(angle + 0.8 * t_s) + y * math.sin(angle + 0.8 * t_s))
        lit = frame * (np.float32(gain) * slope)[..., None]
        row, column = self.rng.integers(0, _NOISE_PLACES, 2)
        lit += self.noise[row : row + HEIGHT, column : column + WIDTH]
        return np.clip(lit, 0, 255).astype(np.uint8)


def _streak(length: float, angle_rad: float) -> np.ndarray:
    """Kernel of motion blur along a direction."""
    side = math.ceil(length) | 1
    kernel = np.zeros((side, side), np.float32)
    middle = (side - 1) / 2
    offset = np.array([math.cos(angle_rad), math.sin(angle_rad)]) * length / 2
    ends = [tuple(np.round(middle + sign * offset).astype(int).tolist()) for sign in (-1, 1)]
    cv2.line(kernel, ends[0], ends[1], 1.0)
    return kernel / kernel.sum()
