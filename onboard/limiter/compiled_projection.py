"""Compiled forms of the projection onto half-spaces: `onboard.limiter.project.project_many` and its
`project_whole_stops`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from onboard.limiter.compiled import stopped_as_a_whole

_MOST_ACTIVE = 4
_STEPS = 200
_PARALLEL = 1e-10
_ROOT_STEPS = 40


@njit(error_model="numpy")
def _split(n, active, count, normals, shares, rest, basis, upper):  # type: ignore[no-untyped-def]
    """Shares of the active normals in n by least squares; in `rest` what of n is at right angles to all of them."""
    for j in range(count):  # Gram-Schmidt: a_j = sum_i upper[j, i] basis_i
        x, y, z = normals[active[j], 0], normals[active[j], 1], normals[active[j], 2]
        for i in range(j):
            dot = x * basis[i, 0] + y * basis[i, 1] + z * basis[i, 2]
            x, y, z = x - dot * basis[i, 0], y - dot * basis[i, 1], z - dot * basis[i, 2]
            upper[j, i] = dot
        size = math.sqrt(x * x + y * y + z * z)
        scale = 1.0 / size if size > 0.0 else 0.0
        basis[j, 0], basis[j, 1], basis[j, 2], upper[j, j] = x * scale, y * scale, z * scale, size
    x, y, z = n[0], n[1], n[2]
    for i in range(count):
        dot = x * basis[i, 0] + y * basis[i, 1] + z * basis[i, 2]
        x, y, z = x - dot * basis[i, 0], y - dot * basis[i, 1], z - dot * basis[i, 2]
        shares[i] = dot
    rest[0], rest[1], rest[2] = x, y, z
    for i in range(count - 1, -1, -1):
        left = shares[i]
        for j in range(i + 1, count):
            left -= upper[j, i] * shares[j]
        shares[i] = left / upper[i, i] if upper[i, i] > 0.0 else 0.0


@njit(error_model="numpy")
def _join(worst, bound, normals, v, active, multipliers, count):  # type: ignore[no-untyped-def]
    """Make a violated half-space active, dropping those in its way; how many are active then. Changes v."""
    own = 0.0
    n, rest, shares = normals[worst], np.empty(3), np.empty(_MOST_ACTIVE)
    basis, upper = np.empty((_MOST_ACTIVE, 3)), np.empty((_MOST_ACTIVE, _MOST_ACTIVE))
    while True:
        _split(n, active, count, normals, shares, rest, basis, upper)
        size = rest[0] * rest[0] + rest[1] * rest[1] + rest[2] * rest[2]
        step, leaving = math.inf, -1
        if size > _PARALLEL:
            step = (n[0] * v[0] + n[1] * v[1] + n[2] * v[2] - bound) / size
        for j in range(count):
            if shares[j] > 1e-12 and multipliers[j] / shares[j] < step:
                step, leaving = multipliers[j] / shares[j], j
        if math.isinf(step):
            return count
        for j in range(count):
            multipliers[j] -= step * shares[j]
        own += step
        if size > _PARALLEL:
            v[0], v[1], v[2] = v[0] - step * rest[0], v[1] - step * rest[1], v[2] - step * rest[2]
        if leaving < 0:
            active[count], multipliers[count] = worst, own
            return count + 1
        count -= 1
        for j in range(leaving, count):
            active[j], multipliers[j] = active[j + 1], multipliers[j + 1]


@njit(error_model="numpy")
def _project(asked, normal, bound, tolerance, v, active, multipliers):  # type: ignore[no-untyped-def]
    """Nearest velocity with v·n_k <= bound_k for all k, written to v; whether it ended before the steps ran out."""
    count = 0
    v[0], v[1], v[2] = asked[0], asked[1], asked[2]
    for _ in range(_STEPS):
        worst, most = -1, tolerance
        for k in range(normal.shape[0]):
            over = normal[k, 0] * v[0] + normal[k, 1] * v[1] + normal[k, 2] * v[2] - bound[k]
            if not over <= most:  # what is not a number counts as exceeded
                worst, most = k, over
        if worst < 0:
            return True
        if count == _MOST_ACTIVE:  # in space at most three are active; this would be rounding gone wild
            return False
        count = _join(worst, bound[worst], normal, v, active, multipliers, count)
    return False


@njit("b1[::1](f8[:,::1],f8[:,:,::1],f8[:,::1],f8,f8[:,::1])", cache=True, nogil=True, error_model="numpy")
def fill_projections(asked, normals, bounds, tolerance, projected):  # type: ignore[no-untyped-def]
    """Nearest velocities with v·n_k <= bound_k for all k: `project.project_many`.

    Args:
        asked: velocities, (N, 3), m/s.
        normals: unit vectors, (N, K, 3).
        bounds: (N, K), m/s, not negative.
        tolerance: what a bound may be exceeded by, m/s.
        projected: (N, 3), written.

    Returns:
        (N,), whether it ended; where not, the steps ran out.
    """
    ended = np.zeros(len(asked), np.bool_)
    active, multipliers = np.zeros(_MOST_ACTIVE, np.int64), np.zeros(_MOST_ACTIVE)
    for i in range(asked.shape[0]):
        ended[i] = _project(asked[i], normals[i], bounds[i], tolerance, projected[i], active, multipliers)
    return ended


@njit(inline="always")
def _length(v):  # type: ignore[no-untyped-def]
    return math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@njit(error_model="numpy")
def _stops(v, normal, bound, firm, delay, deceleration, tolerance):  # type: ignore[no-untyped-def]
    """Whether a velocity, braked as a whole, keeps to every firm bound."""
    speed = _length(v)
    for k in range(normal.shape[0]):
        if firm[k]:
            most = stopped_as_a_whole(bound[k], speed, delay, deceleration)
            if normal[k, 0] * v[0] + normal[k, 1] * v[1] + normal[k, 2] * v[2] > most + tolerance:
                return False
    return True


@njit(inline="always", error_model="numpy")
def _lower(bound, firm, speed, delay, deceleration, low):  # type: ignore[no-untyped-def]
    for k in range(len(bound)):
        low[k] = stopped_as_a_whole(bound[k], speed, delay, deceleration) if firm[k] else bound[k]


@njit(
    "b1[::1](f8[:,::1],f8[:,:,::1],f8[:,::1],b1[:,::1],f8,f8,f8,f8[:,::1],f8[:,::1])",
    cache=True,
    nogil=True,
    error_model="numpy",
)
def fill_whole_stops(asked, normals, bounds, firm, delay, deceleration, tolerance, lowered, projected):  # type: ignore[no-untyped-def]
    """Nearest velocities from which a stop as a whole keeps to the bounds: `project.project_whole_stops`.

    Args:
        asked: velocities, (N, 3), m/s.
        normals: unit vectors, (N, K, 3).
        bounds: (N, K), m/s, not negative.
        firm: which of them are what can be stopped within a room, (N, K).
        delay: before the vehicle slows down, s.
        deceleration: m/s².
        tolerance: what a bound may be exceeded by, m/s.
        lowered: the bounds at the speed of the result, (N, K), m/s, written.
        projected: (N, 3), written.

    Returns:
        (N,), whether it ended; where not, the steps ran out.
    """
    all_ended = np.zeros(len(asked), np.bool_)
    active, multipliers = np.zeros(_MOST_ACTIVE, np.int64), np.zeros(_MOST_ACTIVE)
    for i in range(asked.shape[0]):
        normal, bound, hard, low, v = normals[i], bounds[i], firm[i], lowered[i], projected[i]
        low[:] = bound
        ended = _project(asked[i], normal, low, tolerance, v, active, multipliers)
        if ended and _stops(v, normal, bound, hard, delay, deceleration, 2.0 * tolerance):
            all_ended[i] = True
            continue
        # |v(speed)| - speed falls through zero; what is braked for at `fast` is never slower than the result.
        slow, over_slow = 0.0, _length(v)
        fast, over_fast, side = _length(asked[i]), 0.0, 0
        for step in range(_ROOT_STEPS):
            speed = fast if step == 0 else (fast * over_slow - slow * over_fast) / (over_slow - over_fast)
            _lower(bound, hard, speed, delay, deceleration, low)
            ended = _project(asked[i], normal, low, tolerance, v, active, multipliers)
            over = _length(v) - speed
            if over > tolerance:
                slow, over_slow = speed, over
                over_fast *= 0.5 if side == 1 else 1.0  # Illinois: the end that stays must not hold the secant up
                side = 1
            else:
                fast, over_fast = speed, over
                over_slow *= 0.5 if side == -1 else 1.0
                side = -1 if step else 0
            if -tolerance <= over <= tolerance or fast - slow <= tolerance:
                break
        _lower(bound, hard, fast, delay, deceleration, low)
        all_ended[i] = _project(asked[i], normal, low, tolerance, v, active, multipliers)
    return all_ended
