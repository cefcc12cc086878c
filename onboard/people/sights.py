"""From one depth picture to the regions that may be people, with their places in metres (Al-Kaff 2019, section 4.1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.geometry.camera import Camera
from common.geometry.rotation import Array, quat_rotate
from onboard.people.bodies import Body, Claimed, VehiclePose, claims, hang_on, standing_where_expected
from onboard.people.clusters import Cluster, areas_m2, clusters_of, labels_above, measure, standing_apart
from onboard.people.depth import Cloud, Floats, Ints, RayTable, UnusableDepth, metres
from onboard.people.floor import TOWARDS_CAMERA, Floor, find_floor, up_in_camera
from onboard.people.pipeline_config import PeopleConfig
from onboard.people.pose import Pose
from onboard.people.regions import Region, Registration, find_regions
from onboard.people.split import Plan

_NEAREST_PERCENT = 2.0
"""The nearest point of a body is the one at this percentile of the distances: nearer ones are flying pixels."""
_BODY_SIGMA_M = 0.1
"""How far the middle of what is seen may lie from the middle of the body, m."""
_CUT_SIGMA_M = 0.35
"""The same where a picture ends within the body."""


@dataclass(frozen=True)
class Sight:
    """A region of one picture."""

    region: Region
    """Where it is in the colour picture."""
    ned_p_m: Array | None = None
    """(3,) middle of what is seen, from home, NED, m; None without depth or vehicle pose."""
    ned_p_cov_m2: Array | None = None
    """(3, 3) its covariance."""
    ned_nearest_m: Array | None = None
    """(3,) its point nearest to the vehicle's centre, from home, NED, m."""
    points_m: Array | None = None
    """(M, 3) points of it, about as far apart as the cloud's, in the colour camera's optical frame, m."""
    area_m2: float = 0.0
    """What they stand for across the rays, m²."""
    camera_height_m: float = 0.0
    """Height of the camera above the floor, m."""
    body: Body | None = None
    """Somebody known who was expected here and is, and how they lie here."""
    pose: Pose | None = None
    """That in the picture."""
    ned_trunk_m: Array | None = None
    """(3,) middle of trunk and head of somebody who may be standing, from home, NED, m; None of everything else."""


