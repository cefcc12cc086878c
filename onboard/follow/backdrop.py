"""What stands still behind the target of a camera that only turns, by the angles that it was turned to.

The head's own motion is known exactly, so every picture can be laid over what was seen before in the same directions:
whatever differs there is no part of the room. The thesis's trackers know the target's look alone, which a turn changes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from common.geometry.camera import Camera
from common.tracking.base import Box, check_frame

Array = NDArray[np.float32]
_WIDTH_PX = 160
"""Width of the pictures that are compared, about: what is told is the place and size of a thing, not its edges."""
_FINER = 0.9
"""Pixels of the room's picture for each of the camera's, in the middle of its view."""
_MEMORY = 60
"""Pictures after which a new one counts as one of so many."""
_KNOWN = 5
"""Pictures in which a place must have been seen for it to be known."""
_NOISES, _SLOPES, _LEAST = 4.0, 0.8, 6.0
"""What differs by chance: in standard deviations of the noise, in slopes of the picture (an edge that is a pixel off),
and at least, grey levels."""
_NOISE_MEMORY = 0.1
"""Share of a new picture in the noise."""
_STAYED = 90
"""Pictures in a row in which a place must have looked otherwise for it to be learned anew: what only passes is no part
of the room."""
_AROUND = 0.25
"""How far around the target's box nothing is learned, box sides."""


@dataclass(frozen=True)
class _View:
    """A picture laid over the room."""

    small: Array
    """(h, w, 3)."""
    apart: NDArray[np.int8]
    """What is no part of the room: 1, what is: -1, what is unknown: 0, (h, w)."""
    angles: NDArray[np.float64]
    """Pan and tilt, rad."""


