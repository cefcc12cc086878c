"""Where clusters lie in the colour picture: registration of depth and colour, boxes, masks, places in metres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.geometry.camera import Camera
from common.geometry.rotation import Array, quat_conjugate, quat_rotate, quat_to_matrix
from onboard.people.clusters import Cluster
from onboard.people.columns import CORE_M
from onboard.people.depth import Cloud, Floats, RayTable
from onboard.people.floor import Floor

Mask = NDArray[np.bool_]
Box = tuple[int, int, int, int]

CROWN_M, SHOULDERS_M = 0.16, 0.50
"""How far below the top of a person the head and the shoulders end, m."""
_TOP_PERCENT = 99.0
_BORDER_PX = 2.5
_LEAST_SEEN = 0.4
"""What lies outside the colour picture but for less than this share is left out: a foot is no person."""


@dataclass(frozen=True)
class Crown:
    """The top of what stands in a region: of a person who is upright, the head, and the shoulders below it."""

    middle_px: Array
    """(2,) its middle in the colour picture."""
    depth_m: float
    """Its depth in the colour camera's frame, m."""
    area_m2: float
    """Area across the rays within `CROWN_M` of the top, m²."""
    below_m2: float
    """Area from there down to `SHOULDERS_M` below the top, m²."""


@dataclass(frozen=True)
class Region:
    """One cluster in the colour picture."""

    box_px: Box
    """x, y, width, height; inside the picture."""
    mask: Mask
    """(height, width) of the box: which of its pixels show the cluster."""
    camera_p_m: tuple[float, float, float] | None
    """Middle of what is seen, in the colour camera's optical frame, m; None without depth."""
    length_m: float | None
    """Longest side in the floor's plane, m; None without depth."""
    width_m: float | None
    """Side across it, m; None without depth."""
    height_m: float | None
    """Highest point above the floor, m; None without depth."""
    crown: Crown | None = None
    """What its top looks like; None without depth."""
    cut: bool = False
    """Whether the depth picture ends within it although the colour picture goes on: there is more than it shows."""
    at_edge: bool = False
    """Whether one of the pictures ends within it: there may be more than can be seen."""

    @property
    def middle_px(self) -> Array:
        """(2,) centre of gravity of the mask in the picture, px."""
        rows, columns = np.nonzero(self.mask)
        return np.array([columns.mean(), rows.mean()]) + self.box_px[:2]

    def axis(self) -> tuple[Array, Array]:
        """Ends (2,), (2,) of the principal axis of the mask, px in the picture: where head and feet may be."""
        rows, columns = np.nonzero(self.mask)
        places = np.column_stack((columns, rows)).astype(float)
        middle = places.mean(axis=0)
        centred = places - middle
        _, vectors = np.linalg.eigh(centred.T @ centred)
        along = centred @ vectors[:, 1]
        origin = middle + np.array(self.box_px[:2], float)
        return origin + along.min() * vectors[:, 1], origin + along.max() * vectors[:, 1]


@dataclass(frozen=True)
class Registration:
    """From the depth camera to the colour camera; both may be the same."""

    depth: Camera
    """Whose pictures hold depths."""
    colour: Camera
    """Whose pictures hold colours, exposed at the same time."""
    colour_R_depth: Array
    """(3, 3) turns a vector of the depth camera's optical frame into the colour camera's."""
    colour_p_depth_m: Array
    """(3,) the depth camera's centre in the colour camera's frame, m."""

    @classmethod
    def of(cls, depth: Camera, colour: Camera) -> Registration:
        """Registration of two cameras by their mountings."""
        colour_q_body = quat_conjugate(colour.body_q_camera)
        turn = quat_to_matrix(colour_q_body) @ quat_to_matrix(depth.body_q_camera)
        offset = np.subtract(depth.body_p_camera_m, colour.body_p_camera_m)
        return cls(depth, colour, turn, quat_rotate(colour_q_body, offset))

    @property
    def aligned(self) -> bool:
        """Whether both pictures show the same through the same pixels."""
        same = self.depth.matrix.tolist() == self.colour.matrix.tolist()
        return same and (self.depth.width, self.depth.height) == (self.colour.width, self.colour.height) and self._still

    @property
    def _still(self) -> bool:
        return bool(np.allclose(self.colour_R_depth, np.eye(3)) and np.allclose(self.colour_p_depth_m, 0.0))

    def points(self, depth_points_m: ArrayLike) -> Array:
        """Points (N, 3) of the depth camera's frame in the colour camera's, m."""
        return np.asarray(depth_points_m, dtype=float) @ self.colour_R_depth.T + self.colour_p_depth_m


def find_regions(
    clusters: Sequence[Cluster],
    cloud: Cloud,
    depth_m: Floats,
    floor: Floor,
    table: RayTable,
    registration: Registration,
) -> list[Region | None]:
    """Region of each cluster in the colour picture; None for one that lies mostly outside it.

    Args:
        clusters: of the cloud.
        cloud: the subsampled points.
        depth_m: (H, W) the whole depth picture: masks are taken from all of its pixels.
        floor: what counts as floor.
        table: rays of the depth camera.
        registration: depth camera to colour camera.
    """
    return [_region(c, cloud, depth_m, floor, table, registration) for c in clusters]


