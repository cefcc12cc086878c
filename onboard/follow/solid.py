"""The target as a depth camera shows it: what stands free of the floor at its distance, whatever it looks like.

Beyond the thesis, whose time-of-flight sensor gives a distance alone. Trackers know the target by its look; who leans,
or turns a side that nobody has seen, is still as large as before, where he was expected and as far away.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from common.geometry.camera import Camera
from common.geometry.rotation import quat_multiply, quat_to_matrix
from common.tracking.base import Box
from onboard.follow.sight import eye_of
from onboard.fusion.foreseen import Foreseen
from onboard.proximity.pose import Pose

Array = NDArray[np.float64]
_FLOOR_M, _FLOOR = 0.1, 0.05
"""Height below which a depth may be of the floor, m, and more for each metre of distance: a mount that shakes, or a
pose that is late, tilts it by so much."""
_DEEP_M = 0.6
"""Greatest depth of a thing, m, between its nearest and its farthest tenth: floor and walls go on."""
_STEP_M = 0.3
"""Step between neighbouring pixels from which they are of two things, m."""
_COVERS = 0.2
"""Share of a thing that is as near as what covers the target from which it is that: the side of a screen is deeper."""
_HOLES = np.ones((3, 3), np.uint8)
_FOOT = 0.2
"""Share of a thing's height that is its lowest part."""
_LEAST_SHARE = 0.2
"""Least area of a thing over that of the foreseen box."""
_TALLER, _LARGER = 0.35, 0.25
"""By how much its height and the root of its area may differ from the target's, logarithm: who leans is as large."""
_CLEARER_M = 0.4
"""How much nearer to the foreseen place than any other one it must be, m."""
_MEMORY_S, _KNOWN_S = 1.0, 0.5
"""Time constant with which the relation of box and thing is learned, s, and after how much of that it is known."""
_LONGEST_STEP_S = 0.1


class Thing(NamedTuple):
    """Something that stands free of the floor."""

    box: Box
    """Upright box around it, px."""
    area: float
    """What it fills of the picture, px²."""
    foot: float
    """Column of the middle of its lowest part, px: who leans stands where he stood."""
    distance_m: float
    """How far it is along the optical axis, m."""


