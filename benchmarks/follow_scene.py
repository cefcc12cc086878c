"""A hall with solid targets in it, seen by any pinhole camera: for loops that are closed through pictures.

The hall is a box with painted walls and floor, by ray casting; what stands in it are solids of revolution (a person, a
head, a bin), whose painted surface turns with them, so that an out-of-plane turn changes what is seen.
Axes are NED, the floor is at z = 0.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.follow_scene_compiled import cast, expose
from benchmarks.follow_solids import Solid, blotches
from common.geometry.camera import Camera
from common.geometry.rotation import (
    as_quat,
    quat_conjugate,
    quat_from_euler,
    quat_multiply,
    quat_to_matrix,
)
from common.tracking.base import Box

Array = NDArray[np.float64]
FORWARD = (0.5, 0.5, 0.5, 0.5)
"""`body_q_camera` of a camera that looks along the nose, top of the picture up."""
_WALL_PX, _FLOOR_PX = (256, 1024), 512
"""Sides of what is painted, 64 px a metre; `follow_scene_compiled.cast` reads it by the same figures."""
_NEAREST_M = 0.25
"""Distance along the optical axis below which a thing is not drawn, m."""
_NOISE_PLACES = 64
"""Rows and columns by which the field of noise is larger than a picture."""
_EXPOSURE_S = 0.008
"""Time in which a turning camera blurs, s."""


def camera(width: int, height: int, fov_rad: float, rate_hz: float = 30.0, down_rad: float = 0.0) -> Camera:
    """A camera without distortion that looks along the nose, or below it, with this horizontal field of view."""
    focal = width / 2 / math.tan(fov_rad / 2)
    middle, none = ((width - 1) / 2, (height - 1) / 2), (0.0, 0.0, 0.0, 0.0, 0.0)
    mount = as_quat(quat_multiply(quat_from_euler(0.0, -down_rad, 0.0), FORWARD))
    return Camera(width, height, focal, focal, *middle, none, mount, (0.0, 0.0, 0.0), 0.0, rate_hz)


@dataclass
class Thing:
    """A solid at a place."""

    solid: Solid
    """What."""
    ned_p_m: Array
    """Middle of its foot, (3,), m."""
    heading_rad: float = 0.0
    """Where its front looks, rad from north."""
    lean_rad: float = 0.0
    """How far it leans over, about its middle, clockwise in the picture, rad."""


class Shown(NamedTuple):
    """Where a thing is in the picture."""

    box: Box
    """Upright box around it, px."""
    depth_m: float
    """Distance along the optical axis, m."""


class Lens(NamedTuple):
    """A camera somewhere."""

    camera: Camera
    """Calibration."""
    ned_p_m: Array
    """Where it is, (3,), m."""
    ned_q_body: Array
    """Attitude of what it is fixed to, (4,)."""

    def axes(self) -> Array:
        """Rotation (3, 3) from NED to the optical frame."""
        return quat_to_matrix(quat_conjugate(quat_multiply(self.ned_q_body, self.camera.body_q_camera)))

    def show(self, thing: Thing) -> Shown | None:
        """Where a thing is in the picture, or would be beyond its edge; None behind the camera."""
        middle = thing.ned_p_m - np.array([0.0, 0.0, thing.solid.height_m / 2])
        x, y, z = self.axes() @ (middle - self.ned_p_m)
        if z < _NEAREST_M:
            return None
        scale = self.camera.fx_px / z
        upright = np.array([thing.solid.width_m(self.aspect_rad(thing)), thing.solid.height_m]) * scale
        c, s = abs(math.cos(thing.lean_rad)), abs(math.sin(thing.lean_rad))
        # Of the ellipse in the turned rectangle: its corners are empty.
        width, height = np.hypot(upright * c, upright[::-1] * s).tolist()
        u, v = self.camera.cx_px + x * scale, self.camera.cy_px + y * scale
        return Shown((float(u - width / 2), float(v - height / 2), float(width), float(height)), float(z))

    def aspect_rad(self, thing: Thing) -> float:
        """How far a thing is turned from facing the camera, rad."""
        north, east, _ = self.ned_p_m - thing.ned_p_m
        return math.remainder(math.atan2(east, north) - thing.heading_rad, 2 * math.pi)


@dataclass
class Light:
    """What the light and the sensor do to one picture."""

    gain: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Blue, green and red against the first picture."""
    turn_rad_s: float = 0.0
    """Turn rate of the camera, which blurs, rad/s."""


