"""What stands out of the floor, cluster by cluster, with sizes in metres (Al-Kaff 2019, section 4.1)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from common.geometry.rotation import Array
from onboard.people.columns import columns
from onboard.people.compiled import dbscan
from onboard.people.config import ClusterConfig
from onboard.people.depth import Cloud, Floats, Ints
from onboard.people.floor import Floor
from onboard.people.split import Plan, parts

_ENDS = (1.0, 99.0)
"""Percentiles between which a side is measured: single flying pixels do not lengthen it."""
_MOST_SPLITS = 4


@dataclass(frozen=True)
class Cluster:
    """Points above the floor that belong together."""

    members: Ints
    """(M,) rows of the cloud."""
    centre_m: Array
    """(3,) mean in the optical frame, m."""
    long_axis: Array
    """(3,) unit vector along the longest side in the floor's plane, optical frame."""
    length_m: float
    """Longest side in the floor's plane, m."""
    width_m: float
    """Side across it in that plane, m."""
    height_m: float
    """Highest point above the floor, m."""
    area_m2: float
    """Area across the camera's rays, m²: the sum over the points of what each stands for, so it does not change with
    the distance."""
    trunk_m: Array | None = None
    """(3,) middle of trunk and head of somebody who may be standing, optical frame, m; None of everything else."""

    def refusal(self, config: ClusterConfig) -> str:
        """Why this cannot be one person, or nothing when it can."""
        longest = max(self.length_m, self.height_m)
        if self.area_m2 < config.least_area_m2:
            return f"area {self.area_m2:.2f} m², less than {config.least_area_m2}"
        if self.area_m2 > config.most_area_m2:
            return f"area {self.area_m2:.2f} m², more than {config.most_area_m2}"
        if longest < config.least_length_m:
            return f"longest side {longest:.2f} m, less than {config.least_length_m}"
        if self.length_m > config.most_length_m:
            return f"length {self.length_m:.2f} m, more than {config.most_length_m}"
        if self.height_m > config.most_height_m:
            return f"height {self.height_m:.2f} m, more than {config.most_height_m}"
        return ""


def spread(cloud: Cloud, floor: Floor, config: ClusterConfig) -> tuple[Floats, float]:
    """Points (N, 3) as they are clustered, and the radius, m: place in the picture in metres at the camera's height
    above the floor, and depth times `range_weight`.

    Neighbours in the picture are equally far apart in it wherever they are, so that one radius serves a head near the
    camera and the feet below.
    """
    points = cloud.points_m
    across = np.float32(floor.camera_height_m) / points[:, 2]
    places = np.column_stack((points[:, :2] * across[:, None], points[:, 2] * np.float32(config.range_weight)))
    spacing = cloud.stride * floor.camera_height_m / cloud.focal_px
    return places.astype(np.float32, copy=False), max(config.radius_m, config.radius_spacings * spacing)


def labels_above(cloud: Cloud, floor: Floor, config: ClusterConfig) -> tuple[Floats, Ints, Ints]:
    """Heights (N,) of all points, m, rows (M,) of those above the floor, and their clusters (M,), -1 for stray ones."""
    heights = floor.heights_m(cloud.points_m)
    above = np.flatnonzero(heights > floor.band_m).astype(np.int32)
    places, radius_m = spread(cloud.rows(above), floor, config)
    return heights, above, dbscan(places, radius_m, config.neighbours)


def find_clusters(cloud: Cloud, floor: Floor, config: ClusterConfig) -> list[Cluster]:
    """Clusters above the floor, largest area first; what is too large for one person is split where it can be.

    Clusters that cannot be a person are in the list too: `Cluster.refusal` says why.
    """
    heights, above, labels = labels_above(cloud, floor, config)
    standing, labels = standing_apart(cloud, floor, heights, above, labels)
    rest = clusters_of(cloud, floor, heights, above, labels, config)
    return sorted((*standing, *rest), key=lambda c: -c.area_m2)


def standing_apart(
    cloud: Cloud, floor: Floor, heights: Floats, above: Ints, labels: Ints
) -> tuple[list[Cluster], Ints]:
    """Those who may be standing, and the labels (M,) of all points above the floor without theirs."""
    plan, points = Plan.of(floor.up), cloud.points_m[above]
    found = columns(plan.flat(points), heights[above], areas_m2(cloud, above), labels)
    labels = labels.copy()
    for column in found:
        labels[column.rows] = -1
    return [
        replace(
            measure(cloud, heights, above[column.rows], plan), trunk_m=points[column.core].mean(axis=0).astype(float)
        )
        for column in found
    ], labels


def clusters_of(
    cloud: Cloud, floor: Floor, heights: Floats, above: Ints, labels: Ints, config: ClusterConfig
) -> list[Cluster]:
    """The same of points that have their labels (`labels_above`)."""
    plan = Plan.of(floor.up)
    found: list[Cluster] = []
    for members in _groups(labels, above):
        # What is smaller than this is no person, alone or as a part.
        if areas_m2(cloud, members).sum() >= config.least_area_m2:
            found += _whole_or_parts(cloud, heights, members, plan, config)
    return sorted(found, key=lambda c: -c.area_m2)


def _groups(labels: Ints, rows: Ints) -> Iterator[Ints]:
    """Rows of each label from 0 up."""
    order = np.argsort(labels, kind="stable")
    counts = np.bincount(labels + 1, minlength=1)
    ends = np.cumsum(counts)
    for begin, end in pairwise(ends):
        yield rows[order[begin:end]]


def areas_m2(cloud: Cloud, members: Ints) -> NDArray[np.float64]:
    """What each of some points stands for across the rays, m²."""
    return (cloud.points_m[members, 2].astype(float) * (cloud.stride / cloud.focal_px)) ** 2


def _whole_or_parts(
    cloud: Cloud, heights: Floats, members: Ints, plan: Plan, config: ClusterConfig, depth: int = 0
) -> list[Cluster]:
    whole = measure(cloud, heights, members, plan)
    fits = whole.area_m2 <= config.most_area_m2 and whole.length_m <= config.most_length_m
    if fits or depth == _MOST_SPLITS:
        return [whole]
    spacing = cloud.stride * float(np.median(cloud.points_m[members, 2])) / cloud.focal_px
    pieces = [members[piece] for piece in parts(plan.flat(cloud.points_m[members]), heights[members], spacing, config)]
    if len(pieces) < 2:
        return [whole]
    return [c for piece in pieces for c in _whole_or_parts(cloud, heights, piece, plan, config, depth + 1)]


def measure(cloud: Cloud, heights: Floats, members: Ints, plan: Plan) -> Cluster:
    """Size and place of some points of a cloud.

    Args:
        cloud: the points.
        heights: (N,) heights of all of them above the floor, m.
        members: (M,) rows of the cloud, at least one.
        plan: axes in the floor's plane.
    """
    points = cloud.points_m[members]
    flat = plan.flat(points)
    centred = flat - flat.mean(axis=0)
    _, vectors = np.linalg.eigh(centred.T @ centred)
    along = centred @ vectors[:, ::-1]
    low, high = np.percentile(along, _ENDS, axis=0)
    sides = high - low
    axis = plan.axes.T @ vectors[:, 1]
    return Cluster(
        members,
        points.mean(axis=0).astype(float),
        axis / np.linalg.norm(axis),
        float(sides[0]),
        float(sides[1]),
        float(np.percentile(heights[members], _ENDS[1])),
        float(areas_m2(cloud, members).sum()),
    )
