"""People in space: where the joints of somebody known must be in the next picture, and which points are theirs.

Whoever is known takes their points before the rest is clustered. So what touches them, or touches them only now and
then for the noise, changes neither their region nor their box, and pieces that noise has cut off are theirs, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from common.geometry.camera import Camera
from common.geometry.rotation import Array, quat_conjugate, quat_rotate
from onboard.people.association import assign
from onboard.people.depth import Floats, Ints
from onboard.people.pose import BONES, STANDING_M, Pose

REACH_M, LOOSE_M = 0.20, 0.35
"""How far from the bones a body ends, m: a hand beyond the wrist, a foot; and what hangs on it and ends within the
larger one is the body's, too."""
_SHIFTS = 4
_MOST_SHIFT_M = 0.45
_LEAST_SHARE = 0.5
"""Share of the area that they had that people must still have where they are expected."""
_TOP_PERCENT, _LEAST_TOP = 99.0, 0.6
"""The top of what lies where somebody is expected must be at this share of their height at least."""
_MOST_MORE_M = 0.3
"""What is so much higher than somebody who lies or sits was is not theirs: they have got up, or a thing is there."""
_MORE = 1.05
"""Whoever lies or sits is taken to have moved only if so many times the points are theirs then."""
_LEAST_COLUMN = 0.3
"""The same of those who stand: somebody else may be before them."""
_JOINT_POINTS = 3
_FEWEST_JOINTS = 6
"""Of whom fewer joints are in the picture are not looked for: too little to tell how far they are from where they were
believed, and the rest would be nobody's."""


@dataclass(frozen=True)
class VehiclePose:
    """Where the vehicle was when the picture was taken."""

    ned_p_m: Array
    """(3,) position from home, NED, m."""
    ned_q_body: Array
    """(4,) attitude."""

    def into_camera(self, camera: Camera, ned_points_m: Array) -> Array:
        """Points (N, 3) from home, NED, m, in a camera's optical frame."""
        body = quat_rotate(quat_conjugate(self.ned_q_body), ned_points_m - self.ned_p_m)
        return quat_rotate(quat_conjugate(camera.body_q_camera), body - np.asarray(camera.body_p_camera_m))

    def from_camera(self, camera: Camera, camera_points_m: Array) -> Array:
        """The way back."""
        body = quat_rotate(camera.body_q_camera, camera_points_m) + np.asarray(camera.body_p_camera_m)
        return self.ned_p_m + quat_rotate(self.ned_q_body, body)


@dataclass(frozen=True)
class Body:
    """Somebody known, in space."""

    number: int
    """Who."""
    ned_joints_m: Array
    """(15, 3) from home, NED, m."""
    pose: Pose
    """As it was found in a picture: how sure each joint is."""
    area_m2: float
    """Area across the rays of what was seen then, m²."""
    top_m: float
    """How high it reached above the floor, m."""
    lean_m: Array
    """(2,) mean way from the bones to the points of the body, across the rays at the floor's distance, m: not zero
    where flesh is on one side of them."""
    ned_trunk_m: Array | None = None
    """(3,) middle of trunk and head of somebody who stands, from home, NED, m; None of everybody else."""

    def shifted(self, ned_way_m: Array) -> Body:
        """The body elsewhere on the floor, by a way (3,)."""
        way = np.array([ned_way_m[0], ned_way_m[1], 0.0])
        trunk = None if self.ned_trunk_m is None else self.ned_trunk_m + way
        return replace(self, ned_joints_m=self.ned_joints_m + way, ned_trunk_m=trunk)

    def pose_in(self, camera: Camera, vehicle: VehiclePose) -> Pose:
        """The pose that a camera sees from elsewhere."""
        points = vehicle.into_camera(camera, self.ned_joints_m)
        points[:, 2] = np.maximum(points[:, 2], 0.1)
        return Pose(camera.project(points), self.pose.confidence, self.pose.presence)


@dataclass(frozen=True)
class Claimed:
    """Points that somebody known takes."""

    body: Body
    """Where they are now."""
    rows: Ints
    """(M,) which of the points."""


