"""The vehicle's true motion between messages: smoothed positions, interpolated and briefly extrapolated poses."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.geometry.rotation import quat_exp, quat_multiply, slerp

Array = NDArray[np.float64]

EARTH_RADIUS_M = 6_371_000.0
"""Radius of the sphere that PX4's map projection uses, m."""
# A gap or a jump that no flight explains: the filter starts anew from the measurement.
_RESET_GAP_S = 0.5
_RESET_JUMP_M = 1.0


@dataclass(frozen=True)
class Motion:
    """Position, velocity, attitude and body rates at one instant."""

    t_ns: int
    """Instant, ns of this machine's monotonic clock."""
    ned_p_m: Array
    """Position from home, (3,), NED, m."""
    ned_v_m_s: Array
    """Velocity, (3,), NED, m/s."""
    ned_q_body: Array
    """Attitude, (4,)."""
    body_rates_rad_s: Array
    """Angular velocity, (3,), FRD, rad/s."""


def ned_from_geodetic(lat_deg: float, lon_deg: float, alt_m: float, home: tuple[float, float, float]) -> Array:
    """Position (3,), NED from home, m; home is latitude and longitude, degrees, and altitude, m.

    The azimuthal equidistant projection of a sphere, which PX4 uses, to the first order: within 1 mm at 100 m.
    """
    north = math.radians(lat_deg - home[0]) * EARTH_RADIUS_M
    east = math.radians(lon_deg - home[1]) * EARTH_RADIUS_M * math.cos(math.radians(home[0] + (lat_deg - home[0]) / 2))
    return np.array([north, east, home[2] - alt_m])


def smoothed(previous: Motion | None, measured: Motion, time_constant_s: float) -> Motion:
    """Measurement with its position drawn towards the integral of the velocity: a complementary filter.

    Args:
        previous: result of the message before, None at the start.
        measured: what the message says; its position comes in coarse steps, its velocity in fine ones.
        time_constant_s: how slowly the measured position is followed, s; 0 takes it as it is.
    """
    if previous is None or time_constant_s <= 0:
        return measured
    dt = (measured.t_ns - previous.t_ns) / 1e9
    if not 0 <= dt <= _RESET_GAP_S:
        return measured
    predicted = previous.ned_p_m + 0.5 * dt * (previous.ned_v_m_s + measured.ned_v_m_s)
    innovation = measured.ned_p_m - predicted
    if float(np.abs(innovation).max()) > _RESET_JUMP_M:
        return measured
    position = predicted + (1.0 - math.exp(-dt / time_constant_s)) * innovation
    return Motion(measured.t_ns, position, measured.ned_v_m_s, measured.ned_q_body, measured.body_rates_rad_s)


def motion_at(history: Sequence[Motion], t_ns: int, longest_extrapolation_ns: int) -> Motion | None:
    """Motion at an instant, or None when the history does not reach there.

    Between two messages: cubic Hermite in position, linear in velocity and rates, slerp in attitude. After the newest:
    constant velocity and constant body rates, up to the limit.

    Args:
        history: motions in order of time.
        t_ns: instant, ns.
        longest_extrapolation_ns: how far beyond the newest one it may lie, ns.
    """
    if not history or t_ns < history[0].t_ns:
        return None
    newest = history[-1]
    if t_ns >= newest.t_ns:
        if t_ns - newest.t_ns > longest_extrapolation_ns:
            return None
        dt = (t_ns - newest.t_ns) / 1e9
        attitude = quat_multiply(newest.ned_q_body, quat_exp(newest.body_rates_rad_s * dt))
        return Motion(t_ns, newest.ned_p_m + newest.ned_v_m_s * dt, newest.ned_v_m_s, attitude, newest.body_rates_rad_s)
    after = bisect_right(history, t_ns, key=lambda motion: motion.t_ns)
    return _between(history[after - 1], history[after], t_ns)


def _between(a: Motion, b: Motion, t_ns: int) -> Motion:
    span = (b.t_ns - a.t_ns) / 1e9
    u = (t_ns - a.t_ns) / (b.t_ns - a.t_ns)
    # Hermite basis: p = h00 p0 + h10 T v0 + h01 p1 + h11 T v1
    h01 = u * u * (3 - 2 * u)
    position = (
        (1 - h01) * a.ned_p_m
        + h01 * b.ned_p_m
        + span * (u * (1 - u) ** 2 * a.ned_v_m_s - u * u * (1 - u) * b.ned_v_m_s)
    )
    return Motion(
        t_ns,
        position,
        (1 - u) * a.ned_v_m_s + u * b.ned_v_m_s,
        slerp(a.ned_q_body, b.ned_q_body, u),
        (1 - u) * a.body_rates_rad_s + u * b.body_rates_rad_s,
    )
