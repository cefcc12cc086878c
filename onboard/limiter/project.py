"""The velocity nearest to an asked one among all that keep to every half-space: an exact projection in space.

Dual active set (Goldfarb & Idnani 1983, DOI 10.1007/BF02591962) with the identity as its metric: the most violated
half-space joins the active ones, those whose multiplier falls to zero leave; every step brings the dual objective
nearer to its optimum, so no set of active half-spaces comes back. At most three are active in space, whatever number
is given: points behind a nearer one never join.
"""

from __future__ import annotations

import math

import numpy as np

from onboard.limiter import compiled_projection
from onboard.limiter.config import LimiterConfig

Array = np.ndarray

TOLERANCE_M_S = 1e-9
_STIFFNESS = 50.0
FULLY_BACK_M_S = 0.05
"""A bound this far below zero is backed away from in full; nearer to zero less so, for rounding must not decide."""
_NEWTON_STEPS = 12
_IDENTITY = np.eye(3)


def project(v_m_s: Array, normals: Array, bounds_m_s: Array) -> Array:
    """Nearest velocity with v·n_k <= bound_k for all k.

    It is continuous in v, with Lipschitz constant 1 (a projection onto a convex set), turns with the frame, and is
    never longer than v while no bound is negative (the set then holds the origin).

    Args:
        v_m_s: velocity, m/s, (3,).
        normals: unit vectors, (K, 3).
        bounds_m_s: m/s, (K,), not negative: then the set is never empty.

    Returns:
        (3,), m/s.
    """
    if not len(bounds_m_s):
        return v_m_s
    return project_many(v_m_s[None], normals[None], bounds_m_s[None])[0]


def retreat(v_m_s: Array, normals: Array, bounds_m_s: Array) -> Array:
    """Velocity that backs away, as nearly as they agree, from everything whose bound is below zero.

    Minimises |w - v|² + Σ stiffness_k · max(w·n_k - bound_k, 0)² over the half-spaces with a negative bound: retreats
    from opposite sides cannot both be had, and this blends them continuously. The stiffness fades in where a bound
    falls below zero. The result is cut to the speed hypot(|v|, fastest retreat).

    Args:
        v_m_s: velocity, m/s, (3,).
        normals: unit vectors, (K, 3).
        bounds_m_s: m/s, (K,); those not negative are left out.
    """
    back = bounds_m_s < 0.0
    if not back.any():
        return v_m_s
    n, b = normals[back], bounds_m_s[back]
    stiffness = _STIFFNESS * np.minimum(-b / FULLY_BACK_M_S, 1.0)
    w = v_m_s
    active = n @ w > b
    for _ in range(_NEWTON_STEPS):  # the cost is piecewise quadratic: Newton ends when the active pieces stay
        m = n[active]
        pull = m.T * stiffness[active]
        w = np.linalg.solve(_IDENTITY + pull @ m, v_m_s + pull @ b[active])
        now = n @ w > b
        if (now == active).all():
            break
        active = now
    longest = math.hypot(math.sqrt(float(v_m_s @ v_m_s)), -float(b.min()))
    size = math.sqrt(float(w @ w))
    return w * (longest / size) if size > longest else w


def scaled(v_m_s: Array, normals: Array, bounds_m_s: Array) -> Array:
    """The longest velocity along the asked one that keeps to every half-space (bounds not negative), (3,), m/s."""
    approach = normals @ v_m_s
    over = approach > bounds_m_s
    if not over.any():
        return v_m_s
    return v_m_s * max(float((bounds_m_s[over] / approach[over]).min()), 0.0)


def project_many(v_m_s: Array, normals: Array, bounds_m_s: Array) -> Array:
    """`project` for many velocities, each with half-spaces of its own.

    Args:
        v_m_s: (N, 3), m/s.
        normals: (N, K, 3).
        bounds_m_s: (N, K), m/s, not negative.

    Returns:
        (N, 3), m/s.
    """
    v, normals, bounds_m_s = np.empty(v_m_s.shape), np.ascontiguousarray(normals), np.ascontiguousarray(bounds_m_s)
    ended = compiled_projection.fill_projections(np.ascontiguousarray(v_m_s), normals, bounds_m_s, TOLERANCE_M_S, v)
    for index in () if ended.all() else np.nonzero(~ended)[0]:
        v[index] = scaled(v_m_s[index], normals[index], bounds_m_s[index])
    return v


def project_whole_stops(
    v_m_s: Array, normals: Array, bounds_m_s: Array, firm: Array, config: LimiterConfig
) -> tuple[Array, Array]:
    """Nearest velocities from which a vehicle that is braked straight, as a whole, keeps to its rooms.

    A firm bound says which speed can be stopped within a room, where that is all the speed there is. Of an oblique
    flight at v the deceleration takes v_n/v towards the obstacle, so that v_n (delay + v/(2 a)) <= room is what holds:
    the bound at the speed v (`law.stopped_as_a_whole`). The faster the result may be, the lower the bounds: there is
    one speed that is that of the velocity projected onto its own bounds, and it depends continuously on the inputs.
    Straight at an obstacle nothing changes.

    Args:
        v_m_s: (N, 3), m/s.
        normals: (N, K, 3).
        bounds_m_s: (N, K), m/s, not negative.
        firm: which of them are what can be stopped within a room, (N, K).
        config: what the vehicle can do.

    Returns:
        The velocities (N, 3) and the bounds that they keep to (N, K), m/s.
    """
    bounds_m_s, normals = np.ascontiguousarray(bounds_m_s), np.ascontiguousarray(normals)
    v, lowered = np.empty(v_m_s.shape), np.empty(bounds_m_s.shape)
    ended = compiled_projection.fill_whole_stops(
        np.ascontiguousarray(v_m_s),
        normals,
        bounds_m_s,
        np.ascontiguousarray(firm),
        config.stop_delay_s,
        config.stop_deceleration_m_s2,
        TOLERANCE_M_S,
        lowered,
        v,
    )
    for index in () if ended.all() else np.nonzero(~ended)[0]:
        v[index] = scaled(v_m_s[index], normals[index], lowered[index])
    return v, lowered


def retreat_many(v_m_s: Array, normals: Array, bounds_m_s: Array) -> Array:
    """`retreat` for many velocities, each with half-spaces of its own: (N, 3), (N, K, 3), (N, K) to (N, 3)."""
    w = v_m_s.copy()
    over = ((normals @ v_m_s[:, :, None])[..., 0] > bounds_m_s) & (bounds_m_s < 0.0)
    for index in np.nonzero(over.any(axis=1))[0]:
        w[index] = retreat(v_m_s[index], normals[index], bounds_m_s[index])
    return w