def body_of(
    number: int,
    pose: Pose,
    points_m: Array,
    size: tuple[float, float],
    height_m: float,
    camera: Camera,
    vehicle: VehiclePose,
    ned_trunk_m: Array | None = None,
) -> Body:
    """A body from a pose that was found in a picture.

    Args:
        number: who it is.
        pose: in the picture.
        points_m: (M, 3) of the region that it was found in, in the camera's optical frame, m, evenly spaced.
        size: what they stand for across the rays, m², and how high they reach above the floor, m.
        height_m: of the camera above the floor, m.
        camera: that took the picture.
        vehicle: where it was.
        ned_trunk_m: (3,) middle of trunk and head, of somebody who stands.
    """
    pixels = camera.project(points_m)
    apart = np.linalg.norm(pose.joints_px[:, None] - pixels, axis=2)
    nearest = np.argsort(apart, axis=1)[:, :_JOINT_POINTS]
    depths = np.median(points_m[nearest, 2], axis=1)
    joints = camera.rays(pose.joints_px) * depths[:, None]
    places = _flat(points_m, height_m)
    return Body(
        number,
        vehicle.from_camera(camera, joints),
        pose,
        *size,
        _lean(places, _flat(joints, height_m), _reach(joints, height_m)),
        ned_trunk_m,
    )


def claims(
    bodies: Sequence[Body],
    points_m: Floats,
    heights_m: Floats,
    areas_m2: Array,
    height_m: float,
    camera: Camera,
    vehicle: VehiclePose,
) -> list[Claimed]:
    """Which points each of some bodies takes, with the body moved to where they are; bodies that are not where they are
    expected are left out.

    Args:
        bodies: people known; earlier ones take first.
        points_m: (N, 3) above the floor, in the optical frame, m.
        heights_m: (N,) of them above the floor, m.
        areas_m2: (N,) what each stands for across the rays, m².
        height_m: of the camera above the floor, m.
        camera: the depth camera.
        vehicle: where it is.
    """
    free, found = np.ones(len(points_m), bool), []
    places = _flat(points_m, height_m)
    for body in bodies:
        joints = vehicle.into_camera(camera, body.ned_joints_m)
        if joints[:, 2].min() < 0.3 or _seen(camera, joints) < _FEWEST_JOINTS:
            continue
        low = heights_m < body.top_m + _MOST_MORE_M
        moved, rows = _fitted(body, joints, places, free & low, height_m)
        if not len(rows) or areas_m2[rows].sum() < _LEAST_SHARE * body.area_m2:
            continue
        if np.percentile(heights_m[rows], _TOP_PERCENT) < _LEAST_TOP * body.top_m:
            continue
        free[rows] = False
        shift = vehicle.from_camera(camera, moved) - vehicle.from_camera(camera, joints)
        found.append(Claimed(body.shifted(shift.mean(axis=0)), rows))
    return found


def standing_where_expected(
    bodies: Sequence[Body], ned_trunks_m: Sequence[Array], sizes: Sequence[tuple[float, float]]
) -> list[tuple[Body, int]]:
    """Which of those who stand in a picture is which of some bodies that stand, each moved to where it is: the pairs
    with the smallest ways in all.

    Args:
        bodies: people known, where they are expected.
        ned_trunks_m: (3,) middle of trunk and head of each who stands there, from home, NED, m.
        sizes: of each, area across the rays, m², and height of the top above the floor, m.
    """

    standing = [(body, body.ned_trunk_m) for body in bodies if body.ned_trunk_m is not None]

    def way(body: Body, trunk: Array, k: int) -> float:
        if sizes[k][0] < _LEAST_COLUMN * body.area_m2 or sizes[k][1] < _LEAST_TOP * body.top_m:
            return float("inf")
        return float(np.linalg.norm((ned_trunks_m[k] - trunk)[:2]))

    ways = np.array([[way(*pair, k) for k in range(len(ned_trunks_m))] for pair in standing])
    pairs = [(*standing[row], column) for row, column in assign(ways, _MOST_SHIFT_M)]
    return [(body.shifted(ned_trunks_m[column] - trunk), column) for body, trunk, column in pairs]


