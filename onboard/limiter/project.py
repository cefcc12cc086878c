"""The velocity nearest to an asked one among all that keep to every half-space: an exact projection in space.

Dual active set (Goldfarb & Idnani 1983, DOI 10.1007/BF02591962) with the identity as its metric: the most violated
half-space joins the active ones, those whose multiplier falls to zero leave; every step brings the dual objective
nearer to its optimum, so no set of active half-spaces comes back. At most three are active in space, whatever number
is given: points behind a nearer one never join.
"""

from __future__ import annotations

import math

import numpy as np

Array = np.ndarray
Row = tuple[float, float, float]

TOLERANCE_M_S = 1e-9
_STEPS = 200
_PARALLEL = 1e-10
_STIFFNESS = 50.0
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
    v = v_m_s
    active: list[tuple[Row, float]] = []
    multipliers: list[float] = []
    for _ in range(_STEPS):
        excess = normals @ v - bounds_m_s
        worst = int(np.argmax(excess))
        if excess[worst] <= TOLERANCE_M_S:
            return v
        x, y, z = normals[worst].tolist()
        v = np.array(_join((x, y, z), float(bounds_m_s[worst]), v.tolist(), active, multipliers))
    return scaled(v_m_s, normals, bounds_m_s)


def retreat(v_m_s: Array, normals: Array, bounds_m_s: Array) -> Array:
    """Velocity that backs away, as nearly as they agree, from everything whose bound is below zero.

    Minimises |w - v|² + stiffness · Σ max(w·n_k - bound_k, 0)² over the half-spaces with a negative bound: retreats
    from opposite sides cannot both be had, and this blends them continuously. The result is cut to the speed
    hypot(|v|, fastest retreat).

    Args:
        v_m_s: velocity, m/s, (3,).
        normals: unit vectors, (K, 3).
        bounds_m_s: m/s, (K,); those not negative are left out.
    """
    back = bounds_m_s < 0.0
    if not back.any():
        return v_m_s
    n, b = normals[back], bounds_m_s[back]
    w = v_m_s
    active = n @ w > b
    for _ in range(_NEWTON_STEPS):  # the cost is piecewise quadratic: Newton ends when the active pieces stay
        m = n[active]
        w = np.linalg.solve(_IDENTITY + _STIFFNESS * (m.T @ m), v_m_s + _STIFFNESS * (m.T @ b[active]))
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
    excess = (normals @ v_m_s[:, :, None])[..., 0] - bounds_m_s
    each = np.arange(len(v_m_s))
    worst = excess.argmax(axis=1)
    over = np.maximum(excess[each, worst], 0.0)
    v = v_m_s - over[:, None] * normals[each, worst]
    # One active half-space is the usual case, and its projection is the first step of the exact one.
    left = ((normals @ v[:, :, None])[..., 0] - bounds_m_s).max(axis=1) > TOLERANCE_M_S
    for index in np.nonzero(left)[0]:
        v[index] = project(v_m_s[index], normals[index], bounds_m_s[index])
    return v


def retreat_many(v_m_s: Array, normals: Array, bounds_m_s: Array) -> Array:
    """`retreat` for many velocities, each with half-spaces of its own: (N, 3), (N, K, 3), (N, K) to (N, 3)."""
    w = v_m_s.copy()
    over = ((normals @ v_m_s[:, :, None])[..., 0] > bounds_m_s) & (bounds_m_s < 0.0)
    for index in np.nonzero(over.any(axis=1))[0]:
        w[index] = retreat(v_m_s[index], normals[index], bounds_m_s[index])
    return w


def _join(n: Row, bound: float, v: list[float], active: list[tuple[Row, float]], multipliers: list[float]) -> Row:
    """Make one violated half-space active, dropping those in its way; the velocity after it. Changes the two lists."""
    own = 0.0
    x, y, z = v
    while True:
        r, (zx, zy, zz) = _split(n, [a for a, _ in active])
        size = zx * zx + zy * zy + zz * zz
        full = (n[0] * x + n[1] * y + n[2] * z - bound) / size if size > _PARALLEL else math.inf
        step, leaving = full, -1
        for index, (share, multiplier) in enumerate(zip(r, multipliers, strict=True)):
            if share > 1e-12 and multiplier / share < step:
                step, leaving = multiplier / share, index
        if math.isinf(step):
            return x, y, z
        for index, share in enumerate(r):
            multipliers[index] -= step * share
        own += step
        if size > _PARALLEL:
            x, y, z = x - step * zx, y - step * zy, z - step * zz
        if leaving < 0:
            active.append((n, bound))
            multipliers.append(own)
            return x, y, z
        del active[leaving], multipliers[leaving]


def _split(n: Row, others: list[Row]) -> tuple[list[float], Row]:
    """Shares of the other normals in n by least squares, and what of n is at right angles to all of them."""
    basis: list[Row] = []
    upper: list[list[float]] = []
    for a in others:  # Gram-Schmidt: a_j = sum_i upper[j][i] basis_i
        ax, ay, az = a
        column = []
        for bx, by, bz in basis:
            dot = ax * bx + ay * by + az * bz
            column.append(dot)
            ax, ay, az = ax - dot * bx, ay - dot * by, az - dot * bz
        size = math.sqrt(ax * ax + ay * ay + az * az)
        column.append(size)
        basis.append((ax / size, ay / size, az / size) if size > 0.0 else (0.0, 0.0, 0.0))
        upper.append(column)
    x, y, z = n
    along = []
    for bx, by, bz in basis:
        dot = x * bx + y * by + z * bz
        along.append(dot)
        x, y, z = x - dot * bx, y - dot * by, z - dot * bz
    shares = [0.0] * len(basis)
    for i in range(len(basis) - 1, -1, -1):
        rest = along[i] - sum(upper[j][i] * shares[j] for j in range(i + 1, len(basis)))
        shares[i] = rest / upper[i][i] if upper[i][i] > 0.0 else 0.0
    return shares, (x, y, z)