class Hall:
    """The hall; the same seed paints the same, and draws the same noise.

    Args:
        half_m: from the middle to the walls north and east, m.
        seed: of paint and noise.
        height_m: of its ceiling, m.
        noise: standard deviation of the sensor's noise, grey levels.
    """

    def __init__(self, half_m: tuple[float, float], seed: int, height_m: float = 4.0, noise: float = 4.0):
        rng = np.random.default_rng((seed, 31))
        floor = _floor(rng)
        self._atlas = np.vstack([_wall(rng), np.hstack([floor, (floor * 0.3 + 130).astype(np.uint8)])])
        self.half_m = np.array([*half_m, height_m])
        """From the middle of the floor to the walls north and east, and to the ceiling, (3,), m."""
        self._rng = np.random.default_rng((seed, 32))
        self._sigma = noise
        self._noise = np.zeros((0, 0, 3), np.int8)

    def picture(self, lens: Lens, things: Sequence[Thing], light: Light) -> np.ndarray:
        """The picture (H, W, 3), BGR, of the hall with things in it, the nearest drawn last."""
        frame = self._background(lens)
        shown = [(thing, where) for thing in things if (where := lens.show(thing)) is not None]
        for thing, where in sorted(shown, key=lambda pair: -pair[1].depth_m):
            _draw(frame, lens, thing, where)
        blur = round(abs(light.turn_rad_s) * _EXPOSURE_S * lens.camera.fx_px)
        if blur > 1:
            frame = cv2.blur(frame, (blur, 1))
        expose(frame, np.array(light.gain, np.float32), self._grain(frame.shape))
        return frame

    def _grain(self, shape: tuple[int, ...]) -> np.ndarray:
        """Noise of one picture: one field, read at another place each time."""
        rows, columns = shape[:2]
        if self._noise.shape[:2] != (rows + _NOISE_PLACES, columns + _NOISE_PLACES):
            size = (rows + _NOISE_PLACES, columns + _NOISE_PLACES, 3)
            self._noise = np.round(self._sigma * self._rng.standard_normal(size, np.float32)).astype(np.int8)
        row, column = self._rng.integers(0, _NOISE_PLACES, 2)
        return self._noise[row : row + rows, column : column + columns]

    def _background(self, lens: Lens) -> np.ndarray:
        c = lens.camera
        out = np.empty((c.height, c.width, 3), np.uint8)
        cast(self._atlas, lens.axes(), lens.ned_p_m, self.half_m, c.fx_px, (c.cx_px, c.cy_px), out)
        return out


class _Laid(NamedTuple):
    """Where a solid's picture is laid over a frame."""

    part: tuple[slice, slice]
    """Rows and columns of the frame."""
    matrix: Array
    """Affine map (2, 3) from the solid's picture to that part."""


