"""The target's box by what is no part of its surroundings, whatever it looks like.

A tracker knows the looks of the side that it began with, and clings to that while the target turns away. Who knows the
surroundings knows the whole target by what differs from them.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from common.tracking.base import Box, center_of
from onboard.fusion.source import Source

SILHOUETTE = Source("silhouette", (0.03, 0.03, 0.05, 0.05), threshold=0.5)
"""As a source of the fusion: its errors are those of a small picture's edges."""
_SPECK = 3
"""Extent of what is too small to be a part of it, and of the holes that its own look leaves, px of the mask."""
_EDGE = 0.15
"""Share of its fullest column, or row, from which on another one is a part of it: a rim, but no speck beside it."""
_ALIKE = 0.25
"""How much wider or higher than foreseen it may be, or less so, logarithm: something before it is not."""
_UNKNOWN = 0.15
"""Greatest share of it of which nobody knows what is there."""


def silhouette(apart: NDArray[np.int8], foreseen: Box, reach_px: float, shape: tuple[int, ...]) -> Box | None:
    """Box of the thing nearest to where the target is foreseen that is as large as it, px; None where there is none.

    Args:
        apart: what is no part of the surroundings: 1, what is: -1, what is unknown: 0, (h, w), at any size.
        foreseen: where the target should be, px.
        reach_px: how far from there its middle may be.
        shape: rows and columns of the picture that the boxes are of.
    """
    scale = np.array([apart.shape[1] / shape[1], apart.shape[0] / shape[0]])
    around = np.ones((_SPECK, _SPECK), np.uint8)
    mask = cv2.morphologyEx((apart > 0).astype(np.uint8), cv2.MORPH_CLOSE, around)
    mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, around)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask)
    best, least = None, reach_px
    for number in range(1, count):
        left, top, width, height = stats[number, : cv2.CC_STAT_AREA].tolist()
        part = labels[top : top + height, left : left + width] == number
        (x0, x1), (y0, y1) = _extent(part.sum(axis=0)), _extent(part.sum(axis=1))
        inside = slice(top + y0, top + y1), slice(left + x0, left + x1)
        if min(left + x0, top + y0) <= 0 or left + x1 >= mask.shape[1] or top + y1 >= mask.shape[0]:
            continue  # the picture's edge cuts it
        corner, size = np.array([left + x0, top + y0]) / scale, np.array([x1 - x0, y1 - y0]) / scale
        box: Box = (float(corner[0]), float(corner[1]), float(size[0]), float(size[1]))
        larger = max(abs(math.log(box[2] / foreseen[2])), abs(math.log(box[3] / foreseen[3])))
        if larger > _ALIKE or float(np.mean(apart[inside] == 0)) > _UNKNOWN:
            continue
        off = math.dist(center_of(box), center_of(foreseen))
        if off <= least:
            best, least = box, off
    return best


def _extent(counts: NDArray[np.int64]) -> tuple[int, int]:
    """First and one after the last column, or row, that is a part of a thing."""
    parts = np.flatnonzero(counts > _EDGE * counts.max())
    return int(parts[0]), int(parts[-1]) + 1