class Solid:
    """Finds the target in depth pictures, once its trackers' box has shown which part of a thing it is.

    Args:
        camera: calibration and mounting of the pictures that the boxes are of.
    """

    def __init__(self, camera: Camera):
        self._camera = camera
        self._rays = np.zeros((0, 0, 3))
        self._relation = np.zeros(4)
        """The box's middle against the thing's, in the thing's sides, and the thing's height, m, and area, m²,
        logarithms: boxes grow."""
        self._learned_s = 0.0
        self._t_ns = 0

    def learn(self, t_ns: int, box: Box, pose: Pose, foreseen: Foreseen) -> None:
        """Note what part of a thing the target's box is, (x, y, width, height), px; nothing where it is on none."""
        step_s = min(max(t_ns - self._t_ns, 0) * 1e-9, _LONGEST_STEP_S)
        self._t_ns = t_ns
        things = [thing for thing in self.things(pose, replace(foreseen, box=box)) if _holds(thing.box, box)]
        if len(things) != 1:
            return
        self._learned_s += step_s
        share = max(-math.expm1(-step_s / _MEMORY_S), step_s / self._learned_s)
        self._relation += share * (self._relation_of(box, things[0]) - self._relation)

    def find(self, pose: Pose, foreseen: Foreseen, reach_m: float) -> Box | None:
        """The target's box by the thing at its place; None where there is none, more than one, or nothing is known yet.

        It is as large as foreseen, for the thing's distance: the box around who leans is no box of any tracker.

        Args:
            pose: the vehicle.
            foreseen: where the target is expected, how far, and the depth picture.
            reach_m: how far aside of that it may be, m.
        """
        if self._learned_s < _KNOWN_S or foreseen.outside:
            return None
        like = [thing for thing in self.things(pose, foreseen) if self._is_like(thing)]
        if not like:
            return None
        like.sort(key=lambda thing: self._off_m(thing, foreseen))
        off_m = [self._off_m(thing, foreseen) for thing in like]
        clear = len(like) == 1 or off_m[1] - off_m[0] > _CLEARER_M
        if not clear or off_m[0] > reach_m:
            return None
        return _applied(self._relation, like[0].box, _at(foreseen, like[0].distance_m))

    def things(self, pose: Pose, foreseen: Foreseen) -> list[Thing]:
        """What stands free of the floor at the target's distance, near its place."""
        depth_m = foreseen.depth_m
        if depth_m is None or not math.isfinite(foreseen.distance_m):
            return []
        rows, columns = self._window(depth_m.shape, foreseen)
        part = depth_m[rows, columns]
        if not part.size:
            return []
        rays = self._rays_of(depth_m.shape)[rows, columns]
        down = quat_to_matrix(quat_multiply(pose.ned_q_body, self._camera.body_q_camera))[2]
        eye = eye_of(self._camera, pose)
        above = part * (rays @ down) < -float(eye[2]) - _FLOOR_M - _FLOOR * part
        as_far, of_cover = foreseen.things(part)
        mask = cv2.morphologyEx((above & (as_far | of_cover)).astype(np.uint8), cv2.MORPH_CLOSE, _HOLES)
        mask[_behind_an_edge(part)] = 0
        number, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
        scale = self._camera.width / depth_m.shape[1]
        least = _LEAST_SHARE * foreseen.box[2] * foreseen.box[3] / scale**2
        things = []
        for label, (left, top, width, height, area) in enumerate(stats[1:number].tolist(), 1):
            if area < least:
                continue
            mine = labels[top : top + height, left : left + width] == label
            if float(np.mean(of_cover[top : top + height, left : left + width][mine])) > _COVERS:
                continue
            depths = part[top : top + height, left : left + width][mine]
            nearest_m, distance_m, farthest_m = np.percentile(depths[depths > 0.0], (10, 50, 90)).tolist()
            if farthest_m - nearest_m > _DEEP_M:
                continue
            foot = left + float(np.nonzero(mine[-max(1, round(_FOOT * height)) :])[1].mean())
            box = ((left + columns.start) * scale, (top + rows.start) * scale, width * scale, height * scale)
            things.append(Thing(box, area * scale**2, (foot + columns.start + 0.5) * scale, distance_m))
        return things

    def _window(self, shape: tuple[int, ...], foreseen: Foreseen) -> tuple[slice, slice]:
        """Rows and columns of the depth picture in which the target can be, and its like beside it."""
        x, y, width, height = foreseen.box
        scale = shape[1] / self._camera.width
        around = height / 2 + self._camera.fx_px * (foreseen.reach_m + 1.0) / foreseen.distance_m
        left, right = ((x + width / 2 - around) * scale, (x + width / 2 + around) * scale)
        top, bottom = ((y - height / 2) * scale, (y + 1.5 * height) * scale)
        return slice(max(0, int(top)), max(0, int(bottom))), slice(max(0, int(left)), max(0, int(right)))

    def _rays_of(self, shape: tuple[int, ...]) -> Array:
        """Optical ray with z = 1 of each pixel of a depth picture, (h, w, 3)."""
        if self._rays.shape[:2] != shape:
            rows, columns = np.mgrid[: shape[0], : shape[1]]
            camera = self._camera.resized(shape[1], shape[0])
            self._rays = camera.rays(np.column_stack([columns.ravel(), rows.ravel()])).reshape(*shape, 3)
        return self._rays

    def _is_like(self, thing: Thing) -> bool:
        """Whether it is as tall and as large as the thing is that the target is a part of."""
        taller, larger = (self._size_of(thing) - self._relation[2:]).tolist()
        return abs(taller) <= _TALLER and abs(larger) / 2 <= _LARGER

    def _size_of(self, thing: Thing) -> Array:
        """Height, m, and area, m², (2,), logarithms."""
        m = thing.distance_m / self._camera.fx_px
        return np.array([math.log(thing.box[3] * m), math.log(thing.area * m**2)])

    def _relation_of(self, box: Box, thing: Thing) -> Array:
        (x, y, width, height), (left, top, across, tall) = box, thing.box
        off = (x + width / 2 - left - across / 2) / across, (y + height / 2 - top - tall / 2) / tall
        return np.array([*off, *self._size_of(thing)])

    def _off_m(self, thing: Thing, foreseen: Foreseen) -> float:
        """How far aside a thing stands of where the target is foreseen, m."""
        off_px = thing.foot - foreseen.box[0] - foreseen.box[2] / 2
        return abs(off_px) * foreseen.distance_m / self._camera.fx_px


def _behind_an_edge(depth_m: Array) -> NDArray[np.bool_]:
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


def _at(foreseen: Foreseen, distance_m: float) -> tuple[float, float]:
    """Width and height that the target shows at a distance, m, px."""
    nearer = foreseen.distance_m / distance_m
    return foreseen.box[2] * nearer, foreseen.box[3] * nearer


def _applied(relation: Array, thing: Box, size: tuple[float, float]) -> Box:
    (left, top, across, tall), (width, height) = thing, size
    right, down = relation[:2].tolist()
    return left + across / 2 + right * across - width / 2, top + tall / 2 + down * tall - height / 2, width, height


def _holds(thing: Box, box: Box) -> bool:
    """Whether a thing's middle column runs through a box, and the box's middle is on the thing."""
    u, v = box[0] + box[2] / 2, box[1] + box[3] / 2
    left, top, across, tall = thing
    return abs(left + across / 2 - u) < box[2] / 2 and left < u < left + across and top < v < top + tall
