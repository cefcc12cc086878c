"""The Human Pose Filter: which poses are those of people (Al-Kaff 2019, section 4.2, eqs 1 to 4)."""

from __future__ import annotations

import math

import cv2
import numpy as np

from common.geometry.rotation import Array
from onboard.people.config import PoseFilterConfig
from onboard.people.pose import ANKLE_L, ANKLE_R, BONES, HEAD, HIP_L, HIP_R, KNEE_L, KNEE_R, NECK, WAIST, Pose
from onboard.people.regions import Region

_MARGIN = 0.06
"""How far beside its region a joint may lie, as a share of the region's longer side."""
_OF_CUT = 0.5
"""Where the depth picture ends within a region and the head is before that end, so much less of the joints need lie on
the region: the colour picture shows more of the body."""
_SEEN = 0.5
_SAME, _MOST = 0.1, 0.6
"""Joints within this share of a body's length of its bones are on it; and the share of all that makes a pose its."""
_SURE, _FAIR, _DOUBTFUL = 2.0, 1.0, 0.5
_BELOW_NECK = (HIP_R, KNEE_R, ANKLE_R, HIP_L, KNEE_L, ANKLE_L)


def upright(joints_px: Array) -> Array:
    """Joints (15, 2) turned about the head until the line from it to the middle of the feet points down.

    Al-Kaff 2019, eqs 1 to 3, with atan2 for the printed arctan of a quotient, which leaves half of all poses on their
    heads.
    """
    du, dv = joints_px[HEAD] - 0.5 * (joints_px[ANKLE_R] + joints_px[ANKLE_L])
    alpha = math.pi / 2 + math.atan2(dv, du)  # eq. 3
    cosine, sine = math.cos(alpha), math.sin(alpha)
    u, v = (joints_px - joints_px[HEAD]).T
    return joints_px[HEAD] + np.column_stack((u * cosine + v * sine, -u * sine + v * cosine))  # eqs 1 and 2


def pose_refusal(pose: Pose, region: Region, config: PoseFilterConfig, focal_px: float | None = None) -> str:
    """Why a pose is not that of a person, or nothing when it is.

    Eq. 4 asks for a head away from the neck by T and above it, and for hips, knees and ankles below the neck; it names
    joints 8 to 11 and so leaves out the left knee and ankle, which count here. T is a share of the body's length, so
    that distance does not matter. Further evidence: what the network says, whether the pose fills the region that it
    was found in, and with depth the length of the body in metres.

    Args:
        pose: what was found.
        region: where.
        config: thresholds.
        focal_px: of the colour camera; with it and a region with depth the body is measured.
    """
    joints = upright(pose.joints_px)
    length = float(np.linalg.norm(pose.joints_px[HEAD] - pose.feet_px))
    neck = float(np.linalg.norm(joints[HEAD] - joints[NECK]))
    trunk = float(np.linalg.norm(joints[NECK] - joints[WAIST]))
    start, end = region.axis()
    region_px = float(np.linalg.norm(end - start))
    if not np.isfinite(pose.joints_px).all():
        return "joints that are no numbers"
    inside = share_inside(pose, region)
    head = head_inside(pose, region)
    more = region.cut and head >= config.least_head  # of the body than the depth picture shows
    beside = inside < config.least_inside * (_OF_CUT if more else 1.0)
    if focal_px is not None and not beside and not foreshortened_refusal(pose, region, config, focal_px):
        return ""
    if pose.presence < config.least_presence:
        return f"presence {pose.presence:.2f}, less than {config.least_presence}"
    if float(pose.confidence.mean()) < config.least_confidence:
        return f"mean confidence {pose.confidence.mean():.2f}, less than {config.least_confidence}"
    if region_px < config.least_region_px:
        return f"region {region_px:.0f} px long, less than {config.least_region_px:g}"
    if not config.least_neck * length <= neck <= config.most_neck * length:
        return f"head {neck / max(length, 1e-9):.2f} body lengths from the neck"
    if joints[HEAD, 1] > joints[NECK, 1] or (joints[NECK, 1] > joints[list(_BELOW_NECK), 1]).any():
        return "head, neck and legs in an order that no body has"
    if trunk < config.least_trunk * length:
        return f"trunk {trunk / max(length, 1e-9):.2f} body lengths long, less than {config.least_trunk}"
    share = float(np.ptp(pose.joints_px @ pose.up)) / max(region_px, 1e-9)
    if share < config.least_filled or (share > config.most_filled and not more):
        return f"a body {share:.2f} times as long as the region"
    if focal_px is not None and region.camera_p_m is not None:
        extent_m = float(np.ptp(pose.joints_px, axis=0).max()) * region.camera_p_m[2] / focal_px
        if not config.least_body_m <= extent_m <= config.most_body_m:
            return f"a body {extent_m:.2f} m long"
    if region.camera_p_m is not None and not region.at_edge and head < config.least_head:
        return f"{head:.2f} of the head on the region, less than {config.least_head}"
    return f"{inside:.2f} of the joints on the region, less than {config.least_inside}" if beside else ""


