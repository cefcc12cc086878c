"""The painted ground: one picture of grass, roads, markings, landing pad and shadows around home."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from simulation.world.layout import SHADOW_NE_PER_M, Layout
from simulation.world.scenario import GroundConfig, OccluderConfig
from simulation.world.textures import Picture, Rgb, blend, grain, tufts, value_noise

_STRIP_PX = 512
_TILE_PX = 1024
_COARSE_PX = 512
_SHIFT = 4  # sub-pixel bits of OpenCV's drawing functions
_SHADOW_LEVEL = 0.52
"""Brightness in full shadow, of 1."""


@dataclass(frozen=True)
class _Kind:
    low: Rgb
    high: Rgb
    patch: Rgb
    grain: float
    blades: int


_KINDS = {
    "meadow": _Kind((62, 84, 34), (112, 132, 62), (138, 122, 78), 9.0, 60_000),
    "gravel": _Kind((120, 108, 92), (164, 152, 132), (96, 88, 72), 17.0, 0),
    "snow": _Kind((205, 212, 222), (240, 244, 248), (150, 142, 128), 5.0, 4_000),
}
_TARMAC_LOW, _TARMAC_HIGH = (70, 71, 74), (98, 98, 99)
_WHITE, _PAD = (226, 226, 220), (150, 148, 142)


class GroundPainter:
    """Paints the square of `size_m` around home; rows run from north to south, columns from west to east."""

    def __init__(
        self, ground: GroundConfig, layout: Layout, occluders: tuple[OccluderConfig, ...], rng: np.random.Generator
    ):
        """
        Args:
            ground: size and kind.
            layout: roads, trees, houses.
            occluders: what throws a shadow on the road.
            rng: source of randomness.
        """
        self._ground, self._layout, self._occluders, self._rng = ground, layout, occluders, rng
        self._size_px = ground.texture_px
        self._px_per_m = ground.texture_px / ground.size_m

    def paint(self) -> Picture:
        """The picture, (texture_px, texture_px, 3) RGB."""
        kind = _KINDS[self._ground.kind]
        picture = self._meadow(kind)
        self._roads(picture)
        self._pad(picture)
        self._shadows(picture)
        return picture

    def field_tile(self) -> Picture:
        """Repeating tile (512, 512, 3) for the field around the square, in the same colours."""
        kind = _KINDS[self._ground.kind]
        tile = blend(kind.low, kind.high, 0.25 + 0.5 * value_noise(self._rng, 512, 4, 5))
        return np.clip(tile + grain(self._rng, 512, kind.grain)[..., None], 0, 255).astype(np.uint8)

    def _pixels(self, ne_points_m: NDArray[np.float64]) -> NDArray[np.int32]:
        """Points (N, 2) in metres as fixed-point pixels (N, 1, 2) for OpenCV."""
        half = self._ground.size_m / 2
        xy = np.column_stack((ne_points_m[:, 1] + half, half - ne_points_m[:, 0])) * self._px_per_m - 0.5
        return np.round(xy * 2**_SHIFT).astype(np.int32).reshape(-1, 1, 2)

    def _meadow(self, kind: _Kind) -> Picture:
        rng, size = self._rng, self._size_px
        coarse = blend(kind.low, kind.high, value_noise(rng, _COARSE_PX, 7, 6, 0.62)).astype(np.float32)
        bare = np.clip((value_noise(rng, _COARSE_PX, 9, 4) - 0.68) * 5, 0, 0.75)[..., None]
        coarse += (np.array(kind.patch, np.float32) - coarse) * bare
        picture = np.asarray(cv2.resize(coarse.astype(np.uint8), (size, size)), np.uint8)
        detail = grain(rng, _TILE_PX, kind.grain)
        if kind.blades:
            detail += tufts(rng, _TILE_PX, kind.blades, 13.0)
        # Blades vary most in green: that is what makes them look like grass and not like static.
        tinted = (detail[..., None] * np.array([0.9, 1.1, 0.6], np.float32)).astype(np.int16)
        for row in range(0, size, _TILE_PX):
            for column in range(0, size, _TILE_PX):
                block = picture[row : row + _TILE_PX, column : column + _TILE_PX]
                part = np.ascontiguousarray(tinted[: block.shape[0], : block.shape[1]])
                block[:] = cv2.add(block, part, dtype=cv2.CV_8U)
        return picture

    def _lay(self, picture: Picture, top: Picture | Rgb, alpha: NDArray[np.uint8]) -> None:
        """Lay a colour or a repeating tile over the picture, by an alpha map (size, size) of 0 to 255."""
        size = self._size_px
        tile = np.full((1, 1, 3), top, np.uint8) if isinstance(top, tuple) else top
        for row in range(0, size, _STRIP_PX):
            a = alpha[row : row + _STRIP_PX]
            columns = np.flatnonzero(a.any(axis=0))
            if not len(columns):
                continue
            window = slice(int(columns[0]), int(columns[-1]) + 1)
            below = picture[row : row + _STRIP_PX, window]
            rows = tile[np.arange(row, row + len(a)) % len(tile)]
            over = np.ascontiguousarray(np.tile(rows, (1, size // tile.shape[1] + 1, 1))[:, window])
            weight = cv2.merge([np.ascontiguousarray(a[:, window])] * 3)
            rest = cv2.multiply(below, cv2.bitwise_not(weight), scale=1 / 255)
            below[:] = cv2.add(rest, cv2.multiply(over, weight, scale=1 / 255))

    def _roads(self, picture: Picture) -> None:
        if not self._layout.roads:
            return
        size, rng = self._size_px, self._rng
        verge, tarmac, lines = (np.zeros((size, size), np.uint8) for _ in range(3))
        for road in self._layout.roads:
            points = self._pixels(road.ne_points_m)
            for mask, width in ((verge, road.width_m + 0.5), (tarmac, road.width_m)):
                cv2.polylines(mask, [points], False, 255, max(1, round(width * self._px_per_m)), cv2.LINE_AA, _SHIFT)
        for road in self._layout.roads:
            self._markings(lines, road.ne_points_m, road.width_m)
        rough = cv2.resize((value_noise(rng, _TILE_PX, 64, 4) * 255).astype(np.uint8), (size, size))
        # Alpha maps: a blurred outline plus noise, sharpened again, has a ragged edge; clipped to 0..255 by OpenCV.
        soft = cv2.blur(verge, (max(3, round(0.4 * self._px_per_m) | 1),) * 2)
        earth = cv2.addWeighted(soft, 1.6, rough, 1.6, -365)
        self._lay(picture, (112, 98, 72), np.minimum(earth, 204).astype(np.uint8))
        crisp = cv2.blur(tarmac, (max(3, round(0.05 * self._px_per_m) | 1),) * 2)
        self._lay(picture, self._tarmac_tile(), cv2.addWeighted(crisp, 3.0, rough, 1.0, -384).astype(np.uint8))
        wear = np.clip(cv2.addWeighted(rough, 2.0, rough, 0.0, -10), 70, 235).astype(np.uint8)
        self._lay(picture, _WHITE, cv2.multiply(lines, wear, scale=1 / 255).astype(np.uint8))

    def _tarmac_tile(self) -> Picture:
        rng = self._rng
        tile = blend(_TARMAC_LOW, _TARMAC_HIGH, value_noise(rng, _TILE_PX, 6, 6, 0.6)).astype(np.float32)
        tile += grain(rng, _TILE_PX, 7.0)[..., None]
        for _ in range(14):  # cracks and seams of repair
            start = rng.uniform(0, _TILE_PX, 2)
            steps = np.cumsum(rng.normal(0, 9, (26, 2)) + rng.normal(0, 6, 2), axis=0)
            crack = (start + steps).astype(np.int32).reshape(-1, 1, 2)
            cv2.polylines(tile, [crack], False, (48, 48, 50), 1, cv2.LINE_AA)
        return np.clip(tile, 0, 255).astype(np.uint8)

    def _markings(self, lines: NDArray[np.uint8], middle: NDArray[np.float64], width_m: float) -> None:
        """Edge lines and a dashed middle line."""
        along = np.gradient(middle, axis=0)
        along /= np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9)[:, None]
        normal = np.column_stack((along[:, 1], -along[:, 0]))
        thickness = max(1, round(0.045 * self._px_per_m))
        for side in (-1, 1):
            edge = self._pixels(middle + side * (width_m / 2 - 0.09) * normal)
            cv2.polylines(lines, [edge], False, 255, thickness, cv2.LINE_AA, _SHIFT)
        travelled = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(middle, axis=0).T))))
        for start in np.arange(0.0, travelled[-1], 1.1):
            dash = np.linspace(start, min(start + 0.5, travelled[-1]), 6)
            points = np.column_stack([np.interp(dash, travelled, middle[:, axis]) for axis in (0, 1)])
            cv2.polylines(lines, [self._pixels(points)], False, 255, thickness, cv2.LINE_AA, _SHIFT)

    def _pad(self, picture: Picture) -> None:
        """Concrete slab with an H at home."""
        centre = self._pixels(np.zeros((1, 2)))[0, 0]
        slab, sign = (np.zeros((self._size_px, self._size_px), np.uint8) for _ in range(2))
        corners = self._pixels(np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]))
        cv2.fillPoly(slab, [corners], 225, cv2.LINE_AA, _SHIFT)
        thickness = max(1, round(0.05 * self._px_per_m))
        radius = int(0.4 * self._px_per_m * 2**_SHIFT)
        cv2.circle(sign, (int(centre[0]), int(centre[1])), radius, 230, thickness, cv2.LINE_AA, _SHIFT)
        for a, b in (((0.22, -0.14), (-0.22, -0.14)), ((0.22, 0.14), (-0.22, 0.14)), ((0, -0.14), (0, 0.14))):
            stroke = self._pixels(np.array([a, b], dtype=float))
            cv2.polylines(sign, [stroke], False, 230, thickness, cv2.LINE_AA, _SHIFT)
        concrete = blend(_PAD, (186, 184, 178), value_noise(self._rng, 256, 16, 4))
        self._lay(picture, concrete, slab)
        self._lay(picture, _WHITE, sign)

    def _shadows(self, picture: Picture) -> None:
        """Darken what trees, houses and bridges shade from a sun in the north-west."""
        scale = max(1, self._size_px // (2 * _COARSE_PX))
        small = self._size_px // scale
        mask = np.zeros((small, small), np.uint8)
        slope = np.array(SHADOW_NE_PER_M)

        def cast(outline: NDArray[np.float64], height_m: float) -> None:
            hull = cv2.convexHull(np.concatenate((outline, outline + slope * height_m)).astype(np.float32))
            pixels = self._pixels(hull.reshape(-1, 2).astype(float)) // scale
            cv2.fillPoly(mask, [pixels], 255, cv2.LINE_AA, _SHIFT)

        circle = np.column_stack((np.cos(np.linspace(0, 6.28, 14)), np.sin(np.linspace(0, 6.28, 14))))
        for tree in self._layout.trees:
            crown = np.array(tree.ne_m) + circle * tree.radius_m * 0.95
            cast(crown + slope * (tree.height_m - 0.3 * tree.radius_m), 0.6 * tree.radius_m)
            cast(np.array(tree.ne_trunk_m) + circle * 0.09 * max(tree.radius_m, 0.4), tree.height_m)
        for house in self._layout.houses:
            walls = _rectangle(house.ne_m, house.length_m, house.width_m, house.heading_rad)
            cast(walls, house.wall_m + 0.4 * house.rise_m)
        for occluder in self._occluders:
            if occluder.kind == "bridge":
                deck = _rectangle(
                    (occluder.north_m, occluder.east_m),
                    occluder.span_m,
                    occluder.width_m,
                    np.deg2rad(occluder.heading_deg),
                )
                cast(deck + slope * occluder.height_m, 0.08)
        soft = cv2.blur(mask, (max(3, round(0.12 * self._px_per_m / scale) | 1),) * 2)
        light = 255 - (soft * (1.0 - _SHADOW_LEVEL)).astype(np.uint8)
        light = cv2.resize(light, (self._size_px, self._size_px), interpolation=cv2.INTER_LINEAR)
        for row in range(0, self._size_px, _STRIP_PX):
            strip, shade = picture[row : row + _STRIP_PX], light[row : row + _STRIP_PX]
            strip[:] = cv2.multiply(strip, cv2.merge((shade, shade, shade)), scale=1 / 255)


def _rectangle(ne_m: tuple[float, float], length_m: float, width_m: float, heading_rad: float) -> NDArray[np.float64]:
    """Corners (4, 2) of a rectangle, north and east, m; its length points along the heading."""
    forward = np.array([np.cos(heading_rad), np.sin(heading_rad)]) * length_m / 2
    right = np.array([-np.sin(heading_rad), np.cos(heading_rad)]) * width_m / 2
    centre = np.array(ne_m)
    return centre + np.array([forward + right, forward - right, -forward - right, right - forward])
