"""Skin, face, hair and clothes of a person of the simulated world: one picture a person, laid out by `body.TILES`.

A tile is wrapped around its part: the middle column is the front, the borders meet at the back; rows run from the
first ring of the part to the last, which is downwards for all but the feet (heel to toe).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from simulation.world.body import TILES
from simulation.world.textures import Field, Picture, Rgb, value_noise

SIZE_PX = 512


@dataclass(frozen=True)
class Outfit:
    """Colours (red, green, blue, 0 to 255) and cut."""

    skin: Rgb
    """Of face, neck, hands, and what the clothes leave bare."""
    hair: Rgb
    """Of hair and brows."""
    shirt: Rgb
    """Of the upper body."""
    trousers: Rgb
    """Of the legs."""
    shoes: Rgb
    """Of the feet."""
    short_sleeves: bool = False
    """Whether the forearms are bare."""
    shorts: bool = False
    """Whether the shins are bare."""
    pattern: int = 0
    """The shirt: 0 plain, 1 buttons, 2 stripes across, 3 an open jacket over a light shirt, 4 a print."""


def paint(rng: np.random.Generator, outfit: Outfit) -> Picture:
    """The picture (512, 512, 3), RGB, of a person.

    Args:
        rng: creases and threads.
        outfit: colours and cut.
    """
    picture = np.zeros((SIZE_PX, SIZE_PX, 3), np.uint8)
    painters = {
        "head": _head,
        "chest": _chest,
        "pelvis": _pelvis,
        "thigh": lambda r, o, s: _cloth(r, o.trousers, s, 0.22),
        "shin": _shin,
        "upper_arm": _upper_arm,
        "forearm": _forearm,
        "hand": _hand,
        "foot": _foot,
        "hair": lambda r, o, s: _strands(r, o.hair, s),
    }
    for name, (left, top, right, bottom) in TILES.items():
        x0, y0, x1, y1 = (round(SIZE_PX * edge) for edge in (left, top, right, bottom))
        picture[y0:y1, x0:x1] = painters[name](rng, outfit, x1 - x0)
    return picture


def _shaded(colour: Rgb, factor: Field) -> Picture:
    return np.clip(np.array(colour, np.float32) * factor[..., None], 0, 255).astype(np.uint8)


def _cloth(rng: np.random.Generator, colour: Rgb, side: int, depth: float) -> Picture:
    """Cloth with creases: soft folds, and threads."""
    folds = value_noise(rng, side, 4, 3) - 0.5
    threads = rng.normal(0.0, 0.02, (side, side)).astype(np.float32)
    return _shaded(colour, 1.0 + 2.0 * depth * folds + threads)


def _skin(rng: np.random.Generator, colour: Rgb, side: int) -> Picture:
    return _shaded(colour, 1.0 + 0.10 * (value_noise(rng, side, 3, 3) - 0.5))


def _strands(rng: np.random.Generator, colour: Rgb, side: int) -> Picture:
    """Hair: light and dark strands that run down."""
    strands = np.repeat(rng.normal(1.0, 0.22, (1, side)), side, axis=0).astype(np.float32)
    waves = value_noise(rng, side, 4, 2)
    return _shaded(colour, np.clip(strands * (0.75 + 0.5 * waves), 0.3, 2.0).astype(np.float32))


def _dark(colour: Rgb, factor: float) -> Rgb:
    r, g, b = (int(min(255.0, c * factor)) for c in colour)
    return r, g, b


def _head(rng: np.random.Generator, outfit: Outfit, side: int) -> Picture:
    """Face, ears' shade, neck. The head's rings run from the crown (row 0) over the chin (0.70) to the neck."""
    tile = _skin(rng, outfit.skin, side)
    middle = side / 2

    def at(turn: float, height: float) -> tuple[int, int]:
        """Pixel at a turn from the front, rad, and a height in the head's frame, in body heights."""
        row = 0.05 + 0.9 * (0.170 - height) / (0.170 + 0.024)
        return round(middle + 0.9 * side * turn / (2 * np.pi)), round(row * side)

    def blob(turn: float, height: float, wide: float, high: float, colour: Rgb, soft: float = 0.0) -> None:
        nonlocal tile
        layer = np.zeros((side, side), np.float32)
        cv2.ellipse(
            layer, at(turn, height), (max(1, round(wide * side)), max(1, round(high * side))), 0, 0, 360, 1.0, -1
        )
        if soft:
            layer = np.asarray(cv2.GaussianBlur(layer, (0, 0), soft * side), np.float32)
        mixed = tile + (np.array(colour, np.float32) - tile) * layer[..., None]
        tile = np.clip(mixed, 0, 255).astype(np.uint8)

    skin = outfit.skin
    red = (int(min(255, skin[0] * 1.02)), int(skin[1] * 0.86), int(skin[2] * 0.84))
    for sign in (-1.0, 1.0):
        blob(sign * 0.62, 0.078, 0.045, 0.045, red, 0.025)  # cheeks
        blob(sign * 0.40, 0.101, 0.042, 0.026, _dark(skin, 0.62), 0.014)  # sockets
        blob(sign * 0.40, 0.099, 0.030, 0.013, (236, 232, 226))
        blob(sign * 0.39, 0.099, 0.011, 0.013, (42, 30, 22))
        blob(sign * 0.42, 0.1125, 0.042, 0.007, _dark(outfit.hair, 0.8), 0.004)  # brows
        blob(sign * 0.14, 0.073, 0.013, 0.006, _dark(skin, 0.45), 0.005)  # nostrils
        blob(sign * 0.20, 0.085, 0.012, 0.030, _dark(skin, 0.78), 0.01)  # sides of the nose
    blob(0.0, 0.090, 0.010, 0.040, _dark(skin, 1.14), 0.008)
    blob(0.0, 0.0585, 0.052, 0.010, (int(skin[0] * 0.80), int(skin[1] * 0.50), int(skin[2] * 0.50)), 0.004)
    blob(0.0, 0.0590, 0.050, 0.003, _dark(skin, 0.35), 0.002)
    blob(0.0, 0.047, 0.04, 0.006, _dark(skin, 0.8), 0.01)
    below = slice(round(side * 0.72), side)  # shade under the chin, then the collar
    tile[below] = np.clip(tile[below] * 0.78, 0, 255).astype(np.uint8)
    tile[round(side * 0.90) :] = np.array(_dark(outfit.shirt, 0.9), np.uint8)
    return tile