class Backdrop:
    """The room as seen from one place.

    Args:
        camera: calibration of the pictures, without distortion; with both angles at 0 it looks level.
        limits_rad: furthest pan and tilt to either side.
    """

    def __init__(self, camera: Camera, limits_rad: tuple[float, float]):
        self._frame_shape = (camera.height, camera.width, 3)
        self._shrink = max(1, round(camera.width / _WIDTH_PX))
        self._shape = (camera.height // self._shrink, camera.width // self._shrink)
        small = camera.resized(self._shape[1], self._shape[0])
        self._lens = np.array([small.fx_px, small.fy_px, small.cx_px, small.cy_px])
        columns, rows = np.meshgrid(np.arange(self._shape[1]), np.arange(self._shape[0]))
        self._rays = (columns - small.cx_px) / small.fx_px, (rows - small.cy_px) / small.fy_px
        # Twice what a level picture shows beside its middle: one that is tilted reaches further with its corners.
        half = math.atan(small.width / small.fx_px), math.atan(small.height / small.fy_px)
        self._corner = np.array([-min(math.pi, limits_rad[0] + half[0]), -min(math.pi / 2, limits_rad[1] + half[1])])
        self._scale = _FINER * float(self._lens[0])
        size = np.ceil(-2 * self._corner * self._scale).astype(int)
        self._room = np.zeros((size[1], size[0], 3), np.float32)
        self._seen = np.zeros((size[1], size[0]), np.float32)
        self._odd = np.zeros((size[1], size[0]), np.float32)
        self._noise = _LEAST / _NOISES
        self._view: _View | None = None

    def look(self, frame: NDArray[np.uint8], pan_rad: float, tilt_rad: float) -> NDArray[np.int8]:
        """What is no part of the room in a picture: 1, what is: -1, and 0 where the room is not known, (h, w).

        Args:
            frame: the picture, (H, W, 3) uint8 BGR.
            pan_rad: where it was taken, clockwise from above, rad.
            tilt_rad: upwards, rad.

        Raises:
            ValueError: no colour picture of the camera's size.
        """
        check_frame(frame, self._frame_shape)
        small = cv2.resize(frame, self._shape[::-1], interpolation=cv2.INTER_AREA).astype(np.float32)
        at = self._directions(pan_rad, tilt_rad)
        seen = cv2.remap(self._seen, *at, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT)
        known = seen >= _KNOWN
        apart = self._compared(small, known, at) if known.any() else np.zeros(self._shape, np.int8)
        self._view = _View(small, apart, np.array([pan_rad, tilt_rad]))
        return apart

    def _compared(self, small: Array, known: NDArray[np.bool_], at: tuple[Array, Array]) -> NDArray[np.int8]:
        """What is no part of the room, 1, what is, -1, and what is unknown, 0, (h, w), of a picture (h, w, 3)."""
        room = cv2.remap(self._room, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        room *= float(np.median(small[known].sum(axis=1) / np.maximum(room[known].sum(axis=1), 1.0)))
        apart = np.abs(small - room).max(axis=2)
        grey = room.mean(axis=2)
        slope = cv2.magnitude(
            cv2.Sobel(grey, cv2.CV_32F, 1, 0, scale=0.125), cv2.Sobel(grey, cv2.CV_32F, 0, 1, scale=0.125)
        )
        chance = np.maximum(_NOISES * self._noise, _LEAST) + _SLOPES * slope
        self._noise += _NOISE_MEMORY * (float(np.median(apart[known])) - self._noise)
        return np.where(known, np.where(apart > chance, 1, -1), 0).astype(np.int8)

    def learn(self, target: Box) -> None:
        """Take the picture that was looked at last for the room, but for the target and its surroundings, px."""
        if self._view is None:
            return
        small, apart, (pan, tilt) = self._view.small, self._view.apart, self._view.angles
        u, v = self._directions(pan, tilt)
        rows, columns = self._seen.shape
        left, right = max(0, int(u.min())), min(columns, int(u.max()) + 2)
        top, bottom = max(0, int(v.min())), min(rows, int(v.max()) + 2)
        x, y = self._pixels((left, right), (top, bottom), pan, tilt)
        inside = (x > 0) & (x < self._shape[1] - 1) & (y > 0) & (y < self._shape[0] - 1)
        bx, by, width, height = (side / self._shrink for side in target)
        inside &= (np.abs(x - bx - width / 2) > (0.5 + _AROUND) * width) | (
            np.abs(y - by - height / 2) > (0.5 + _AROUND) * height
        )
        shown = cv2.remap(small, x, y, cv2.INTER_LINEAR)
        otherwise = inside & (cv2.remap(apart, x, y, cv2.INTER_NEAREST) > 0)
        self._view = None
        part = slice(top, bottom), slice(left, right)
        room, seen, odd = self._room[part], self._seen[part], self._odd[part]
        odd[inside] = np.where(otherwise[inside], odd[inside] + 1, 0)
        stayed = odd > _STAYED
        seen[stayed], odd[stayed] = 0, 0
        inside &= ~otherwise
        seen[inside] = np.minimum(seen[inside] + 1, _MEMORY)
        room[inside] += (shown[inside] - room[inside]) / seen[inside, None]

    def _directions(self, pan_rad: float, tilt_rad: float) -> tuple[Array, Array]:
        """Where in the room's picture each pixel looks, column and row, (h, w)."""
        right, down = self._rays
        c, s = math.cos(tilt_rad), math.sin(tilt_rad)
        ahead, down = c + s * down, c * down - s
        azimuth = pan_rad + np.arctan2(right, ahead)
        elevation = np.arctan2(-down, np.hypot(ahead, right))
        u, v = (azimuth - self._corner[0]) * self._scale, (-elevation - self._corner[1]) * self._scale
        return u.astype(np.float32), v.astype(np.float32)

    def _pixels(
        self, columns: tuple[int, int], rows: tuple[int, int], pan_rad: float, tilt_rad: float
    ) -> tuple[Array, Array]:
        """Where a picture shows a part of the room's, (rows, columns); far outside behind the camera."""
        azimuth = (np.arange(*columns) / self._scale + self._corner[0] - pan_rad)[None, :]
        elevation = -(np.arange(*rows) / self._scale + self._corner[1])[:, None]
        level = np.cos(elevation)
        ahead, right, up = level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)
        c, s = math.cos(tilt_rad), math.sin(tilt_rad)
        depth, down = c * ahead + s * up, s * ahead - c * up
        depth = np.where(depth > 0.1, depth, np.nan)
        x = self._lens[2] + self._lens[0] * right / depth
        y = self._lens[3] + self._lens[1] * down / depth
        return np.nan_to_num(x, nan=-1e4).astype(np.float32), np.nan_to_num(y, nan=-1e4).astype(np.float32)
