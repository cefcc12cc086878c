"""The pose in a region whatever way the body lies: upright crops, and the end where the head is (section 4.1)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from common.geometry.rotation import Array
from onboard.people.pose import HEAD, NECK, STANDING_M, WAIST, Picture, Pose, upright_crop
from onboard.people.pose_network import PoseNetwork
from onboard.people.regions import Region

_FIRST_MARGIN, _MARGIN = 1.3, 1.45
"""Side of the crop over the length of what it shows: of the region, which may lack the soles, and of the joints, which
lack the crown of the head, the hands and the feet."""

_NECK, _COVERED = 0.35, 0.75
"""Head to neck over the trunk, and the joints' extent over the region's, that an upright body reaches (vtest.avi)."""
_DECIDED = 0.5
"""One end is out when it is rated below this share of the other."""
_NOBODY, _SURE = 0.05, 0.95
"""Presence below which no end of a region is worth a second look, and above which one look may be enough."""
_CLEAR = 3.0
"""Rating (of 4 at most) that a body standing on its head does not reach: the other end need not be tried. In simulated
flights the right end of people was rated 3.1 to 4.0 in nine of ten looks, the wrong one at most 1.6."""
_UPRIGHT, _SAME_WAY = 0.97, 0.8
"""Cosines of the turns between crop and body, and from picture to picture, up to which it is."""


class PoseFinder:
    """Finds the pose in a region whatever way the body lies.

    Args:
        network: what finds joints in an upright crop.
    """

    def __init__(self, network: PoseNetwork):
        self.network = network

    def find(
        self,
        picture: Picture,
        region: Region,
        expected: Pose | None = None,
        enough: Callable[[Pose], bool] = lambda _: False,
    ) -> Pose:
        """The pose in a region: upright along its principal axis, the likelier end up, then, unless that is a body
        beyond doubt, the other way round; the better one once more along the line from its feet to its head, unless the
        first look was upright already.

        Args:
            picture: (H, W, 3) BGR.
            region: where to look.
            expected: the pose as it ought to be, where it is known from before: one look there is enough where it finds
                a body.
            enough: whether a look needs no other.
        """
        middle, axis, length = _likely_end_up(region)
        if expected is not None:
            pose = self._expected(picture, region, expected, middle, length)
            if enough(pose) or (pose.presence >= _SURE and float(pose.up @ expected.up) > _SAME_WAY):
                return pose
        ways = (axis, -axis)
        likely = self._at(picture, middle, axis, _FIRST_MARGIN * length)
        upright = likely.presence >= _SURE and float(likely.up @ axis) > _UPRIGHT
        if enough(likely) or (upright and _rating(likely, axis, length) > _CLEAR):
            return likely
        first = [likely, self._at(picture, middle, -axis, _FIRST_MARGIN * length)]
        rated = sorted(((_rating(pose, way, length), k) for k, (pose, way) in enumerate(zip(first, ways, strict=True))))
        best, index = rated[-1]
        if max(pose.presence for pose in first) < _NOBODY:
            return first[index]
        # A second look along the line that was found; at both ends where the first look does not decide.
        undecided = [k for rating, k in rated if rating > _DECIDED * best]
        sure = len(undecided) == 1 and first[index].presence >= _SURE
        if sure and float(first[index].up @ ways[index]) > _UPRIGHT:
            return first[index]
        looks = [(best, first[index])]
        for k in undecided:
            pose = self.again(picture, first[k])
            looks.append((_rating(pose, first[k].up, length), pose))
        return max(looks, key=lambda look: look[0])[1]

    def _expected(self, picture: Picture, region: Region, expected: Pose, middle: Array, length: float) -> Pose:
        if (region.height_m or 0.0) > STANDING_M:
            # From above, head and feet are too near each other to lay a crop around them.
            return self._at(picture, middle, expected.up, _FIRST_MARGIN * length)
        return self.again(picture, expected)

    def again(self, picture: Picture, pose: Pose) -> Pose:
        """The pose in a crop upright along the line from the feet to the head of another, around its joints."""
        axes = np.column_stack((pose.up, (-pose.up[1], pose.up[0])))
        places = pose.joints_px @ axes
        low, high = places.min(axis=0), places.max(axis=0)
        return self._at(picture, axes @ (0.5 * (low + high)), pose.up, _MARGIN * float(max(high - low)))

    def _at(self, picture: Picture, centre: Array, up: Array, side: float) -> Pose:
        crop, back = upright_crop(picture, centre, up, max(side, 8.0), self.network.model.size_px)
        joints, confidence, presence = self.network(crop)
        return Pose(joints @ back[:, :2].T + back[:, 2], confidence, presence)


def _likely_end_up(region: Region) -> tuple[Array, Array, float]:
    """Middle (2,) of a region, px, direction (2,) to the end where the head is likely to be, and its length, px: of
    somebody upright the top, of somebody who lies the end that more of the region, trunk and arms, lies near."""
    start, end = region.axis()
    middle, length = 0.5 * (start + end), float(np.linalg.norm(end - start))
    if length < 1.0:
        return middle, np.array([0.0, 1.0]), 1.0
    axis = (end - start) / length
    stands = region.crown is not None and (region.height_m or 0.0) > STANDING_M
    towards = region.crown.middle_px if stands and region.crown is not None else region.middle_px
    return middle, axis if float((towards - middle) @ axis) > 0 else -axis, length


def _rating(pose: Pose, up: Array, length_px: float) -> float:
    """How well a pose fits the crop that it was found in, whose up is (2,), and a region of a length: present, visible,
    trunk and legs upright, the neck as long as necks are, and the body as long as the region.

    Presence alone does not tell the ends apart: it may stay at 1 for a body that stands on its head. A network that is
    shown one squeezes an upright body into its legs.
    """
    trunk = pose.joints_px[NECK] - pose.joints_px[WAIST]
    legs = pose.joints_px[WAIST] - pose.feet_px
    neck = float(np.linalg.norm(pose.joints_px[HEAD] - pose.joints_px[NECK]))
    cosines = sum(float(v @ up / max(np.linalg.norm(v), 1e-9)) for v in (trunk, legs))
    covered = float(np.ptp(pose.joints_px @ up)) / length_px
    return (
        pose.presence
        * float(pose.confidence.mean())
        * (2.0 + cosines)
        * min(1.0, neck / max(_NECK * float(np.linalg.norm(trunk)), 1e-9))
        * min(1.0, covered / _COVERED)
    )
