"""What a person looks like: colours of head, trunk and legs, taken in the frame of the pose.

This stands for the paper's degree of appearance similarity (DOAS), a classifier trained on pedestrians. Parts are found
by the joints, so that turning the camera or changing its distance changes nothing, and a hat is never compared with a
pair of trousers.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from common.geometry.rotation import Array
from onboard.people.pose import ANKLE_L, ANKLE_R, HEAD, HIP_L, HIP_R, KNEE_L, KNEE_R, NECK, Picture, Pose, upright_crop
from onboard.people.regions import Mask, Region

PARTS = ("head", "trunk", "legs")
_WEIGHTS = np.array([0.15, 0.5, 0.35])
"""How much each part says when all are seen: clothes more than hair."""
_SIDE_PX = 96
_MARGIN = 1.3
_LIGHT_BINS, _COLOUR_BINS, _COLOUR_REACH = 8, 11, 42.0
_FEWEST_PX = 12
"""A part of fewer pixels in the upright crop is not seen."""
_SHOULDER_R, _SHOULDER_L = 2, 5


@dataclass(frozen=True)
class Look:
    """Colours of a person at one time."""

    histograms: Array
    """(3, B) square roots of the shares of each colour in head, trunk and legs; a row of zeros where not seen."""

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(3,) which parts were seen."""
        return np.asarray(self.histograms.max(axis=1) > 0)


def look_of(picture: Picture, region: Region, pose: Pose) -> Look:
    """Colours of the parts of a person.

    Args:
        picture: (H, W, 3) BGR.
        region: whose mask says what is the person and what is the ground beside.
        pose: where the parts are.
    """
    along = pose.joints_px @ pose.up
    across = pose.joints_px @ np.array([-pose.up[1], pose.up[0]])
    centre = 0.5 * (along.max() + along.min()) * pose.up
    centre = centre + 0.5 * (across.max() + across.min()) * np.array([-pose.up[1], pose.up[0]])
    side = max(_MARGIN * max(float(np.ptp(along)), float(np.ptp(across))), 4.0)
    crop, back = upright_crop(picture, centre, pose.up, side, _SIDE_PX)
    joints = (pose.joints_px - back[:, 2]) @ np.linalg.inv(back[:, :2]).T
    bins = _bins(crop)
    inside = _warped_mask(region, back)
    rows = [_histogram(bins[part & inside]) for part in _part_masks(joints)]
    return Look(np.stack(rows))


def similarity(a: Look, b: Look) -> float:
    """Share of common colour, 0 to 1: the Bhattacharyya coefficient, mean over the parts that both looks show; 0 when
    they share none."""
    weights = _WEIGHTS * (a.seen & b.seen)
    if not weights.any():
        return 0.0
    return float(weights @ np.sum(a.histograms * b.histograms, axis=1) / weights.sum())


def _bins(crop: Picture) -> NDArray[np.int64]:
    """Number of the colour of each pixel: CIELAB, coarser in lightness than in hue and saturation."""
    lab = cv2.cvtColor(crop, cv2.COLOR_BGR2LAB).astype(float)
    light = np.minimum(lab[..., 0] * (_LIGHT_BINS / 256.0), _LIGHT_BINS - 1).astype(int)
    colour = (lab[..., 1:] - 128.0 + _COLOUR_REACH) * (_COLOUR_BINS / (2.0 * _COLOUR_REACH))
    colour = np.clip(colour, 0, _COLOUR_BINS - 1).astype(int)
    return (light * _COLOUR_BINS + colour[..., 0]) * _COLOUR_BINS + colour[..., 1]


def _histogram(bins: NDArray[np.int64]) -> Array:
    size = _LIGHT_BINS * _COLOUR_BINS**2
    if len(bins) < _FEWEST_PX:
        return np.zeros(size)
    counts = np.bincount(bins, minlength=size).reshape(_LIGHT_BINS, _COLOUR_BINS, _COLOUR_BINS).astype(float)
    # A little of each colour counts as its neighbours: light changes, and bins have edges.
    for axis in range(3):
        padded = np.pad(counts, [(1, 1) if k == axis else (0, 0) for k in range(3)])
        length = counts.shape[axis]
        before, after = (padded.take(range(start, start + length), axis) for start in (0, 2))
        counts = 0.7 * counts + 0.15 * (before + after)
    return np.sqrt(counts.ravel() / counts.sum())


def _warped_mask(region: Region, back: Array) -> Mask:
    shifted = back.copy()
    shifted[:, 2] -= region.box_px[:2]
    flags = cv2.WARP_INVERSE_MAP | cv2.INTER_NEAREST
    return np.asarray(cv2.warpAffine(region.mask.astype(np.uint8), shifted, (_SIDE_PX, _SIDE_PX), flags=flags)) > 0


def _part_masks(joints: Array) -> list[Mask]:
    """Masks (side, side) of head, trunk and legs in the upright crop; trunk and legs without what the head covers."""
    places = np.round(joints).astype(int)
    head, trunk, legs = (np.zeros((_SIDE_PX, _SIDE_PX), np.uint8) for _ in PARTS)
    body = max(1.0, float(np.linalg.norm(joints[HEAD] - 0.5 * (joints[ANKLE_R] + joints[ANKLE_L]))))
    radius = max(2, round(0.6 * float(np.linalg.norm(joints[HEAD] - joints[NECK]))))
    cv2.circle(head, _at(places[HEAD]), radius, 1, -1)
    hull = cv2.convexHull(places[[_SHOULDER_R, _SHOULDER_L, HIP_L, HIP_R]].astype(np.int32))
    cv2.fillConvexPoly(trunk, hull, 1)
    cv2.polylines(trunk, [hull], True, 1, max(1, round(0.08 * body)))
    for hip, knee, ankle in ((HIP_R, KNEE_R, ANKLE_R), (HIP_L, KNEE_L, ANKLE_L)):
        line = places[[hip, knee, ankle]].reshape(-1, 1, 2).astype(np.int32)
        cv2.polylines(legs, [line], False, 1, max(1, round(0.1 * body)))
    free = head == 0
    return [~free, (trunk > 0) & free, (legs > 0) & free & (trunk == 0)]


def _at(place: NDArray[np.int_]) -> tuple[int, int]:
    return int(place[0]), int(place[1])
