"""Where somebody goes on beyond the depth picture: by their colours, in a colour picture that reaches farther.

The paper's two pictures show the same. A Kinect's colour camera sees more to the sides than its depth camera, so that
whoever is there has half a region; the other half is what hangs on it and is coloured otherwise than the floor around.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter

from onboard.people.pose import Picture
from onboard.people.regions import Mask, Region, Registration

REACH_M = 1.1
"""So far beyond the depth picture somebody may go on, m: the length of a trunk and an arm."""
_RING_M = 0.5
"""The floor is what lies so near to them in the depth picture, m."""
_APART_PX = 5
"""Between a region and its floor: the depth picture's edges of things are not the colour picture's."""
_COARSE = 2
"""Pixels of the picture along a pixel of the window that is looked at."""
_BINS, _COLOUR_REACH = 12, 48.0
_SMOOTH_BINS = 0.7
_UNSEEN = 0.3
"""How often a colour that the region has not counts as seen in it, and one that the floor has not in the floor, in
pixels a bin: what has neither's colours hangs on the region rather than on the floor."""
_LIKE_FLOOR = 0.2
"""Share of the floor that looks like the region; with more the colours do not tell."""
_MOST_M2 = 0.9
"""Area beyond; more than that is no body."""
_SHARED = 0.5
"""Regions that share so much of the smaller one are one."""
_FEWEST = 50
"""Pixels of the window with which colours are known."""


def whole(picture: Picture, region: Region, registration: Registration) -> Region:
    """A region that the depth picture's end cuts (`Region.cut`), with what hangs on it beyond; as it is where the
    colours do not tell.

    Args:
        picture: (H, W, 3) BGR.
        region: with depth.
        registration: depth camera to colour camera.
    """
    if not region.cut or region.camera_p_m is None:
        return region
    scale = registration.colour.fx_px / region.camera_p_m[2]
    window = _Window.around(picture, region, REACH_M * scale)
    beyond = window.beyond(registration, region.camera_p_m[2])
    apart = cv2.distanceTransform((~window.mask).astype(np.uint8), cv2.DIST_L2, 3) * _COARSE
    floor = (apart > _APART_PX) & (apart < _RING_M * scale) & ~beyond
    if min(floor.sum(), window.mask.sum()) < _FEWEST:
        return region
    like = _like_region(window.picture, window.mask, floor)
    if like[floor].mean() > _LIKE_FLOOR:
        return region
    more = cv2.morphologyEx((like & beyond).astype(np.uint8), cv2.MORPH_OPEN, np.ones((2, 2), np.uint8)) > 0
    _, labels = cv2.connectedComponents((more | (apart <= _APART_PX)).astype(np.uint8))
    joined = window.mask | (more & np.isin(labels, np.unique(labels[window.mask])))
    if (joined & beyond).sum() * _COARSE**2 > _MOST_M2 * scale**2:
        return region
    return window.grown(region, joined)


def one_beyond(a: Region, b: Region) -> bool:
    """Whether two regions that the depth picture's end cuts are one beyond it: an arm and the trunk where it begins."""
    if not (a.cut and b.cut):
        return False
    left, top = max(a.box_px[0], b.box_px[0]), max(a.box_px[1], b.box_px[1])
    right = min(a.box_px[0] + a.box_px[2], b.box_px[0] + b.box_px[2])
    bottom = min(a.box_px[1] + a.box_px[3], b.box_px[1] + b.box_px[3])
    if right <= left or bottom <= top:
        return False
    masks = (r.mask[top - r.box_px[1] : bottom - r.box_px[1], left - r.box_px[0] : right - r.box_px[0]] for r in (a, b))
    common = np.logical_and(*masks).sum()
    return bool(common > _SHARED * min(a.mask.sum(), b.mask.sum()))


