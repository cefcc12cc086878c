"""The floor below the vehicle: RANSAC for the plane, least squares over its points (Al-Kaff 2019, section 4.1)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from common.geometry.rotation import Array, quat_conjugate, quat_multiply, quat_rotate
from onboard.people.compiled import best_plane, heights_above, plane_moments
from onboard.people.config import FloorConfig
from onboard.people.depth import Floats

TOWARDS_CAMERA = (0.0, 0.0, -1.0)
"""Up, when nothing is known of the attitude: against the optical axis."""
_REFINEMENTS = 4
_SIGMAS = 3.0


@dataclass(frozen=True)
class Floor:
    """A plane in the optical frame; a point's height above it is `up · p + camera_height_m`."""

    up: Array
    """(3,) unit normal, on the camera's side."""
    camera_height_m: float
    """Distance of the camera from the plane, m."""
    sigma_m: float
    """Standard deviation of the floor's own points about it, m."""
    band_m: float
    """Points within this of the plane are floor, m."""
    share: float
    """Share of the points that are floor."""

    def heights_m(self, points_m: Floats) -> Floats:
        """Heights (N,) of points (N, 3) above the floor, m."""
        return heights_above(points_m, self.up, self.camera_height_m)


def up_in_camera(ned_q_body: ArrayLike, body_q_camera: ArrayLike) -> Array:
    """Direction up (3,) in the optical frame, from the vehicle's attitude and the camera's mounting."""
    return quat_rotate(quat_conjugate(quat_multiply(ned_q_body, body_q_camera)), (0.0, 0.0, -1.0))


def find_floor(
    points_m: Floats, config: FloorConfig, rng: np.random.Generator, up: ArrayLike = TOWARDS_CAMERA
) -> Floor | None:
    """The plane that most points lie on, within `tilt_deg` of level; None when no plane holds `least_share` of them.

    RANSAC proposes; a least-squares plane through all points in the band, which narrows to three of their standard
    deviations, is the answer. Both are the paper's, but for the narrowing: an object's lowest 10 cm no longer pull.

    Args:
        points_m: (N, 3) in the optical frame.
        config: bounds.
        rng: draws the triples and the voters.
        up: (3,) direction up in the optical frame (`up_in_camera`), where the attitude is known.
    """
    if len(points_m) < 3:
        return None
    up = np.asarray(up, dtype=float) / np.linalg.norm(up)
    least_cosine = math.cos(math.radians(config.tilt_deg))
    voters = points_m[rng.integers(len(points_m), size=min(config.votes, len(points_m)))]
    triples = rng.integers(len(voters), size=(config.hypotheses, 3))
    votes, plane = best_plane(voters, triples, up, least_cosine, config.band_m)
    if votes == 0:
        return None
    normal, offset = plane[:3], float(plane[3])
    band = config.band_m
    sigma, count = band, 0
    for _ in range(_REFINEMENTS):
        count, centre, covariance = _moments(points_m, normal, offset, band)
        if count < 3:
            return None
        values, vectors = np.linalg.eigh(covariance)
        normal = vectors[:, 0] * (1.0 if vectors[:, 0] @ up > 0 else -1.0)
        offset = -float(normal @ centre)
        sigma = math.sqrt(max(float(values[0]), 0.0))
        band = min(config.band_m, max(config.least_band_m, _SIGMAS * sigma))
    share = count / len(points_m)
    if share < config.least_share or normal @ up < least_cosine or offset <= 0:
        return None
    return Floor(normal, offset, sigma, band, share)


def _moments(points: Floats, normal: Array, offset: float, band: float) -> tuple[int, Array, Array]:
    """Count, mean (3,) and covariance (3, 3) of the points in the band."""
    count, first, second = plane_moments(points, normal, offset, band)
    if count == 0:
        return 0, first, second
    mean = first / count
    return int(count), mean, second / count - np.outer(mean, mean)
