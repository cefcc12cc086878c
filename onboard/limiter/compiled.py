"""Compiled form of the half-spaces of obstacles.

`fill_rows` gives what `onboard.limiter.constraints.plain_rows` gives, the law as it is written down and explained; a
test holds the two together.
"""

from __future__ import annotations

import math

from numba import njit

PROPOSED, TTI, DPF = range(3)
"""Strategies."""
(
    STRATEGY,
    H_MIN,
    H_DESIRED,
    H_MAX,
    BAND,
    V_MAX,
    DPF_MIN,
    DPF_MID,
    DPF_MAX,
    DPF_V_MID,
    DPF_V_MAX,
    DELAY,
    DECELERATION,
    LEAD,
    BRAKE,
    MARGIN,
    FORESIGHT,
    PUSH,
    PUSH_GAIN,
    FULL_FROM,
    HELD_FROM,
    YIELD,
    CURVE_LEAD,
    CREEP,
    BRAKES_WITHIN,
    GIVEN_BACK,
    GIVEN_MOST,
) = range(27)
"""Places of the law's numbers in the array that `fill_rows` takes; names as in `LimiterConfig`."""
ASKED, INTENDED, FLOWN, BRAKING = range(4)
"""Places of the velocities of `constraints.Motion`."""


@njit(inline="always")
def _clipped(value, low, high):  # type: ignore[no-untyped-def]
    return min(max(value, low), high)


@njit(inline="always", error_model="numpy")
def stopped_as_a_whole(bound, speed, delay, deceleration):  # type: ignore[no-untyped-def]
    """`law.stopped_as_a_whole`."""
    if not 0.0 < bound < speed:
        return bound
    twice = 2.0 * deceleration
    return bound * (delay + bound / twice) / (delay + speed / twice)


@njit(inline="always", error_model="numpy")
def _stoppable(room, law):  # type: ignore[no-untyped-def]
    """`law.stoppable` without an obstacle that comes nearer."""
    linear = law[DECELERATION] * law[DELAY]
    return math.sqrt(linear * linear + 2.0 * law[DECELERATION] * max(room, 0.0)) - linear


@njit(error_model="numpy")
def _repulsion(h, v_i, law):  # type: ignore[no-untyped-def]
    """`law.repulsion`."""
    grown = min(v_i / law[FULL_FROM], 1.0)
    if law[STRATEGY] == DPF:
        if h <= law[DPF_MIN]:
            return law[DPF_V_MAX] * grown
        if h >= law[DPF_MAX]:
            return 0.0
        if h < law[DPF_MID]:
            slope = (law[DPF_V_MID] - law[DPF_V_MAX]) / (law[DPF_MID] - law[DPF_MIN])
            return (slope * (h - law[DPF_MIN]) + law[DPF_V_MAX]) * grown
        slope = -law[DPF_V_MID] / (law[DPF_MAX] - law[DPF_MID])
        return (slope * (h - law[DPF_MID]) + law[DPF_V_MID]) * grown
    near, desired = max(h, law[H_MIN]), law[H_DESIRED]
    if law[STRATEGY] == TTI:
        v_rep = v_i * (desired / near)
    else:
        ratio = desired / law[H_MIN]
        v_max = max(law[V_MAX], v_i * (ratio / (2.0 - law[H_MIN] / desired)))
        b = (v_max - v_i * ratio) / (1.0 / law[H_MIN] ** 2 - 1.0 / (law[H_MIN] * desired))  # eq. 21
        a = v_i * desired - b / desired
        v_rep = max((a + b / near) / near, 0.0) * grown  # eq. 20
    share = _clipped((law[H_MAX] - h) / law[BAND], 0.0, 1.0)
    return v_rep * (share * share * (3.0 - 2.0 * share))


@njit(inline="always", error_model="numpy")
def _braked(bound, excess, braking, law):  # type: ignore[no-untyped-def]
    """A bound less what a vehicle that is faster is asked for to brake, as in `constraints.braking_bound`."""
    less = law[LEAD] * excess + max(braking, 0.0) * min(excess / law[HELD_FROM], 1.0)
    return max(bound - less, min(bound, -law[BRAKE]))


@njit(error_model="numpy")
def _curve(h, asked, intended, flown, braking, closing, law):  # type: ignore[no-untyped-def]
    """Bound and excess of `constraints.curve`, from components towards the obstacle."""
    wanted, nearing = max(asked, intended, 0.0), max(closing, 0.0)
    v_i = max(wanted, flown) + nearing
    read_m = max(h - law[CURVE_LEAD] * (max(flown, 0.0) + nearing), 0.0)
    reference = wanted - _repulsion(read_m, v_i, law)  # eq. 19
    left = (read_m - law[H_DESIRED]) * law[PUSH_GAIN]
    back = _clipped(-left, 0.0, law[PUSH])
    reference = max(reference, -back)
    if law[STRATEGY] != DPF:
        if back > 0.0:
            reference = min(reference, -back * min(v_i / law[FULL_FROM], 1.0))
        else:
            reference = max(reference, min(_clipped(left, 0.0, law[CREEP]), wanted) - nearing, 0.0)
    beyond = _clipped((read_m - law[H_MAX]) / law[BAND], 0.0, 1.0)
    if beyond > 0.0:
        reference = max(reference, beyond * _stoppable(read_m - law[H_MIN], law))
    excess = 0.0
    if law[PUSH] == 0.0:
        near = _clipped((law[H_DESIRED] - read_m) / law[BRAKES_WITHIN], 0.0, 1.0)
        excess = near * max(flown - max(reference, 0.0), 0.0)
        reference = _braked(reference, excess, braking, law)
    lost = _clipped((law[H_MIN] + law[MARGIN] - h) * law[GIVEN_BACK], 0.0, law[GIVEN_MOST])
    lost *= min(wanted / law[FULL_FROM], 1.0)
    return min(reference, -lost) if lost > 0.0 else reference, excess