def _region(
    cluster: Cluster, cloud: Cloud, depth_m: Floats, floor: Floor, table: RayTable, registration: Registration
) -> Region | None:
    dense = _dense(cluster, cloud, depth_m, floor, table)
    points = registration.points(dense)
    colour = registration.colour
    pixels = np.round(colour.project(points))
    inside = (pixels >= 0).all(axis=1) & (pixels < (colour.width, colour.height)).all(axis=1)
    if inside.mean() < _LEAST_SEEN:
        return None
    places = pixels[inside].astype(int)
    # A depth pixel covers so many colour pixels; the mask has no holes between them.
    grain = 1 if registration.aligned else int(np.ceil(colour.fx_px / registration.depth.fx_px)) + 1
    low = np.maximum(places.min(axis=0) - grain // 2, 0)
    high = np.minimum(places.max(axis=0) + grain // 2 + 1, (colour.width, colour.height))
    drawn = np.zeros((high[1] - low[1], high[0] - low[0]), np.uint8)
    drawn[places[:, 1] - low[1], places[:, 0] - low[0]] = 1
    if grain > 1:
        drawn = np.asarray(cv2.dilate(drawn, np.ones((grain, grain), np.uint8)))
    drawn = np.asarray(cv2.morphologyEx(drawn, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)))
    x, y, z = points.mean(axis=0)
    whole = bool((low > 0).all() and (high < (colour.width, colour.height)).all())
    bordered = _at_border(dense, table)
    return Region(
        (int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1])),
        drawn > 0,
        (float(x), float(y), float(z)),
        cluster.length_m,
        cluster.width_m,
        cluster.height_m,
        _crown(dense, points, floor, table, colour, cluster.trunk_m),
        whole and bordered,
        bordered or not whole,
    )


def _at_border(dense: Floats, table: RayTable) -> bool:
    """Whether points (N, 3) reach the border of the depth picture."""
    places = dense[:, :2] / dense[:, 2:]
    ends = table.rays[0, 0], table.rays[-1, -1]
    margin = _BORDER_PX / table.focal_px
    return bool((places < np.minimum(*ends) + margin).any() or (places > np.maximum(*ends) - margin).any())


def _crown(dense: Floats, points: Array, floor: Floor, table: RayTable, colour: Camera, trunk_m: Array | None) -> Crown:
    """Top of some points (N, 3), given in the frames of the depth camera and of the colour camera; of somebody who
    stands, whose trunk's middle (3,) is known, above the trunk alone: a hand that waves is higher than the head."""
    if trunk_m is not None:
        offsets = dense - trunk_m
        flat = offsets - np.outer(offsets @ floor.up, floor.up)
        near = np.linalg.norm(flat, axis=1) < CORE_M
        if near.any():
            dense, points = dense[near], points[near]
    heights = floor.heights_m(dense)
    below_top = float(np.percentile(heights, _TOP_PERCENT)) - heights
    areas = (dense[:, 2].astype(float) / table.focal_px) ** 2
    crown, shoulders = below_top < CROWN_M, (below_top >= CROWN_M) & (below_top < SHOULDERS_M)
    middle = points[crown].mean(axis=0)
    area_m2, below_m2 = float(areas[crown].sum()), float(areas[shoulders].sum())
    return Crown(colour.project(middle)[0], float(middle[2]), area_m2, below_m2)


def _dense(cluster: Cluster, cloud: Cloud, depth_m: Floats, floor: Floor, table: RayTable) -> Floats:
    """Points (M, 3) of all depth pixels of a cluster, whose members are every stride-th of them."""
    if cloud.stride == 1:
        return cloud.points_m[cluster.members]
    stride, start = cloud.stride, cloud.stride // 2
    cells = (cloud.pixels[cluster.members] - start) // stride
    low, high = cells.min(axis=0) - 1, cells.max(axis=0) + 2
    lattice = np.zeros((high[1] - low[1], high[0] - low[0]), np.uint8)
    lattice[cells[:, 1] - low[1], cells[:, 0] - low[0]] = 1
    # The outline runs between the last sample that is a member and the next one.
    lattice = np.asarray(cv2.dilate(lattice, np.ones((3, 3), np.uint8)))
    near = np.repeat(np.repeat(lattice, stride, axis=0), stride, axis=1) > 0
    height, width = depth_m.shape
    rows = low[1] * stride + np.arange(near.shape[0])
    columns = low[0] * stride + np.arange(near.shape[1])
    keep_rows, keep_columns = (rows >= 0) & (rows < height), (columns >= 0) & (columns < width)
    near = near[np.ix_(keep_rows, keep_columns)]
    rows, columns = rows[keep_rows], columns[keep_columns]
    window = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    z = depth_m[window]
    depths = cloud.points_m[cluster.members, 2]
    slack = stride * float(depths.max()) / cloud.focal_px
    near &= (z > depths.min() - slack) & (z < depths.max() + slack)
    z = z[near]
    points = np.empty((len(z), 3), np.float32)
    points[:, :2] = table.rays[window][near] * z[:, None]
    points[:, 2] = z
    above = points[floor.heights_m(points) > floor.band_m]
    return above if len(above) else cloud.points_m[cluster.members]
