"""What stands free of the floor in a depth picture, piece by piece."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from common.geometry.camera import Camera
from common.geometry.rotation import quat_multiply, quat_to_matrix
from common.tracking.base import Box
from onboard.follow.sight import eye_of
from onboard.proximity.pose import Pose

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
_FLOOR_M, _FLOOR = 0.1, 0.05
"""Height below which a depth may be of the floor, m, and more for each metre of distance: a mount that shakes, or a
pose that is late, tilts it by so much."""
_STEP_M = 0.3
"""Step between neighbouring pixels from which they are of two things, m."""
_MOSTLY = 0.5
"""Least share of a thing that is about as far as its half: a wall goes on."""
_HOLES = np.ones((3, 3), np.uint8)
_FOOT = 0.2
"""Share of a thing's height that is its lowest part."""


class Thing(NamedTuple):
    """Something that stands free of the floor."""

    box: Box
    """Upright box around it, px."""
    area: float
    """What it fills of the picture, px²."""
    foot: float
    """Column of the middle of its lowest part, px: who leans stands where he stood."""
    nearest_m: float
    distance_m: float
    farthest_m: float
    """How far its nearest tenth, its half and its farthest tenth are along the optical axis, m."""
    where: tuple[slice, slice]
    """Rows and columns of the depth picture around it."""
    mask: Mask
    """Which of those are of it."""

    def share(self, of: Mask) -> float:
        """Share of it that is marked in a mask of the whole depth picture."""
        return float(np.mean(of[self.where][self.mask]))


class DepthView:
    """Which parts of depth pictures stand free of the floor, and which of those hang together.

    The floor is at the height of the origin, in NED.

    Args:
        camera: calibration and mounting of the pictures that boxes are of.
    """

    def __init__(self, camera: Camera):
        self.camera = camera
        self._rays = np.zeros((0, 0, 3))

    def free(self, pose: Pose, depth_m: Array) -> Mask:
        """Which pixels of a depth picture, (h, w), m, 0 for none, are of something above the floor."""
        down = quat_to_matrix(quat_multiply(pose.ned_q_body, self.camera.body_q_camera))[2]
        eye = eye_of(self.camera, pose)
        above = depth_m * (self._rays_of(depth_m.shape) @ down) < -float(eye[2]) - _FLOOR_M - _FLOOR * depth_m
        return above & (depth_m > 0.0)

    def things(self, depth_m: Array, of: Mask, least_px: float = 0.0) -> list[Thing]:
        """The pieces that hang together and are apart by a step of the depth from what is behind them.

        Args:
            depth_m: depth picture, (h, w), m, 0 for none.
            of: which of its pixels are asked about, (h, w); small holes are closed.
            least_px: least area, px² of the pictures that boxes are of.
        """
        mask = cv2.morphologyEx(of.astype(np.uint8), cv2.MORPH_CLOSE, _HOLES)
        mask[_behind_an_edge(_filled(depth_m))] = 0
        number, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
        least = max(1.0, least_px * (depth_m.shape[1] / self.camera.width) ** 2)
        things = []
        for label, (left, top, width, height, area) in enumerate(stats[1:number].tolist(), 1):
            where = slice(top, top + height), slice(left, left + width)
            mine = labels[where] == label
            if area >= least and bool((depth_m[where][mine] > 0.0).any()):
                things.append(self._thing(depth_m, where, mine))
        return things

    def near_its_half(self, depth_m: Array, thing: Thing, deep_m: float) -> Thing | None:
        """The part of a thing that is no nearer or farther than its half by a distance, m; None where that is little.

        Pixels between two things that are seen one beside the other belong to neither, and hold them together.
        """
        off_m = np.abs(depth_m[thing.where] - thing.distance_m)
        mine = thing.mask & (off_m < deep_m)
        if np.count_nonzero(mine) < _MOSTLY * np.count_nonzero(thing.mask):
            return None
        return self._part(depth_m, thing, mine)

    def between(self, depth_m: Array, thing: Thing, left_px: float, right_px: float) -> Thing | None:
        """The part of a thing between two columns, px of the pictures that boxes are of; None where there is none."""
        scale = self.camera.width / depth_m.shape[1]
        columns = (np.arange(thing.mask.shape[1]) + thing.where[1].start + 0.5) * scale
        mine = thing.mask & ((columns >= left_px) & (columns <= right_px))
        return self._part(depth_m, thing, mine) if (depth_m[thing.where][mine] > 0.0).any() else None

    def _part(self, depth_m: Array, thing: Thing, mine: Mask) -> Thing:
        """The part of a thing that is marked in a mask of its own rows and columns."""
        rows, columns = np.nonzero(mine.any(axis=1))[0], np.nonzero(mine.any(axis=0))[0]
        inner = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
        top, left = thing.where[0].start, thing.where[1].start
        where = slice(top + inner[0].start, top + inner[0].stop), slice(left + inner[1].start, left + inner[1].stop)
        return self._thing(depth_m, where, mine[inner])

    def _thing(self, depth_m: Array, where: tuple[slice, slice], mask: Mask) -> Thing:
        scale = self.camera.width / depth_m.shape[1]
        (top, left), (height, width) = (part.start for part in where), mask.shape
        depths = depth_m[where][mask & (depth_m[where] > 0.0)]
        nearest_m, distance_m, farthest_m = np.percentile(depths, (10, 50, 90)).tolist()
        foot = left + float(np.nonzero(mask[-max(1, round(_FOOT * height)) :])[1].mean())
        box = (left * scale, top * scale, width * scale, height * scale)
        area = float(np.count_nonzero(mask)) * scale**2
        return Thing(box, area, (foot + 0.5) * scale, nearest_m, distance_m, farthest_m, where, mask)

    def _rays_of(self, shape: tuple[int, ...]) -> Array:
        """Optical ray with z = 1 of each pixel of a depth picture, (h, w, 3)."""
        if self._rays.shape[:2] != shape:
            rows, columns = np.mgrid[: shape[0], : shape[1]]
            camera = self.camera.resized(shape[1], shape[0])
            self._rays = camera.rays(np.column_stack([columns.ravel(), rows.ravel()])).reshape(*shape, 3)
        return self._rays


def _filled(depth_m: Array) -> Array:
    """The same with each hole beside something as near as the nearest of that: a hole is no bridge to a wall."""
    nearest = cv2.erode(np.where(depth_m > 0.0, depth_m, np.inf), _HOLES)
    return np.where((depth_m > 0.0) | np.isinf(nearest), depth_m, nearest)


def _behind_an_edge(depth_m: Array) -> Mask:
    """Which pixels of (h, w) lie beside one that is nearer by a step: what stands before a wall is none of the wall."""
    behind = np.zeros(depth_m.shape, bool)
    for here, there, marks in (
        (depth_m[:-1], depth_m[1:], (behind[:-1], behind[1:])),
        (depth_m[:, :-1], depth_m[:, 1:], (behind[:, :-1], behind[:, 1:])),
    ):
        known = (here > 0.0) & (there > 0.0)
        marks[0][known & (here - there > _STEP_M)] = True
        marks[1][known & (there - here > _STEP_M)] = True
    return behind
