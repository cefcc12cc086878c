"""What of a region is the person whose pose was found in it: people who touch a thing are cut out of it by their bones.

The paper has no such step. Nothing in the depth tells a foot from the rock that it leans on; the pose does.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from common.geometry.camera import Camera
from onboard.people.bodies import LOOSE_M, REACH_M, VehiclePose
from onboard.people.pose import BONES, Pose
from onboard.people.regions import Mask, Region
from onboard.people.sights import Sight

_SEEN = 0.5
_LEAST_CUT, _LEAST_LEFT = 0.1, 0.2
"""Shares of a region: less is not worth cutting off, and less left is no person in it."""
_PART = 0.7
"""What lies on a body by this share of its area is a part of it."""


def trimmed(sight: Sight, pose: Pose, camera: Camera, vehicle: VehiclePose | None) -> Sight | None:
    """The part of a region within reach of a pose's bones; None where that is all of it, or next to nothing.

    Args:
        sight: the region, with depth.
        pose: found in it.
        camera: that took the picture.
        vehicle: where it was; None where that is not known.
    """
    region, points = sight.region, sight.points_m
    if region.camera_p_m is None or points is None or len(points) < 3:
        return None
    reach_px = REACH_M * camera.fx_px / region.camera_p_m[2]
    around = around_bones(pose, region, reach_px)
    own = region.mask & around
    share = float(own.sum()) / float(region.mask.sum())
    places = np.asarray(np.round(camera.project(points)) - region.box_px[:2], np.int64)
    inside = ((places >= 0) & (places < around.shape[::-1])).all(axis=1)
    mine = np.zeros(len(points), bool)
    mine[inside] = np.asarray(around[places[inside, 1], places[inside, 0]])
    if not _LEAST_LEFT <= share <= 1.0 - _LEAST_CUT or mine.sum() < 3:
        return None
    rows, columns = np.flatnonzero(own.any(axis=1)), np.flatnonzero(own.any(axis=0))
    top, left, bottom, right = rows[0], columns[0], rows[-1] + 1, columns[-1] + 1
    middle = points[mine].mean(axis=0)
    centred = points[mine] - middle
    _, axes = np.linalg.eigh(centred.T @ centred)
    sides = np.ptp(centred @ axes, axis=0)
    x, y = region.box_px[:2]
    part = replace(
        region,
        box_px=(int(x + left), int(y + top), int(right - left), int(bottom - top)),
        mask=own[top:bottom, left:right],
        camera_p_m=(float(middle[0]), float(middle[1]), float(middle[2])),
        length_m=float(sides[2]),
        width_m=float(sides[1]),
    )
    place = None if vehicle is None else vehicle.from_camera(camera, middle)
    area_m2 = sight.area_m2 * float(mine.mean())
    return replace(sight, region=part, ned_p_m=place, points_m=points[mine], area_m2=area_m2, body=None, pose=None)


def is_part(sight: Sight, pose: Pose, camera: Camera) -> bool:
    """Whether a region is a part of the body with a pose that was found beside it: mostly within reach of its bones."""
    region = sight.region
    if region.camera_p_m is None:
        return False
    around = around_bones(pose, region, REACH_M * camera.fx_px / region.camera_p_m[2])
    return float((region.mask & around).sum()) >= _PART * float(region.mask.sum())


def touches_more(sight: Sight, pose: Pose, camera: Camera) -> bool:
    """Whether a region goes on where no body with a pose can: farther from all bones, seen or not, than what hangs on a
    body does."""
    region = sight.region
    if region.camera_p_m is None:
        return False
    around = around_bones(pose, region, LOOSE_M * camera.fx_px / region.camera_p_m[2], least_seen=0.0)
    return float((region.mask & ~around).sum()) >= _LEAST_CUT * float(region.mask.sum())


def around_bones(pose: Pose, region: Region, reach_px: float, least_seen: float = _SEEN) -> Mask:
    """Which pixels (height, width) of a region's box lie within a reach of the bones that are seen, px.

    Args:
        pose: whose bones.
        region: of whose box.
        reach_px: how far from them, px.
        least_seen: a bone is seen if both ends have more confidence than this.
    """
    _, _, width, height = region.box_px
    drawn = np.zeros((height, width), np.uint8)
    places = np.round(pose.joints_px - region.box_px[:2]).astype(int).clip(-4000, 4000)
    for a, b in BONES:
        if min(pose.confidence[a], pose.confidence[b]) > least_seen:
            ends = (int(places[a, 0]), int(places[a, 1])), (int(places[b, 0]), int(places[b, 1]))
            cv2.line(drawn, *ends, 1, max(1, round(2.0 * reach_px)))
    return drawn > 0