def evidence(pose: Pose, region: Region, config: PoseFilterConfig, focal_px: float | None = None) -> float:
    """How much a pose that was not refused says, in looks: 2 for what things do not reach, a body as long, high and
    clear as those of people; 1 for somebody upright seen from above; half a look for the rest, which things reach now
    and then.

    Args:
        pose: what was found.
        region: where.
        config: thresholds.
        focal_px: of the colour camera, with depth.
    """
    clear = pose.presence >= config.sure_presence and float(pose.confidence.mean()) >= config.sure_confidence
    if focal_px is None or region.camera_p_m is None or region.height_m is None:
        return _FAIR if clear else _DOUBTFUL
    if not foreshortened_refusal(pose, region, config, focal_px):
        return _SURE if clear else _FAIR
    extent_m = float(np.ptp(pose.joints_px @ pose.up)) * region.camera_p_m[2] / focal_px
    low, high = config.sure_body_m
    low = config.sure_sitting_m if region.height_m >= config.least_upright_m else low
    metric = low <= extent_m <= high and region.height_m >= config.sure_height_m
    return _SURE if clear and metric else _DOUBTFUL


def foreshortened_refusal(pose: Pose, region: Region, config: PoseFilterConfig, focal_px: float) -> str:
    """Why a region with depth does not show somebody upright below the camera, or nothing when it does.

    Who stands or sits is seen from above as a head on shoulders: in the picture nothing hangs in the order of eq. 4. In
    metres it does: the head is on top of the region, of a head's size, and the shoulders below it are wider. The
    network has to find the head there.

    Args:
        pose: what was found.
        region: where.
        config: thresholds.
        focal_px: of the colour camera.
    """
    crown, height_m = region.crown, region.height_m
    if crown is None or height_m is None:
        return "no depth"
    if height_m < config.least_upright_m:
        return f"{height_m:.2f} m high, less than {config.least_upright_m}"
    if pose.presence < config.least_upright_presence:
        return f"presence {pose.presence:.2f}, less than {config.least_upright_presence}"
    if not config.least_crown_m2 <= crown.area_m2 <= config.most_crown_m2:
        return f"a top of {crown.area_m2:.3f} m²"
    if crown.below_m2 < config.least_shoulders * crown.area_m2:
        return f"{crown.below_m2:.3f} m² below a top of {crown.area_m2:.3f} m²"
    apart_m = float(np.linalg.norm(pose.joints_px[HEAD] - crown.middle_px)) * crown.depth_m / focal_px
    if apart_m > config.most_crown_apart_m:
        return f"the head {apart_m:.2f} m from the top"
    return ""


def same_body(a: Pose, b: Pose) -> bool:
    """Whether two poses of one picture are of one body: most joints of the one lie on the bones of the other."""
    begin, end = b.joints_px[BONES[:, 0]], b.joints_px[BONES[:, 1]]
    along = end - begin
    offsets = a.joints_px[:, None] - begin
    share = np.clip((offsets * along).sum(axis=2) / np.maximum((along**2).sum(axis=1), 1e-9), 0.0, 1.0)
    apart = np.linalg.norm(offsets - share[..., None] * along, axis=2).min(axis=1)
    length = max(float(np.ptp(b.joints_px, axis=0).max()), 1.0)
    return float((apart < _SAME * length).mean()) > _MOST


def share_inside(pose: Pose, region: Region) -> float:
    """Share of the joints that are seen which lie on the region's mask or close by: the pose of somebody beside it lies
    elsewhere."""
    seen = pose.joints_px[pose.confidence > _SEEN] if (pose.confidence > _SEEN).any() else pose.joints_px
    x, y, w, h = region.box_px
    margin = max(2, round(_MARGIN * max(w, h)))
    grown = np.pad(region.mask, margin).astype(np.uint8)
    grown = np.asarray(cv2.dilate(grown, np.ones((2 * margin + 1,) * 2, np.uint8)))
    places = np.round(seen - (x - margin, y - margin)).astype(int)
    within = ((places >= 0) & (places < (grown.shape[1], grown.shape[0]))).all(axis=1)
    return float(grown[places[within, 1], places[within, 0]].sum()) / len(places)


def head_inside(pose: Pose, region: Region) -> float:
    """Share of a disc around the head, half as wide as the neck is long, that lies on the region's mask: a body made up
    of planks and the legs of somebody beside has its head on the ground."""
    _, _, width, height = region.box_px
    radius = max(2, round(0.5 * float(np.linalg.norm(pose.joints_px[HEAD] - pose.joints_px[NECK]))))
    middle = np.round(pose.joints_px[HEAD] - region.box_px[:2]).astype(int)
    side = np.arange(-radius, radius + 1)
    columns, rows = (axis.ravel() for axis in np.meshgrid(side, side))
    disc = columns**2 + rows**2 <= radius**2
    columns, rows = columns[disc] + middle[0], rows[disc] + middle[1]
    within = (columns >= 0) & (rows >= 0) & (columns < width) & (rows < height)
    return float(region.mask[rows[within], columns[within]].sum()) / len(within)