def hang_on(points_m: Floats, body: Body, height_m: float, camera: Camera, vehicle: VehiclePose) -> bool:
    """Whether points that touch a body are part of it, too: they are if they all end near it.

    Args:
        points_m: (N, 3) in the optical frame, m.
        body: who.
        height_m: of the camera above the floor, m.
        camera: the depth camera.
        vehicle: where it is.
    """
    joints = vehicle.into_camera(camera, body.ned_joints_m)
    distances, _ = _from_bones(_flat(points_m, height_m), _flat(joints, height_m))
    return bool((distances < LOOSE_M * _reach(joints, height_m) / REACH_M).all())


def _fitted(body: Body, joints_m: Array, places: Array, free: NDArray[np.bool_], height_m: float) -> tuple[Array, Ints]:
    """Joints moved across the rays until the free points around them lie as they did, and the rows of these."""
    flat, reach = _flat(joints_m, height_m), _reach(joints_m, height_m)
    low, high = flat.min(axis=0) - reach - _MOST_SHIFT_M, flat.max(axis=0) + reach + _MOST_SHIFT_M
    around = np.flatnonzero(free & (places > low).all(axis=1) & (places < high).all(axis=1))
    total = np.zeros(2)
    for _ in range(_SHIFTS):
        distances, ways = _from_bones(places[around], flat + total)
        mine = distances < reach
        if not mine.any():
            break
        total = total + _mean_way(distances[mine], ways[mine], reach) - body.lean_m
        if np.linalg.norm(total) > _MOST_SHIFT_M:
            return joints_m, np.empty(0, np.int32)
    distances, _ = _from_bones(places[around], flat + total)
    if body.top_m < STANDING_M and total.any():
        before, _ = _from_bones(places[around], flat)
        if (distances < reach).sum() < _MORE * (before < reach).sum():
            total, distances = np.zeros(2), before
    moved = joints_m.copy()
    moved[:, :2] += total * joints_m[:, 2:] / height_m
    return moved, around[distances < reach].astype(np.int32)


def _flat(points_m: NDArray[np.floating], height_m: float) -> Array:
    """Places (N, 2) across the rays, m at the floor's distance."""
    return points_m[:, :2] * (height_m / points_m[:, 2:])


def _reach(joints_m: Array, height_m: float) -> float:
    return REACH_M * height_m / float(np.median(joints_m[:, 2]))


def _lean(places: Array, joints: Array, reach: float) -> Array:
    distances, ways = _from_bones(places, joints)
    mine = distances < reach
    return _mean_way(distances[mine], ways[mine], reach) if mine.any() else np.zeros(2)


def _mean_way(distances: Array, ways: Array, reach: float) -> Array:
    """Mean of the ways (N, 2) from the bones; those at the reach's end, where other things begin, weigh nothing."""
    weights = 1.0 - (distances / reach) ** 2
    return weights @ ways / max(float(weights.sum()), 1e-9)


def _from_bones(places: Array, joints: Array) -> tuple[Array, Array]:
    """Distance (N,) of places (N, 2) from the nearest bone between joints (15, 2), and the way (N, 2) from it."""
    begin, end = joints[BONES[:, 0]], joints[BONES[:, 1]]
    along = end - begin
    squared = np.maximum((along**2).sum(axis=1), 1e-9)
    offsets = places[:, None] - begin
    share = np.clip((offsets * along).sum(axis=2) / squared, 0.0, 1.0)
    ways = offsets - share[..., None] * along
    distances = np.linalg.norm(ways, axis=2)
    nearest = np.argmin(distances, axis=1) if len(places) else np.empty(0, int)
    rows = np.arange(len(places))
    return distances[rows, nearest], ways[rows, nearest]


def _seen(camera: Camera, joints_m: Array) -> int:
    """How many joints of a body are in the picture."""
    pixels = camera.project(joints_m)
    return int(((pixels > 0) & (pixels < (camera.width, camera.height))).all(axis=1).sum())
