"""People who stand, seen as columns over the floor: apart there, however they cover each other in the picture.

The paper has no such step: its people lie. From above, whoever passes behind somebody else, or behind whose feet a
thing lies, is one cluster with them in the picture, and neither seen along the floor: what stands is narrow, and its
points lie around an upright axis through the trunk. Low, that is the legs; high, the arms may reach farther.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from common.geometry.rotation import Array
from onboard.people.depth import Floats, Ints

_TRUNK_M = 1.0
"""What reaches higher may be somebody who stands; who sits does not."""
_LEAST_TOP_M, _KNEE_M = 1.2, 0.4
_CELL_M = 0.06
CORE_M = 0.30
"""Trunk and head end so far from the axis, m."""
_APART_M = 0.45
"""Two axes are at least so far from each other, m: shoulder to shoulder."""
_LEAST_CORE_M2, _MOST_HIGH_M2 = 0.03, 0.7
"""Area across the rays of the trunk, at least, and of everything high, at most, m²: a wall or a tree is no column."""
_LEGS_M, _ARMS_M = 0.42, 0.95
"""How far from the axis the legs end, and the arms, m."""
_ARM_DENSITY, _LEAST_LEGS_M2 = 0.5, 0.02
_FLOATS_PERCENT, _SHOULDER_M = 5.0, 0.25
"""A piece floats if no more of its points than this are below `_TRUNK_M`: things stand on something that is seen
beside them. An arm that is held out floats where the shoulder is hidden behind the head; the axis of whom it hangs on
lies so far beyond its end, m, along it."""
_LEGS_SHARE, _ARMS_SHARE = 0.35, 0.7
"""Below the one share of the height all is within reach of the legs, above the other of the arms."""


@dataclass(frozen=True)
class Column:
    """Somebody who may be standing."""

    rows: Ints
    """(M,) which of the points."""
    core: Ints
    """(K,) those of them that are trunk and head."""


def columns(flat_m: Floats, heights_m: Floats, areas_m2: Array, labels: Ints) -> list[Column]:
    """Columns among points above the floor; no point is in two.

    Args:
        flat_m: (N, 2) coordinates in the floor's plane, m.
        heights_m: (N,) above it, m.
        areas_m2: (N,) what each stands for across the rays, m².
        labels: (N,) clusters in the picture; an arm is in that of its trunk.
    """
    high = np.flatnonzero((heights_m > _TRUNK_M) & (labels >= 0)).astype(np.int32)
    axes = _axes(flat_m, heights_m, areas_m2, high)
    if not len(axes):
        return []
    distances = np.linalg.norm(flat_m[:, None] - axes, axis=2)
    nearest = np.argmin(distances, axis=1)
    apart = distances[np.arange(len(flat_m)), nearest]
    trunk = (apart < CORE_M) & (heights_m > _TRUNK_M)
    arms = _arms(flat_m, heights_m, labels, axes, labels[trunk])
    for rows, owner in arms:
        nearest[rows], apart[rows] = owner, distances[rows, owner]
    found = []
    for k in range(len(axes)):
        mine = nearest == k
        core = np.flatnonzero(mine & trunk).astype(np.int32)
        if areas_m2[core].sum() < _LEAST_CORE_M2:
            continue
        top_m = float(np.percentile(heights_m[core], 99.0))
        own = [*labels[core][labels[core] >= 0], *(labels[rows[0]] for rows, owner in arms if owner == k)]
        joined = mine & ((apart < CORE_M) | np.isin(labels, own))
        if top_m < _LEAST_TOP_M or areas_m2[joined & (heights_m > _TRUNK_M)].sum() > _MOST_HIGH_M2:
            continue
        share = np.clip((heights_m / top_m - _LEGS_SHARE) / (_ARMS_SHARE - _LEGS_SHARE), 0.0, 1.0)
        within = joined & (apart < _LEGS_M + share * (_ARMS_M - _LEGS_M))
        found.append(Column(np.flatnonzero(within).astype(np.int32), core))
    return found


def _arms(flat_m: Floats, heights_m: Floats, labels: Ints, axes: Array, trunks: Ints) -> list[tuple[Ints, int]]:
    """Rows of each piece that nothing is seen to carry and that points at one of the axes (K, 2), and which.

    Args:
        flat_m: (N, 2) as in `columns`.
        heights_m: (N,) as there.
        labels: (N,) as there.
        axes: (K, 2) of those who may be standing.
        trunks: labels of their trunks.
    """
    found = []
    for name in np.setdiff1d(labels[(heights_m > _TRUNK_M) & (labels >= 0)], trunks):
        rows = np.flatnonzero(labels == name).astype(np.int32)
        if len(rows) < 3 or np.percentile(heights_m[rows], _FLOATS_PERCENT) < _TRUNK_M:
            continue
        points = flat_m[rows].astype(float)
        middle = points.mean(axis=0)
        _, vectors = np.linalg.eigh((points - middle).T @ (points - middle))
        along = (points - middle) @ vectors[:, 1]
        shoulders = middle + np.outer((along.min() - _SHOULDER_M, along.max() + _SHOULDER_M), vectors[:, 1])
        gaps = np.linalg.norm(axes[:, None] - shoulders, axis=2).min(axis=1)
        owner = int(np.argmin(gaps))
        if gaps[owner] < CORE_M:
            found.append((rows, owner))
    return found


def _axes(flat_m: Floats, heights_m: Floats, areas_m2: Array, high: Ints) -> Array:
    """Places (K, 2) where high points are densest, no two too near each other. An arm that is held out is dense, too,
    but there is less of it than of the trunk beside, and it stands on no legs."""
    if not len(high):
        return np.empty((0, 2))
    trunks, weights = flat_m[high].astype(float), areas_m2[high]
    legs = flat_m[(heights_m > _KNEE_M) & (heights_m < _TRUNK_M)]
    legs_m2 = areas_m2[(heights_m > _KNEE_M) & (heights_m < _TRUNK_M)]
    places: list[tuple[float, Array]] = []
    for density, peak in _peaks(trunks, weights):
        place = peak
        for _ in range(2):
            near = np.linalg.norm(trunks - place, axis=1) < CORE_M
            place = np.average(trunks[near], axis=0, weights=weights[near]) if near.any() else place
        gaps = [float(np.linalg.norm(place - other)) for _, other in places]
        below_m2 = float(legs_m2[np.linalg.norm(legs - place, axis=1) < CORE_M].sum())
        arm = any(
            gap < _ARMS_M and density < _ARM_DENSITY * denser and below_m2 < _LEAST_LEGS_M2
            for gap, (denser, _) in zip(gaps, places, strict=True)
        )
        much = float(weights[np.linalg.norm(trunks - place, axis=1) < CORE_M].sum()) >= _LEAST_CORE_M2
        if much and not arm and min(gaps, default=_APART_M) >= _APART_M:
            places.append((density, place))
    return np.array([place for _, place in places]).reshape(-1, 2)


def _peaks(flat_m: Array, areas_m2: Array) -> list[tuple[float, Array]]:
    """Density and place (2,) of its peaks, the densest first."""
    low = flat_m.min(axis=0) - 2.0 * CORE_M
    cells = ((flat_m - low) / _CELL_M).astype(np.int32)
    shape = (cells.max(axis=0) + round(2.0 * CORE_M / _CELL_M) + 1)[::-1]
    sums = np.bincount(cells[:, 1] * shape[1] + cells[:, 0], areas_m2, int(shape[0] * shape[1])).reshape(shape)
    density = np.asarray(cv2.GaussianBlur(sums.astype(np.float32), (0, 0), 0.5 * CORE_M / _CELL_M))
    side = 2 * round(_APART_M / _CELL_M) + 1
    around = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    peaks = np.argwhere((density >= np.asarray(cv2.dilate(density, around))) & (density > 1e-6))
    found = [(float(density[row, column]), low + (np.array([column, row]) + 0.5) * _CELL_M) for row, column in peaks]
    return sorted(found, key=lambda peak: -peak[0])
