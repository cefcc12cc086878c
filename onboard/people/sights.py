"""From one depth picture to the regions that may be people, with their places in metres (Al-Kaff 2019, section 4.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.geometry.camera import Camera
from common.geometry.rotation import Array, quat_rotate
from onboard.people.clusters import Cluster, find_clusters
from onboard.people.depth import Cloud, RayTable, UnusableDepth, metres
from onboard.people.floor import TOWARDS_CAMERA, find_floor, up_in_camera
from onboard.people.pipeline_config import PeopleConfig
from onboard.people.regions import Region, Registration, find_regions

_NEAREST_PERCENT = 2.0
"""The nearest point of a body is the one at this percentile of the distances: nearer ones are flying pixels."""
_BODY_SIGMA_M = 0.1
"""How far the middle of what is seen may lie from the middle of the body, m."""


@dataclass(frozen=True)
class VehiclePose:
    """Where the vehicle was when the picture was taken."""

    ned_p_m: Array
    """(3,) position from home, NED, m."""
    ned_q_body: Array
    """(4,) attitude."""


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
        self._registration = Registration.of(depth, colour)
        self._rng = np.random.default_rng(config.seed)

    def find(self, depth: NDArray, vehicle: VehiclePose | None) -> list[Sight]:
        """Regions that may be people, the largest first.

        Args:
            depth: (H, W); uint16 in mm, or float in m.
            vehicle: for the direction up and for places in NED; None where it is not known.

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
        clusters = [c for c in find_clusters(cloud, floor, config.clusters) if not c.refusal(config.clusters)]
        regions = find_regions(clusters, cloud, depth_m, floor, self._table, self._registration)
        return [
            self._placed(region, cluster, cloud, vehicle)
            for region, cluster in zip(regions, clusters, strict=True)
            if region is not None
        ]

    def _placed(self, region: Region, cluster: Cluster, cloud: Cloud, vehicle: VehiclePose | None) -> Sight:
        if vehicle is None or region.camera_p_m is None:
            return Sight(region)
        offset = quat_rotate(vehicle.ned_q_body, in_body(self._registration.colour, region.camera_p_m))
        points = quat_rotate(vehicle.ned_q_body, in_body(self._table.camera, cloud.points_m[cluster.members]))
        distances = np.linalg.norm(points, axis=1)
        nearest = points[np.argsort(distances)[int(_NEAREST_PERCENT / 100.0 * len(distances))]]
        return Sight(region, vehicle.ned_p_m + offset, self._covariance(offset), vehicle.ned_p_m + nearest)

    def _covariance(self, ned_offset_m: Array) -> Array:
        """(3, 3) of a place at an offset from the vehicle: a wrong attitude swings it about the vehicle."""
        distance = float(np.linalg.norm(ned_offset_m))
        along = ned_offset_m / max(distance, 1e-9)
        swing = (self._config.attitude_sigma_rad * distance) ** 2
        return (self._config.position_sigma_m**2 + _BODY_SIGMA_M**2 + swing) * np.eye(3) - swing * np.outer(
            along, along
        )


def in_body(camera: Camera, camera_p_m: ArrayLike) -> Array:
    """Points (3,) or (N, 3) of a camera's optical frame in the body frame (FRD), m."""
    return quat_rotate(camera.body_q_camera, camera_p_m) + np.asarray(camera.body_p_camera_m)
