"""How fast what is near comes nearer by itself, from the points of now and those of a moment ago.

A picture tells distances, not velocities. Where the old points, seen from where the vehicle is now, leave a larger
distance in a direction than the new point has, the difference over the time is the obstacle's own closing speed. It is
a conservative estimate for what comes straight at the vehicle, and none (zero) for what crosses its line of sight: that
appears at once, nearer than anything could have come, and is nearest, so it counts as it stands from then on.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def closing_speeds(
    points_m: Array, before_m: Array, dt_s: float, beside_rad: float, noise_m_s: float, limit_m_s: float
) -> Array:
    """Closing speed (K,), m/s, of each point towards the vehicle, not negative, its own motion taken out.

    Args:
        points_m: points (K, 3) from the vehicle's centre, NED, m.
        before_m: earlier points (B, 3), from the vehicle's present centre, NED, m.
        dt_s: time between the two, s.
        beside_rad: how far to the side of a direction an earlier point counts for it, rad: the size of a cell.
        noise_m_s: what is below is zero.
        limit_m_s: what is above is zero: no obstacle came so fast along the line of sight.
    """
    if not len(points_m) or not len(before_m) or dt_s <= 0.0:
        return np.zeros(len(points_m))
    now_m, was_m = np.linalg.norm(points_m, axis=1), np.linalg.norm(before_m, axis=1)
    cosines = (points_m / np.maximum(now_m, 1e-6)[:, None]) @ (before_m / np.maximum(was_m, 1e-6)[:, None]).T
    # The nearest earlier point about the same direction; none: nothing was known there, so nothing is said.
    was = np.where(cosines > np.cos(beside_rad), was_m[None, :], np.inf).min(axis=1)
    speed = (was - now_m) / dt_s
    return np.where((speed > noise_m_s) & (speed < limit_m_s), speed, 0.0)