@dataclass(frozen=True)
class _Window:
    """A piece of the picture around a region, at a fraction of its resolution."""

    corner: tuple[int, int]
    """x, y in the picture, px."""
    picture: Picture
    """(h, w, 3)."""
    mask: Mask
    """(h, w): which of it is the region."""

    @classmethod
    def around(cls, picture: Picture, region: Region, reach_px: float) -> _Window:
        """What lies within a reach of a region's box."""
        x, y, width, height = region.box_px
        reach = round(reach_px)
        left, top = max(x - reach, 0), max(y - reach, 0)
        piece = picture[top : y + height + reach, left : x + width + reach]
        mask = np.zeros(piece.shape[:2], np.uint8)
        mask[y - top : y - top + height, x - left : x - left + width] = region.mask
        size = (max(piece.shape[1] // _COARSE, 1), max(piece.shape[0] // _COARSE, 1))
        small = np.asarray(cv2.resize(piece, size, interpolation=cv2.INTER_AREA), np.uint8)
        return cls((left, top), small, cv2.resize(mask, size, interpolation=cv2.INTER_NEAREST) > 0)

    def beyond(self, registration: Registration, depth_m: float) -> Mask:
        """Which pixels (h, w) the depth picture does not show, of what is at a depth."""
        right, bottom = registration.depth.width - 1.0, registration.depth.height - 1.0
        corners = np.array([(0.0, 0.0), (right, 0.0), (right, bottom), (0.0, bottom)])
        pixels = registration.colour.project(registration.points(registration.depth.rays(corners) * depth_m))
        covered = np.zeros(self.mask.shape, np.uint8)
        cv2.fillConvexPoly(covered, np.round((pixels - self.corner) / _COARSE).astype(np.int32), 1)
        return covered == 0

    def grown(self, region: Region, joined: Mask) -> Region:
        """A region with everything that was joined to it, (h, w)."""
        x, y, width, height = region.box_px
        rows, columns = (np.flatnonzero(joined.any(axis=axis)) for axis in (1, 0))
        left, top = min(x, int(columns[0]) * _COARSE + self.corner[0]), min(y, int(rows[0]) * _COARSE + self.corner[1])
        right = max(x + width, (int(columns[-1]) + 1) * _COARSE + self.corner[0])
        bottom = max(y + height, (int(rows[-1]) + 1) * _COARSE + self.corner[1])
        size = (joined.shape[1] * _COARSE, joined.shape[0] * _COARSE)
        fine = cv2.resize(joined.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
        mask = np.zeros((bottom - top, right - left), bool)
        rows, columns = np.nonzero(fine)
        rows, columns = rows + self.corner[1] - top, columns + self.corner[0] - left
        mask[rows, columns] = True
        mask[y - top : y - top + height, x - left : x - left + width] |= region.mask
        return replace(region, box_px=(left, top, right - left, bottom - top), mask=mask)


def _like_region(window: Picture, theirs: Mask, floor: Mask) -> Mask:
    """Which pixels of a window (H, W, 3) are rather coloured as a region than as its floor."""
    lab = cv2.cvtColor(window, cv2.COLOR_BGR2LAB).astype(np.float32)
    light = lab[..., 0] * (_BINS / 256.0)
    colour = (lab[..., 1:] - 128.0 + _COLOUR_REACH) * (_BINS / (2.0 * _COLOUR_REACH))
    bins = np.clip(np.dstack((light, colour)), 0, _BINS - 1).astype(np.int32)
    numbers = (bins[..., 0] * _BINS + bins[..., 1]) * _BINS + bins[..., 2]
    shares = []
    for part in (theirs, floor):
        counts = np.bincount(numbers[part], minlength=_BINS**3).reshape((_BINS,) * 3).astype(float)
        smooth = gaussian_filter(counts, _SMOOTH_BINS, mode="nearest") + _UNSEEN
        shares.append((smooth / smooth.sum()).ravel())
    return np.asarray((shares[0] > shares[1])[numbers])
