"""The filter for any number of obstacles: the nearest velocity that approaches none of them too fast."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from common.messages import Obstacle, Vec3
from onboard.limiter.config import LimiterConfig
from onboard.limiter.law import Zone, allowed_approach, stoppable, zone

_SWEEPS = 60
_TOLERANCE_M_S = 1e-6
_ZERO: Vec3 = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Limited:
    """What the limiter made of a velocity."""

    asked_ned_v_m_s: Vec3
    """The velocity asked, NED, m/s."""
    ned_v_m_s: Vec3
    """The velocity that may be flown, NED, m/s."""
    zone: Zone
    """Zone of the nearest obstacle; `blind` without obstacle data."""
    distance_m: float
    """Distance of the nearest obstacle, m; -1 when there is none."""
    changed: bool
    """Whether anything was taken away."""


def _dot(a: Vec3, b: Vec3) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _finite(vector: Sequence[float]) -> bool:
    return all(math.isfinite(c) for c in vector)


def limit(
    ned_v_m_s: Vec3,
    obstacles: Sequence[Obstacle] | None,
    config: LimiterConfig,
    *,
    ned_vehicle_v_m_s: Vec3 = _ZERO,
    age_s: float = 0.0,
    required: bool = False,
) -> Limited:
    """The velocity nearest to the asked one that keeps to the law for every obstacle.

    Each obstacle k sets a half-space v·n_k <= L_k with L_k >= 0 (`law.allowed_approach`). Their intersection is convex
    and holds the origin, so the projection onto it (Dykstra 1983, DOI 10.1080/01621459.1983.10477029) never makes the
    velocity longer, leaves what approaches nothing as it is, and keeps tangential components. The result is checked;
    what is left over the bound after the last sweep is scaled away.

    Args:
        ned_v_m_s: asked velocity, NED, m/s.
        obstacles: what is near; None without data.
        config: the law.
        ned_vehicle_v_m_s: present velocity of the vehicle, NED, m/s; with `age_s` it brings old distances up to date.
        age_s: how old the distances are, s.
        required: whether missing data means standing still.

    Returns:
        The limited velocity; zero when a number is not finite.
    """
    if not (_finite(ned_v_m_s) and _finite(ned_vehicle_v_m_s) and math.isfinite(age_s)):
        return Limited(_ZERO, _ZERO, "blind", -1.0, True)
    if obstacles is None:
        blocked = required and ned_v_m_s != _ZERO
        return Limited(ned_v_m_s, _ZERO if required else ned_v_m_s, "blind", -1.0, blocked)
    normals: list[Vec3] = []
    bounds: list[float] = []
    nearest_m = math.inf
    for obstacle in obstacles:
        distance_m, normal, closing_m_s = _now(obstacle, ned_vehicle_v_m_s, age_s)
        if not math.isfinite(distance_m + closing_m_s) or not _finite(normal):
            return Limited(ned_v_m_s, _ZERO, "collision", -1.0, True)
        nearest_m = min(nearest_m, distance_m)
        normals.append(normal)
        bounds.append(_bound(distance_m, _dot(ned_v_m_s, normal), closing_m_s, config))
    name = zone(nearest_m, config)
    distance_m = nearest_m if normals else -1.0
    if all(_dot(ned_v_m_s, n) <= b + _TOLERANCE_M_S for n, b in zip(normals, bounds, strict=True)):
        return Limited(ned_v_m_s, ned_v_m_s, name, distance_m, False)
    return Limited(ned_v_m_s, project(ned_v_m_s, normals, bounds), name, distance_m, True)


def _now(obstacle: Obstacle, ned_vehicle_v_m_s: Vec3, age_s: float) -> tuple[float, Vec3, float]:
    """Distance by now (m, never more than measured), unit direction, and the obstacle's own closing speed (m/s)."""
    norm = math.sqrt(_dot(obstacle.ned_direction, obstacle.ned_direction))
    if not norm > 0.0:
        return math.nan, obstacle.ned_direction, 0.0
    x, y, z = obstacle.ned_direction
    normal = (x / norm, y / norm, z / norm)
    closing_m_s = max(-_dot(obstacle.ned_v_m_s, normal), 0.0)
    nearer_m = max(_dot(ned_vehicle_v_m_s, normal), 0.0) + closing_m_s
    return max(obstacle.distance_m - nearer_m * max(age_s, 0.0), 0.0), normal, closing_m_s


def _bound(distance_m: float, approach_m_s: float, closing_m_s: float, config: LimiterConfig) -> float:
    """Half-space bound of one obstacle, m/s, continuous in distance and velocity.

    What is not approached now must not become approached by what is taken away for another obstacle: its bound is
    zero; beyond h_max it opens up to the stoppable speed within the blending band.
    """
    bound = allowed_approach(distance_m, approach_m_s, closing_m_s, config)
    if distance_m <= config.h_max_m:
        return bound
    opening = min((distance_m - config.h_max_m) / config.band_m, 1.0)
    return max(bound, opening * max(stoppable(distance_m, config) - closing_m_s, 0.0))


def project(ned_v_m_s: Vec3, normals: Sequence[Vec3], bounds: Sequence[float]) -> Vec3:
    """Nearest velocity with v·n_k <= bound_k for all k, by Dykstra's alternating projections.

    Args:
        ned_v_m_s: velocity, m/s.
        normals: unit vectors.
        bounds: m/s, not negative.
    """
    v = ned_v_m_s
    # The correction that each half-space remembers is along its own normal: one number is enough.
    kept = [0.0] * len(normals)
    for _ in range(_SWEEPS):
        moved = 0.0
        for k, (n, bound) in enumerate(zip(normals, bounds, strict=True)):
            before = kept[k]
            excess = max(_dot(v, n) + before - bound, 0.0)
            change = before - excess
            if change:
                v = (v[0] + change * n[0], v[1] + change * n[1], v[2] + change * n[2])
                kept[k] = excess
                moved = max(moved, abs(change))
        if moved < _TOLERANCE_M_S * 0.1:
            break
    return _checked(v, ned_v_m_s, normals, bounds)


def _checked(v: Vec3, asked: Vec3, normals: Sequence[Vec3], bounds: Sequence[float]) -> Vec3:
    """The result scaled into every bound and to no more than the asked speed; zero when that fails."""
    scale = 1.0
    for n, bound in zip(normals, bounds, strict=True):
        approach = _dot(v, n)
        if approach > bound + _TOLERANCE_M_S:
            scale = min(scale, max(bound, 0.0) / approach)
    speed, allowed = math.sqrt(_dot(v, v)), math.sqrt(_dot(asked, asked))
    if speed > allowed > 0.0:
        scale = min(scale, allowed / speed)
    result = (v[0] * scale, v[1] * scale, v[2] * scale)
    if not _finite(result) or any(
        _dot(result, n) > b + 2 * _TOLERANCE_M_S for n, b in zip(normals, bounds, strict=True)
    ):
        return _ZERO
    return result
