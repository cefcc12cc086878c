"""Splitting of what touches: bodies that stand out of what joins them, seen from above (Al-Kaff 2019, section 4.1).

The paper has no such step. A cluster that is too large for one person is drawn as a map of heights over the floor, and
cut where the evidence is: at a height above which two or more bodies stand apart; at a step between something high and
something low beside it; or across a valley of the cluster's profile.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.geometry.rotation import Array
from onboard.people.config import ClusterConfig
from onboard.people.depth import Floats, Ints

_CELL_SPACINGS = 1.3
_LEVEL_STEP_M = 0.05
_STEP_M = 0.25
"""What stands higher than what lies beside it by this is something else."""
_PEAK_SHARE = 90
_DIRECTIONS = 12
_VALLEY = 0.6
"""A profile falls to this share of its lower peak between two bodies; along one body it does so at the neck alone,
whose far side is too small for a body."""
_MOST_PEOPLE = 2.0
"""What is larger than so many people is not cut for its width: walls, trees."""
_NARROWER = 0.75
"""The mean width of one side of such a cut is this share of the other's at most."""

Seeds = list[NDArray[np.bool_]]


@dataclass(frozen=True)
class Plan:
    """Two axes in the floor's plane."""

    axes: Array
    """(2, 3) orthogonal unit vectors in the optical frame."""

    @classmethod
    def of(cls, up: ArrayLike) -> Plan:
        """Axes across a direction up (3,); the first is the optical x axis as far as it lies in the plane."""
        up = np.asarray(up, dtype=float)
        first = np.array([1.0, 0.0, 0.0]) - up[0] * up
        if np.linalg.norm(first) < 1e-3:
            first = np.array([0.0, 1.0, 0.0]) - up[1] * up
        first /= np.linalg.norm(first)
        return cls(np.vstack((first, np.cross(up, first))))

    def flat(self, points_m: Floats) -> Floats:
        """Coordinates (N, 2) of points (N, 3) in the plane, m."""
        return points_m @ self.axes.T.astype(np.float32)


def parts(flat_m: Floats, heights_m: Floats, spacing_m: float, config: ClusterConfig) -> list[Ints]:
    """Rows of each part of a cluster; one list of all rows when nothing tells parts apart.

    Args:
        flat_m: (N, 2) coordinates in the floor's plane, m.
        heights_m: (N,) above the floor, m.
        spacing_m: distance between neighbouring points, m.
        config: least area of a part, and how far parts have to stand out.
    """
    cell = _CELL_SPACINGS * spacing_m
    places = np.floor((flat_m - flat_m.min(axis=0)) / cell).astype(np.int32) + 1
    shape = (int(places[:, 1].max()) + 2, int(places[:, 0].max()) + 2)
    flat_places = places[:, 1] * shape[1] + places[:, 0]
    counts = np.bincount(flat_places, minlength=shape[0] * shape[1])
    sums = np.bincount(flat_places, heights_m, minlength=shape[0] * shape[1])
    tops = (sums / np.maximum(counts, 1)).reshape(shape).astype(np.float32)
    tops = np.asarray(cv2.morphologyEx(tops, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)), np.float32)
    least_cells = max(2, round(config.least_area_m2 / cell**2))
    by_height = (
        _nearest_seed(seeds)[places[:, 1], places[:, 0]] for seeds in _seeds(tops, least_cells, config.split_depth_m)
    )
    few = len(flat_m) * spacing_m**2 <= _MOST_PEOPLE * config.most_area_m2
    last = _change(flat_m, cell, config) if few else ()
    for labels in chain(by_height, _valleys(flat_m, heights_m, cell), last):
        pieces = [np.flatnonzero(labels == k).astype(np.int32) for k in range(int(labels.max()) + 1)]
        if all(_is_body(flat_m[p], heights_m[p], least_cells, config) for p in pieces):
            return pieces
    return [np.arange(len(flat_m), dtype=np.int32)]


def _is_body(flat_m: Floats, heights_m: Floats, least_points: int, config: ClusterConfig) -> bool:
    if len(flat_m) < least_points:
        return False
    return max(float(np.hypot(*np.ptp(flat_m, axis=0))), float(heights_m.max())) >= config.least_length_m