@njit(error_model="numpy")
def _foreseen_s(h, along, speed2, law):  # type: ignore[no-untyped-def]
    """When a moving obstacle counts in `constraints.nearest_ahead`; `along` is r·v."""
    if along >= 0.0 or h <= law[H_MIN]:
        return 0.0
    safe2 = max(speed2, 1e-9)
    t_s = -along / safe2
    root = along * along - safe2 * (h * h - law[H_MIN] ** 2)
    if root > 0.0:
        t_s = min(t_s, (-along - math.sqrt(root)) / safe2)
    return _clipped(t_s, 0.0, law[FORESIGHT])


@njit(inline="always")
def _dot(vectors, k, other):  # type: ignore[no-untyped-def]
    return vectors[k, 0] * other[0] + vectors[k, 1] * other[1] + vectors[k, 2] * other[2]


@njit(error_model="numpy")
def _hard(room, flown, speed, braking, law):  # type: ignore[no-untyped-def]
    """Bound and excess of `constraints.braking_bound`, from components along the normal and the flown speed."""
    bound = _stoppable(room, law)
    excess = max(flown - stopped_as_a_whole(bound, speed, law[DELAY], law[DECELERATION]), 0.0)
    return _braked(bound, excess, braking, law), excess


# A given signature compiles when the module is imported (and is kept on disk), not when the first obstacle appears.
@njit(
    "void(f8[:,::1],f8[:,::1],f8[:,:,::1],f8[:,:,::1],f8[:,:,::1],f8[::1],f8[:,:,::1],f8[:,::1],f8[:,::1])",
    cache=True,
    nogil=True,
    error_model="numpy",
)
def fill_rows(distances, unsure, units, velocities, motions, law, normals, bounds, excess):  # type: ignore[no-untyped-def]
    """Curve and bound of each obstacle of each vehicle as half-spaces, the curves first: `constraints.plain_rows`.

    Args:
        distances: (N, K), m.
        unsure: how far from there they may be, (N, K), m.
        units: unit vectors towards the obstacles, (N, K, 3).
        velocities: of the obstacles, (N, K, 3), m/s.
        motions: of the vehicles, (N, 4, 3), m/s.
        law: the law's numbers, (27,).
        normals: (N, 2 K, 3), written.
        bounds: (N, 2 K), m/s, written.
        excess: (N, 2 K), m/s, written.
    """
    count = distances.shape[1]
    for i in range(distances.shape[0]):
        unit, v, motion, normal = units[i], velocities[i], motions[i], normals[i]
        own = motion[FLOWN]
        speed = math.sqrt(own[0] * own[0] + own[1] * own[1] + own[2] * own[2])
        for k in range(count):
            h, certain = distances[i, k], max(distances[i, k] - unsure[i, k], 0.0)
            along = unit[k, 0] * v[k, 0] + unit[k, 1] * v[k, 1] + unit[k, 2] * v[k, 2]
            asked, intended = _dot(unit, k, motion[ASKED]), _dot(unit, k, motion[INTENDED])
            flown, braking = _dot(unit, k, motion[FLOWN]), _dot(unit, k, motion[BRAKING])
            for axis in range(3):
                normal[k, axis] = normal[count + k, axis] = unit[k, axis]
            bounds[i, k], excess[i, k] = _curve(certain, asked, intended, flown, braking, -along, law)
            last, ahead = count + k, h
            speed2 = v[k, 0] * v[k, 0] + v[k, 1] * v[k, 1] + v[k, 2] * v[k, 2]
            t_s = _foreseen_s(h, along * h, speed2, law)
            if t_s > 0.0:
                x, y = h * unit[k, 0] + t_s * v[k, 0], h * unit[k, 1] + t_s * v[k, 1]
                z = h * unit[k, 2] + t_s * v[k, 2]
                size = math.sqrt(x * x + y * y + z * z)
                if size > 1e-6:
                    ahead = size
                    normal[last, 0], normal[last, 1], normal[last, 2] = x / size, y / size, z / size
            flown, braking = _dot(normal, last, motion[FLOWN]), _dot(normal, last, motion[BRAKING])
            ahead -= unsure[i, k]
            bound, over = _hard(ahead - law[H_MIN] - law[MARGIN], flown, speed, braking, law)
            closing = _clipped(-along / law[YIELD], 0.0, 1.0)
            back = closing * _clipped((law[H_DESIRED] - ahead) * law[PUSH_GAIN], 0.0, law[PUSH])
            bounds[i, last], excess[i, last] = min(bound, -back) if back > 0.0 else bound, over