def _chest(rng: np.random.Generator, outfit: Outfit, side: int) -> Picture:
    tile = _cloth(rng, outfit.shirt, side, 0.20)
    middle, quarter = side // 2, side // 4
    if outfit.pattern == 1:
        cv2.line(tile, (middle, 0), (middle, side), _dark(outfit.shirt, 0.6), 2)
        for row in range(quarter // 2, side, quarter // 2):
            cv2.circle(tile, (middle + 4, row), 3, (235, 235, 228), -1)
    elif outfit.pattern == 2:
        for row in range(0, side, side // 8):
            tile[row : row + side // 16] = np.clip(tile[row : row + side // 16] * 0.45 + 20, 0, 255).astype(np.uint8)
    elif outfit.pattern == 3:
        light = _cloth(rng, (222, 218, 208), side, 0.12)
        half = round(side * 0.06)
        tile[:, middle - half : middle + half] = light[:, middle - half : middle + half]
        for edge in (middle - half, middle + half):
            cv2.line(tile, (edge, 0), (edge, side), _dark(outfit.shirt, 0.45), 3)
    elif outfit.pattern == 4:
        bright = (235, 226, 120) if sum(outfit.shirt) < 380 else (40, 44, 60)
        cv2.circle(tile, (middle, round(side * 0.45)), round(side * 0.085), bright, -1)
        cv2.putText(tile, "07", (side - quarter // 2, side // 2), cv2.FONT_HERSHEY_SIMPLEX, 1.2, bright, 4)
    collar = round(side * 0.17)
    cv2.ellipse(tile, (middle, 0), (round(side * 0.11), collar), 0, 0, 360, outfit.skin, -1)
    cv2.ellipse(tile, (middle, 0), (round(side * 0.11), collar), 0, 0, 360, _dark(outfit.shirt, 0.55), 3)
    # Under the arms it is darker: no light gets between arm and trunk.
    shade = np.ones(side, np.float32)
    for column in (quarter, side - quarter):
        distance = np.abs(np.arange(side) - column) / side
        shade -= 0.38 * np.exp(-((distance / 0.07) ** 2)).astype(np.float32)
    return np.clip(tile * shade[None, :, None], 0, 255).astype(np.uint8)


def _pelvis(rng: np.random.Generator, outfit: Outfit, side: int) -> Picture:
    tile = _cloth(rng, outfit.trousers, side, 0.22)
    tile[: round(side * 0.18)] = _cloth(rng, outfit.shirt, side, 0.2)[: round(side * 0.18)]
    belt = slice(round(side * 0.18), round(side * 0.27))
    tile[belt] = np.array(_dark(outfit.shoes, 0.8), np.uint8)
    cv2.rectangle(tile, (side // 2 - 4, belt.start), (side // 2 + 4, belt.stop), (190, 180, 150), -1)
    cv2.line(tile, (side // 2, belt.stop), (side // 2, side), _dark(outfit.trousers, 0.6), 2)
    return tile


def _shin(rng: np.random.Generator, outfit: Outfit, side: int) -> Picture:
    if not outfit.shorts:
        return _cloth(rng, outfit.trousers, side, 0.26)
    tile = _skin(rng, outfit.skin, side)
    tile[round(side * 0.84) :] = _cloth(rng, (216, 214, 208), side, 0.1)[round(side * 0.84) :]
    return tile


def _upper_arm(rng: np.random.Generator, outfit: Outfit, side: int) -> Picture:
    tile = _cloth(rng, outfit.shirt, side, 0.22)
    if outfit.short_sleeves:
        hem = round(side * 0.62)
        tile[hem:] = _skin(rng, outfit.skin, side)[hem:]
        tile[hem - 3 : hem] = np.array(_dark(outfit.shirt, 0.5), np.uint8)
    return tile


def _forearm(rng: np.random.Generator, outfit: Outfit, side: int) -> Picture:
    if outfit.short_sleeves:
        return _skin(rng, outfit.skin, side)
    tile = _cloth(rng, outfit.shirt, side, 0.24)
    cuff = round(side * 0.90)
    tile[cuff:] = np.array(_dark(outfit.shirt, 0.6), np.uint8)
    return tile


def _hand(rng: np.random.Generator, outfit: Outfit, side: int) -> Picture:
    tile = _skin(rng, outfit.skin, side)
    for column in np.linspace(0.3, 0.7, 4):  # fingers
        for offset in (0.0, 0.5):
            x = round(side * ((column * 0.5 + offset) % 1.0))
            cv2.line(tile, (x, round(side * 0.62)), (x, side), _dark(outfit.skin, 0.6), 1)
    return tile


def _foot(rng: np.random.Generator, outfit: Outfit, side: int) -> Picture:
    """A shoe: upper, laces on top (the middle), a light sole below (the borders)."""
    tile = _cloth(rng, outfit.shoes, side, 0.1)
    sole = round(side * 0.17)
    tile[:, :sole] = tile[:, side - sole :] = (196, 192, 184)
    for row in np.linspace(0.40, 0.62, 4):
        y = round(side * row)
        cv2.line(tile, (side // 2 - side // 10, y), (side // 2 + side // 10, y), (222, 220, 214), 2)
    return tile