def _seeds(tops: Floats, least_cells: int, depth_m: float) -> Iterator[Seeds]:
    """Sets of at least two seeds: what stands apart above a level, and what lies a step lower beside it."""
    lowest = float(tops[tops > 0].min())
    for level in np.arange(lowest, float(tops.max()) - depth_m, _LEVEL_STEP_M):
        standing = [
            seed
            for seed in _islands(tops > level, least_cells)
            if np.percentile(tops[seed], _PEAK_SHARE) >= level + depth_m
        ]
        if len(standing) > 1:
            yield standing
        if standing:
            beside = _beside(tops, standing, least_cells)
            if beside:
                yield standing + beside


def _valleys(flat_m: Floats, heights_m: Floats, cell: float) -> Iterator[Ints]:
    """Sides of each point, 0 or 1, of straight cuts where the body's profile along some direction has a valley, the
    deepest first."""
    cuts = []
    for angle in np.arange(_DIRECTIONS) * (np.pi / _DIRECTIONS):
        along = flat_m @ np.array([np.cos(angle), np.sin(angle)], np.float32)
        along -= along.min()
        profile = np.convolve(np.bincount((along / cell).astype(int), heights_m), (0.25, 0.5, 0.25), "same")
        # The lower of the two peaks on either side of each bin.
        lower = np.minimum(np.maximum.accumulate(profile), np.maximum.accumulate(profile[::-1])[::-1])
        place = int(np.argmin(profile / lower))
        if profile[place] < _VALLEY * lower[place]:
            cuts.append((float(profile[place] / lower[place]), (along > (place + 0.5) * cell).astype(np.int32)))
    yield from (sides for _, sides in sorted(cuts, key=lambda cut: cut[0]))


def _change(flat_m: Floats, cell: float, config: ClusterConfig) -> Iterator[Ints]:
    """Sides of each point, 0 or 1, of the cut across the longest side where its width changes most: a pipe that ends on
    somebody's shoulder leaves no valley."""
    centred = flat_m - flat_m.mean(axis=0)
    _, vectors = np.linalg.eigh(centred.T @ centred)
    along = centred @ vectors[:, 1]
    along -= along.min()
    if along.max() > _MOST_PEOPLE * config.most_length_m:
        return
    profile = np.bincount((along / cell).astype(int)).astype(float)
    ends = round(config.least_length_m / cell)
    places = np.arange(ends, len(profile) - ends)
    if not len(places):
        return
    sums, bins = np.cumsum(profile), np.arange(1, len(profile) + 1)
    before = sums[places - 1] / bins[places - 1]
    after = (sums[-1] - sums[places - 1]) / (len(profile) - bins[places - 1])
    between = places * (len(profile) - places) * (before - after) ** 2
    best = int(np.argmax(between))
    if min(before[best], after[best]) < _NARROWER * max(before[best], after[best]):
        yield (along > places[best] * cell).astype(np.int32)


def _islands(mask: NDArray[np.bool_], least_cells: int) -> Seeds:
    count, labels = cv2.connectedComponents(mask.astype(np.uint8))
    found = [np.asarray(labels == k) for k in range(1, count)]
    return [island for island in found if np.count_nonzero(island) >= least_cells]


def _beside(tops: Floats, high: Seeds, least_cells: int) -> Seeds:
    """Islands of what is left without the high parts and their edges, if it lies a step lower."""
    covered = np.logical_or.reduce(high)
    edge = np.asarray(cv2.dilate(covered.astype(np.uint8), np.ones((3, 3), np.uint8))) > 0
    lowest_peak = min(float(np.percentile(tops[seed], _PEAK_SHARE)) for seed in high)
    return [
        low
        for low in _islands((tops > 0) & ~edge, least_cells)
        if np.percentile(tops[low], _PEAK_SHARE) < lowest_peak - _STEP_M
    ]


def _nearest_seed(seeds: Seeds) -> Ints:
    """For each cell the number of the seed that is nearest."""
    distances = [cv2.distanceTransform((~seed).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) for seed in seeds]
    return np.argmin(np.stack([np.asarray(d) for d in distances]), axis=0).astype(np.int32)
