"""Which detection is which known person: the cost of a match, and the best assignment (Al-Kaff 2019, section 4.3)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from common.geometry.rotation import Array
from onboard.people.appearance import Look, similarity
from onboard.people.config import AssociationConfig
from onboard.people.pose import HEAD, Pose
from onboard.people.pose_filter import upright

_JOINT_WEIGHTS = np.array([1.0, 1.0, 1.0, 0.7, 0.4, 1.0, 0.7, 0.4, 1.0, 0.8, 0.6, 1.0, 0.8, 0.6, 1.0])
"""The paper's w: what swings says less than what does not."""
_SEEN = 0.5
"""The paper's a: joints of less confidence are not compared."""
_IMPOSSIBLE = 1e6


def pose_dissimilarity(a: Pose, b: Pose) -> float:
    """Weighted mean distance of the joints of two poses, in body lengths (Al-Kaff 2019, eq. 7).

    Both are turned upright and their heads laid on each other, as printed; both are scaled to the same body length
    besides, so that the distance of the camera does not count. 1 when they share no joint.
    """
    weights = _JOINT_WEIGHTS * (a.confidence > _SEEN) * (b.confidence > _SEEN)
    weights[HEAD] = 0.0  # laid on each other: always equal
    if not weights.any():
        return 1.0
    distances = np.linalg.norm(_normalised(a) - _normalised(b), axis=1)
    return float(distances @ weights / weights.sum())


def _normalised(pose: Pose) -> Array:
    joints = upright(pose.joints_px)
    joints = joints - joints[HEAD]
    return joints / max(float(np.ptp(joints[:, 1])), 1e-6)


def match_cost(
    looks: Sequence[Look], pose: Pose, look: Look, seen: Pose, gap_s: float, config: AssociationConfig
) -> float:
    """Cost of taking a detection for a known person, 0 for the same look in the same pose.

    Al-Kaff 2019, eqs 5 and 6 multiply a negated similarity by the pose distance, which as printed rewards a larger
    pose distance, and even with the sign put right would match anybody who takes the same pose. Here
    c = d_a (1 + w d_p), with d_a = 1 - similarity: it grows with both, the appearance decides, and a pose weighs the
    less the longer ago it was.

    Args:
        looks: gallery of the person; the most similar one counts.
        pose: the person's last pose.
        look: of the detection.
        seen: pose of the detection.
        gap_s: time since the person was last seen, s.
        config: weight and memory of the pose.
    """
    dissimilarity = 1.0 - max(similarity(known, look) for known in looks)
    weight = config.pose_weight * float(np.exp(-gap_s / config.pose_memory_s))
    return dissimilarity * (1.0 + weight * pose_dissimilarity(pose, seen))


def assign(costs: Array, gate: float) -> list[tuple[int, int]]:
    """Pairs (row, column) of the assignment with the smallest sum (Hungarian method), none above the gate.

    Args:
        costs: (T, D) of people and detections; infinite where impossible.
        gate: largest cost of a match. What is left over counts as this much, so that a pair that costs more never
            pushes a good one out.
    """
    if not costs.size:
        return []
    bounded = np.where(np.isfinite(costs), costs, _IMPOSSIBLE)
    rows, columns = linear_sum_assignment(np.minimum(bounded, gate))
    return [(int(r), int(c)) for r, c in zip(rows, columns, strict=True) if bounded[r, c] < gate]
