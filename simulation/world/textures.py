"""Procedural textures: RGB pictures made from a random generator, with no file behind them.

All return (N, N, 3) uint8 RGB unless said otherwise; tiles repeat without a seam.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]
Field = NDArray[np.float32]
Rgb = tuple[int, int, int]


def value_noise(
    rng: np.random.Generator, size_px: int, cells: int, octaves: int = 4, persistence: float = 0.55
) -> Field:
    """Smooth random field (size, size), about 0 to 1, that repeats without a seam.

    Args:
        rng: source of randomness.
        size_px: side of the field, px.
        cells: number of cells of the coarsest octave along a side; each further octave doubles it.
        octaves: number of octaves.
        persistence: amplitude of an octave relative to the one before.
    """
    field = np.zeros((size_px, size_px), np.float32)
    amplitude = total = 1.0
    for octave in range(octaves):
        count = min(cells * 2**octave, size_px)
        grid = rng.random((count, count), dtype=np.float32)
        field += amplitude * _periodic_resize(grid, size_px)
        total += amplitude
        amplitude *= persistence
    field -= field.min()
    return field / max(float(field.max()), 1e-6)


def _periodic_resize(grid: Field, size_px: int) -> Field:
    """Grid enlarged to (size, size) with its borders wrapped."""
    count = len(grid)
    if count == size_px:
        return grid
    padded = np.pad(grid, 2, mode="wrap")
    scale = size_px / count
    large = np.asarray(cv2.resize(padded, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC), np.float32)
    margin = round(2 * scale)
    return large[margin : margin + size_px, margin : margin + size_px]


def blend(low: Rgb, high: Rgb, amount: Field) -> Picture:
    """Colour field (…, 3) between two colours, by an amount of 0 to 1."""
    a, b = np.array(low, np.float32), np.array(high, np.float32)
    return np.clip(a + (b - a) * amount[..., None], 0, 255).astype(np.uint8)


def grain(rng: np.random.Generator, size_px: int, strength: float, stretch: int = 1) -> Field:
    """Fine zero-mean grain (size, size) in grey levels, drawn out along columns by `stretch` px, repeating."""
    field = rng.standard_normal((size_px, size_px), dtype=np.float32)
    if stretch > 1:
        field = cv2.blur(np.pad(field, ((stretch, stretch), (0, 0)), mode="wrap"), (1, stretch))[stretch:-stretch]
    return field * (strength / max(float(field.std()), 1e-6))


def tufts(rng: np.random.Generator, size_px: int, count: int, strength: float) -> Field:
    """Field (size, size) of small bright and dark strokes, as grass blades seen from above, repeating."""
    field = np.zeros((size_px, size_px), np.float32)
    centres = rng.uniform(0, size_px, (count, 2))
    angles, lengths = rng.uniform(0, np.pi, count), rng.uniform(4, 14, count)
    levels = rng.normal(0, strength, count)
    for (x, y), angle, length, level in zip(centres, angles, lengths, levels, strict=True):
        dx, dy = np.cos(angle) * length / 2, np.sin(angle) * length / 2
        cv2.line(field, (int(x - dx), int(y - dy)), (int(x + dx), int(y + dy)), float(level), 1)
    return field


def leaves(rng: np.random.Generator, size_px: int, base: Rgb) -> Picture:
    """Foliage from above: overlapping small leaves in several shades of a colour."""
    shade = value_noise(rng, size_px, 4, 3)
    dark = tuple(int(c * 0.35) for c in base)
    picture = blend((dark[0], dark[1], dark[2]), base, shade * 0.6)
    count = size_px * size_px // 40
    places = rng.integers(0, size_px, (count, 2))
    shades = np.linspace(0.45, 1.3, count) * rng.uniform(0.8, 1.2, count)
    for (x, y), angle, bright in zip(places, rng.uniform(0, 180, count), shades, strict=True):
        colour = [min(255.0, float(c * bright)) for c in base]
        cv2.ellipse(picture, (int(x), int(y)), (4, 2), float(angle), 0, 360, colour, -1)
    return picture


def roof_tiles(rng: np.random.Generator, size_px: int, base: Rgb) -> Picture:
    """Rows of clay tiles, 16 by 12 of them."""
    rows, columns = 16, 12
    bright = rng.uniform(0.75, 1.1, (rows, columns)).astype(np.float32)
    tiles = cv2.resize(bright, (size_px, size_px), interpolation=cv2.INTER_NEAREST)
    picture = np.array(base, np.float32) * tiles[..., None]
    across = np.mod(np.arange(size_px) * columns / size_px, 1.0)
    down = np.mod(np.arange(size_px) * rows / size_px, 1.0)
    picture *= (0.65 + 0.35 * np.sin(np.pi * across))[None, :, None]
    picture *= np.where(down < 0.15, 0.55, 0.85 + 0.15 * down)[:, None, None]
    return np.clip(picture + grain(rng, size_px, 6)[..., None], 0, 255).astype(np.uint8)


def planks(rng: np.random.Generator, size_px: int, base: Rgb, count: int = 12) -> Picture:
    """Wooden boards side by side, their grain along columns."""
    board = (np.arange(size_px) * count // size_px).astype(int)
    picture = np.array(base, np.float32) * rng.uniform(0.75, 1.1, count)[board][None, :, None]
    picture = picture + grain(rng, size_px, 9, stretch=31)[..., None]
    picture[:, np.mod(np.arange(size_px) * count / size_px, 1.0) < 0.08] *= 0.35
    return np.clip(picture, 0, 255).astype(np.uint8)


def car_paint(rng: np.random.Generator, bonnet: Rgb, roof: Rgb, boot: Rgb, stripe: Rgb) -> Picture:
    """A car from above, (256, 512, 3): front at the right edge, its right-hand side at the bottom.

    Bonnet, roof, boot and a stripe along the right-hand side have their own colours; glass and lamps are drawn in.
    """
    height, width = 256, 512
    picture = np.empty((height, width, 3), np.uint8)
    picture[:] = roof
    picture[:, int(0.66 * width) :] = bonnet
    picture[:, : int(0.25 * width)] = boot
    picture[int(0.80 * height) :] = stripe
    _glass(picture, [(0.74, 0.09), (0.74, 0.91), (0.615, 0.83), (0.615, 0.17)])
    _glass(picture, [(0.205, 0.12), (0.205, 0.88), (0.30, 0.82), (0.30, 0.18)])
    for side in (0.085, 0.915):
        inner = 0.155 if side < 0.5 else 0.845
        _glass(picture, [(0.29, side), (0.64, side), (0.60, inner), (0.32, inner)])
    seam = tuple(int(c * 0.55) for c in bonnet)
    cv2.rectangle(picture, (int(0.77 * width), int(0.16 * height)), (int(0.95 * width), int(0.78 * height)), seam, 1)
    for y0, y1 in ((0.06, 0.20), (0.80, 0.94)):
        cv2.rectangle(picture, (int(0.965 * width), int(y0 * height)), (width, int(y1 * height)), (250, 248, 225), -1)
        cv2.rectangle(picture, (0, int(y0 * height)), (int(0.028 * width), int(y1 * height)), (150, 12, 14), -1)
    sheen = np.linspace(0.9, 1.08, height, dtype=np.float32)[:, None, None]
    noisy = picture * sheen + rng.normal(0, 2.0, (height, width, 1)).astype(np.float32)
    return np.clip(noisy, 0, 255).astype(np.uint8)


def _glass(picture: Picture, corners: list[tuple[float, float]]) -> None:
    """Draw a dark pane; corners are fractions of width and height."""
    height, width = picture.shape[:2]
    points = np.array([(int(x * width), int(y * height)) for x, y in corners], np.int32)
    cv2.fillPoly(picture, [points], (26, 32, 40))
    middle = points.mean(axis=0)
    inner = (middle + 0.8 * (points - middle)).astype(np.int32)
    cv2.fillPoly(picture, [inner], (44, 56, 68))