def _laid(shape: tuple[int, ...], lens: Lens, thing: Thing, where: Shown, drawn: tuple[int, ...]) -> _Laid | None:
    """Of a thing whose picture is `drawn` (rows, columns); None where that is outside the frame."""
    x, y, width, height = where.box
    rows, columns = drawn[:2]
    up = lens.axes() @ np.array([0.0, 0.0, -1.0])
    lean = math.atan2(up[0], -up[1]) + thing.lean_rad
    scale_y = lens.camera.fx_px / where.depth_m * thing.solid.height_m / rows
    scale_x = scale_y * thing.solid.squeeze(lens.aspect_rad(thing))
    c, s = math.cos(lean), math.sin(lean)
    reach = math.hypot(width, height) / 2 + 2
    centre = (x + width / 2, y + height / 2)
    left, top = max(0, int(centre[0] - reach)), max(0, int(centre[1] - reach))
    right, bottom = min(shape[1], int(centre[0] + reach)), min(shape[0], int(centre[1] + reach))
    if right <= left or bottom <= top:
        return None
    matrix = np.array([[c * scale_x, -s * scale_y, centre[0] - left], [s * scale_x, c * scale_y, centre[1] - top]])
    matrix[:, 2] -= matrix[:, :2] @ [(columns - 1) / 2, (rows - 1) / 2]
    return _Laid((slice(top, bottom), slice(left, right)), matrix)


def _draw(frame: np.ndarray, lens: Lens, thing: Thing, where: Shown) -> None:
    seen, mask = thing.solid.picture(lens.aspect_rad(thing))
    laid = _laid(frame.shape, lens, thing, where, seen.shape)
    if laid is None:
        return
    window = frame[laid.part]
    size = (window.shape[1], window.shape[0])
    inside = cv2.warpAffine(mask, laid.matrix, size, flags=cv2.INTER_LINEAR) > 127
    drawn = cv2.warpAffine(seen, laid.matrix, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    window[inside] = drawn[inside]


def silhouette(
    shape: tuple[int, ...], lens: Lens, thing: Thing, where: Shown
) -> tuple[tuple[slice, slice], np.ndarray] | None:
    """Rows and columns of a picture of a shape, and which pixels there show a thing; None where it is outside."""
    mask = thing.solid.mask
    laid = _laid(shape, lens, thing, where, mask.shape)
    if laid is None:
        return None
    rows, columns = laid.part
    size = (columns.stop - columns.start, rows.stop - rows.start)
    return laid.part, cv2.warpAffine(mask, laid.matrix, size, flags=cv2.INTER_LINEAR) > 127


def _wall(rng: np.random.Generator) -> np.ndarray:
    """Four metres high, sixteen long: bricks, doors, posters."""
    rows, columns = _WALL_PX
    picture = blotches(rng, rows, columns, rng.uniform(110, 170, 3).tolist())
    picture[::16] *= 0.85
    for _ in range(14):
        width, height = (int(v) for v in rng.uniform(24, 90, 2))
        x, y = int(rng.integers(0, columns - width)), int(rng.integers(0, rows - height))
        colour = rng.uniform(30, 230, 3)
        picture[y : y + height, x : x + width] = colour
        cv2.circle(picture, (x + width // 2, y + height // 2), height // 3, rng.uniform(30, 230, 3).tolist(), -1)
        picture[y : y + height : 7, x : x + width] *= 0.7
    return np.clip(picture, 0, 255).astype(np.uint8)


def _floor(rng: np.random.Generator) -> np.ndarray:
    picture = blotches(rng, _FLOOR_PX, _FLOOR_PX, rng.uniform(70, 130, 3).tolist())
    picture[::64], picture[:, ::64] = picture[::64] * 0.6, picture[:, ::64] * 0.6
    return np.clip(picture, 0, 255).astype(np.uint8)


def hidden_share(lens: Lens, target: Thing, things: Sequence[Thing]) -> float:
    """Share of the target's box that nearer things cover, 0 to 1: of the columns, where they are as high."""
    own = lens.show(target)
    if own is None:
        return 1.0
    columns = np.linspace(own.box[0], own.box[0] + own.box[2], 21)
    covered = np.zeros(len(columns), bool)
    for thing in things:
        other = lens.show(thing)
        if thing is target or other is None or other.depth_m >= own.depth_m:
            continue
        tall = min(other.box[1] + other.box[3], own.box[1] + own.box[3]) - max(other.box[1], own.box[1])
        if tall > 0.6 * own.box[3]:
            covered |= (columns > other.box[0]) & (columns < other.box[0] + other.box[2])
    return float(covered.mean())
