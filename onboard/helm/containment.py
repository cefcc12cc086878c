"""Where and how fast the vehicle may fly, whoever asks: speed, climb, height band, fence, acceleration."""

from __future__ import annotations

import math

from common.messages import Vec3
from onboard.helm.config import ContainmentConfig

_HEIGHT_GAIN_1_S = 1.0
_ALONG_FRACTION = 0.25


def contain(ned_v_m_s: Vec3, ned_p_m: Vec3, config: ContainmentConfig) -> Vec3:
    """Velocity within the limits, NED, m/s.

    Horizontal speed and climb rate are cut to their maxima (direction kept). Near the fence the outward component may
    not exceed gain · distance to the fence (falling linearly to zero within the band), beyond it is zero; the part
    along the fence fades in the last quarter of the band; the inward part stays. In the same way the vertical part
    fades towards the ends of the height band.

    Args:
        ned_v_m_s: asked velocity.
        ned_p_m: position from home, NED, m.
        config: the limits.
    """
    if not all(math.isfinite(c) for c in (*ned_v_m_s, *ned_p_m)):
        return (0.0, 0.0, 0.0)
    north, east, down = ned_v_m_s
    speed = math.hypot(north, east)
    if speed > config.speed_m_s:
        north, east = north * config.speed_m_s / speed, east * config.speed_m_s / speed
    north, east = _fence(north, east, ned_p_m[0], ned_p_m[1], config)
    height_m = -ned_p_m[2]
    up = min(max(-down, -config.climb_m_s), config.climb_m_s)
    up = min(up, max((config.height_max_m - height_m) * _HEIGHT_GAIN_1_S, 0.0))
    up = max(up, min((config.height_min_m - height_m) * _HEIGHT_GAIN_1_S, 0.0))
    return (north, east, -up)


def _fence(north: float, east: float, p_north: float, p_east: float, config: ContainmentConfig) -> tuple[float, float]:
    radius = math.hypot(p_north, p_east)
    if radius <= config.radius_m - config.fence_band_m or radius == 0.0:
        return north, east
    n, e = p_north / radius, p_east / radius
    outward = north * n + east * e
    room_m = max(config.radius_m - radius, 0.0)
    radial = min(outward, room_m / config.fence_band_m * config.speed_m_s)
    # Along a curved fence a vehicle that lags behind its setpoint drifts outwards: slow down in the innermost part.
    along = min(room_m / (_ALONG_FRACTION * config.fence_band_m), 1.0)
    return radial * n + (north - outward * n) * along, radial * e + (east - outward * e) * along


def slew(ned_v_m_s: Vec3, last_ned_v_m_s: Vec3, rate_m_s2: float, dt_s: float) -> Vec3:
    """Velocity that differs from the last by at most rate · dt, on the way to the asked one, NED, m/s."""
    delta = tuple(a - b for a, b in zip(ned_v_m_s, last_ned_v_m_s, strict=True))
    size = math.sqrt(sum(c * c for c in delta))
    allowed = rate_m_s2 * max(dt_s, 0.0)
    if size <= allowed:
        return ned_v_m_s
    x, y, z = (b + c * allowed / size for b, c in zip(last_ned_v_m_s, delta, strict=True))
    return (x, y, z)
