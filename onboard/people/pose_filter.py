"""The Human Pose Filter: which poses are those of people (Al-Kaff 2019, section 4.2, eqs 1 to 4)."""

from __future__ import annotations

import math

import numpy as np

from common.geometry.rotation import Array
from onboard.people.config import PoseFilterConfig
from onboard.people.pose import ANKLE_L, ANKLE_R, HEAD, HIP_L, HIP_R, KNEE_L, KNEE_R, NECK, WAIST, Pose
from onboard.people.regions import Region

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
    if not config.least_filled <= share <= config.most_filled:
        return f"a body {share:.2f} times as long as the region"
    if focal_px is not None and region.camera_p_m is not None:
        extent_m = float(np.ptp(pose.joints_px, axis=0).max()) * region.camera_p_m[2] / focal_px
        if not config.least_body_m <= extent_m <= config.most_body_m:
            return f"a body {extent_m:.2f} m long"
    return ""