class DepthSearch:
    """Finds regions in depth pictures.

    Args:
        config: floor, clusters, what positions may be wrong by.
        colour: calibration of the colour camera.
        depth: calibration of the depth camera.
    """

    def __init__(self, config: PeopleConfig, colour: Camera, depth: Camera):
        self._config = config
        self._table = RayTable.of(depth)
        self.registration = Registration.of(depth, colour)
        """Depth camera to colour camera."""
        self.floor_m: float | None = None
        """Distance of the camera from the floor that was found last, m."""
        self._rng = np.random.default_rng(config.seed)

    def find(self, depth: NDArray, vehicle: VehiclePose | None, bodies: Sequence[Body] = ()) -> list[Sight]:
        """Regions that may be people: those of people known who are where they were, and the rest, the largest first.

        Args:
            depth: (H, W); uint16 in mm, or float in m.
            vehicle: for the direction up and for places in NED; None where it is not known.
            bodies: people known, who take their points first.

        Raises:
            UnusableDepth: the picture cannot be used, or shows no floor; the text says why.
        """
        config, camera = self._config, self._table.camera
        depth_m = metres(depth, camera)
        bounds = config.floor.nearest_m, config.floor.farthest_m
        stride = self._table.stride_for(depth_m, config.floor.spacing_m, *bounds)
        cloud = self._table.cloud(depth_m, stride, *bounds)
        up = TOWARDS_CAMERA if vehicle is None else up_in_camera(vehicle.ned_q_body, camera.body_q_camera)
        floor = find_floor(cloud.points_m, config.floor, self._rng, up)
        if floor is None:
            raise UnusableDepth(
                f"depth picture: no plane within {config.floor.tilt_deg:g} degrees of level holds "
                f"{config.floor.least_share:.0%} of its points; expected a floor below the camera"
            )
        self.floor_m = floor.camera_height_m
        heights, above, labels = labels_above(cloud, floor, config.clusters)
        standing, labels = standing_apart(cloud, floor, heights, above, labels)
        lying = [body for body in bodies if body.ned_trunk_m is None]
        taken, labels = self._taken(lying, cloud, floor, (heights, above, labels), vehicle)
        plan = Plan.of(floor.up)
        found: list[tuple[Cluster, Body | None]] = [
            *((measure(cloud, heights, claimed.rows, plan), claimed.body) for claimed in taken),
            *self._recognised(bodies, standing, vehicle),
            *((c, None) for c in clusters_of(cloud, floor, heights, above, labels, config.clusters)),
        ]
        order = {body.number: k for k, body in enumerate(bodies)}
        # Who is known in the order of the bodies, then what is largest.
        found.sort(key=lambda p: (1, -p[0].area_m2) if p[1] is None else (0, order[p[1].number]))
        clusters = [pair for pair in found if not pair[0].refusal(config.clusters)]
        regions = find_regions([c for c, _ in clusters], cloud, depth_m, floor, self._table, self.registration)
        return [
            self._placed(region, cluster, cloud, floor, vehicle, body)
            for region, (cluster, body) in zip(regions, clusters, strict=True)
            if region is not None
        ]

    def _recognised(
        self, bodies: Sequence[Body], standing: Sequence[Cluster], vehicle: VehiclePose | None
    ) -> list[tuple[Cluster, Body | None]]:
        """Those who stand, and who of the people known each is."""
        who: dict[int, Body] = {}
        if vehicle is not None:
            trunks = [self._ned(cluster.trunk_m, vehicle) for cluster in standing if cluster.trunk_m is not None]
            sizes = [(cluster.area_m2, cluster.height_m) for cluster in standing]
            who = {column: body for body, column in standing_where_expected(bodies, trunks, sizes)}
        return [(cluster, who.get(k)) for k, cluster in enumerate(standing)]

    def _ned(self, camera_p_m: Array, vehicle: VehiclePose) -> Array:
        """A place (3,) of the depth camera's optical frame, from home, NED, m."""
        return vehicle.from_camera(self._table.camera, camera_p_m)

    def _taken(
        self,
        bodies: Sequence[Body],
        cloud: Cloud,
        floor: Floor,
        labelled: tuple[Floats, Ints, Ints],
        vehicle: VehiclePose | None,
    ) -> tuple[list[Claimed], Ints]:
        """Rows of the cloud that people known take, and the labels (M,) of the points above the floor without them."""
        heights, above, labels = labelled
        if vehicle is None or not bodies:
            return [], labels
        heights = heights[above]
        points, areas = cloud.points_m[above], areas_m2(cloud, above)
        height, camera = floor.camera_height_m, self._table.camera
        found = claims(bodies, points, heights, areas, height, camera, vehicle)
        touched = [set(labels[claimed.rows].tolist()) - {-1} for claimed in found]
        labels = labels.copy()
        for claimed in found:
            labels[claimed.rows] = -1
        taken = []
        for claimed, names in zip(found, touched, strict=True):
            rows = [claimed.rows]
            for name in names:
                left = np.flatnonzero(labels == name).astype(np.int32)
                if len(left) and hang_on(points[left], claimed.body, height, camera, vehicle):
                    rows.append(left)
                    labels[left] = -1
            taken.append(Claimed(claimed.body, above[np.concatenate(rows)]))
        return taken, labels

    def _placed(
        self,
        region: Region,
        cluster: Cluster,
        cloud: Cloud,
        floor: Floor,
        vehicle: VehiclePose | None,
        body: Body | None,
    ) -> Sight:
        if vehicle is None or region.camera_p_m is None:
            return Sight(region)
        colour, members = self.registration.colour, cloud.points_m[cluster.members]
        offset = quat_rotate(vehicle.ned_q_body, in_body(colour, region.camera_p_m))
        trunk = None if cluster.trunk_m is None else self._ned(cluster.trunk_m, vehicle)
        if trunk is not None:  # arms and what the feet stand beside do not move it
            offset = np.array([*(trunk - vehicle.ned_p_m)[:2], offset[2]])
        points = quat_rotate(vehicle.ned_q_body, in_body(self._table.camera, members))
        distances = np.linalg.norm(points, axis=1)
        nearest = points[np.argsort(distances)[int(_NEAREST_PERCENT / 100.0 * len(distances))]]
        return Sight(
            region,
            vehicle.ned_p_m + offset,
            self._covariance(offset, _CUT_SIGMA_M if region.at_edge else _BODY_SIGMA_M),
            vehicle.ned_p_m + nearest,
            self.registration.points(members),
            cluster.area_m2,
            floor.camera_height_m,
            body,
            None if body is None else body.pose_in(colour, vehicle),
            trunk,
        )

    def _covariance(self, ned_offset_m: Array, body_sigma_m: float) -> Array:
        """(3, 3) of a place at an offset from the vehicle: a wrong attitude swings it about the vehicle."""
        distance = float(np.linalg.norm(ned_offset_m))
        along = ned_offset_m / max(distance, 1e-9)
        swing = (self._config.attitude_sigma_rad * distance) ** 2
        spread = self._config.position_sigma_m**2 + body_sigma_m**2 + swing
        return spread * np.eye(3) - swing * np.outer(along, along)


def in_body(camera: Camera, camera_p_m: ArrayLike) -> Array:
    """Points (3,) or (N, 3) of a camera's optical frame in the body frame (FRD), m."""
    return quat_rotate(camera.body_q_camera, camera_p_m) + np.asarray(camera.body_p_camera_m)
