"""From obstacles to half-spaces v·n <= bound: the comfortable curve, and the hard bound on the path ahead.

Every function takes one vehicle (obstacles along the last axis, K) or many (N, K): the benchmark judges what flies.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from onboard.limiter import compiled
from onboard.limiter.config import LimiterConfig
from onboard.limiter.law import FULL_FROM_M_S, repulsion, stoppable, stopped_as_a_whole
from onboard.limiter.numbers import BRAKES_WITHIN_M, CREEP_M_S, HELD_FROM_M_S, YIELD_M_S, given_back, numbers

Array = np.ndarray


class Motion(NamedTuple):
    """What is asked and what is flown; each (..., 3), NED, m/s."""

    asked: Array
    """Velocity asked."""
    intended: Array
    """What it is on its way to; the asked one where its change is not limited."""
    flown: Array
    """Velocity of the vehicle."""
    braking: Array
    """Excess over the bound, summed over time: the direction that is braked, and how much."""


class Bounds(NamedTuple):
    """Half-spaces of obstacles, one an obstacle."""

    normals: Array
    """Unit vectors, (..., K, 3)."""
    bounds_m_s: Array
    """Largest speed along each, m/s, (..., K); below zero: brake or back away."""
    excess_m_s: Array
    """How much faster than its bound the vehicle is along each, m/s, (..., K)."""
    firm: Array
    """Whether it is the hard bound, and holds for braking and retreat as well, (..., K)."""


def towards(normals: Array, v_m_s: Array) -> Array:
    """Components of velocities (..., 3) along normals (..., K, 3): (..., K), m/s."""
    return (normals @ v_m_s[..., None])[..., 0]


def curve(
    distance_m: Array, normals: Array, ned_v_m_s: Array, motion: Motion, config: LimiterConfig
) -> tuple[Array, Array]:
    """Bounds of the comfortable curve (Al-Kaff 2019, eq. 19) and how much faster the vehicle is, m/s, (..., K) each.

    v_i is the larger of the asked and the flown speed towards the obstacle, and the obstacle's own approach beside it.
    Below h_desired the bound is negative (the paper's correction of an overshoot). About h_desired the curve of a slow
    approach is so flat that a small error of the velocity would move the stop by decimetres; so the last decimetre is
    closed, and the retreat grows, with the gain of the push-back, both capped. The curve is read where the vehicle will
    be `curve_lead_s` later: flown late, it would be overshot. Nothing is pushed away that is not approached. What is
    not approached now must not become approached by what is taken away for another obstacle: its bound is zero, and
    opens up beyond h_max within the blending band. Only without push-back is the vehicle ever called faster: see
    `_kept_without_push_back`.

    A vehicle that is pushed on at an obstacle drifts with the error of its velocity estimate and with what its velocity
    loop has learnt, without end, where no retreat returns it (without push-back, and with the field, which stops a fast
    vehicle nowhere): within the hard bound's margin that is given back (`numbers.given_back`), where the vehicle is
    asked to approach alone.

    Args:
        distance_m: (..., K), m.
        normals: unit vectors towards the obstacles, (..., K, 3).
        ned_v_m_s: velocities of the obstacles, (..., K, 3).
        motion: of the vehicle.
        config: the law.
    """
    asked = np.maximum(towards(normals, motion.asked), 0.0)
    if motion.intended is not motion.asked:
        asked = np.maximum(asked, towards(normals, motion.intended))
    closing = np.maximum(-(normals * ned_v_m_s).sum(axis=-1), 0.0)
    flown = towards(normals, motion.flown)
    v_i = np.maximum(asked, flown) + closing
    h = np.maximum(distance_m - config.curve_lead_s * (np.maximum(flown, 0.0) + closing), 0.0)
    reference = asked - repulsion(h, v_i, config)  # eq. 19
    retreat = np.clip((config.h_desired_m - h) * config.push_back_gain_1_s, 0.0, config.push_back_m_s)
    reference = np.maximum(reference, -retreat)
    if config.strategy != "dpf":  # the field stops where its speed does, not at h_desired
        backing = -retreat * np.minimum(v_i / FULL_FROM_M_S, 1.0)
        left = np.clip((h - config.h_desired_m) * config.push_back_gain_1_s, 0.0, CREEP_M_S)
        creep = np.maximum(np.minimum(left, asked) - closing, 0.0)
        reference = np.where(retreat > 0.0, np.minimum(reference, backing), np.maximum(reference, creep))
    beyond = np.clip((h - config.h_max_m) / config.band_m, 0.0, 1.0)
    opened = np.maximum(reference, beyond * stoppable(h - config.h_min_m, config))
    reference = np.where(beyond > 0.0, opened, reference)
    excess = np.zeros(reference.shape)
    if config.push_back_m_s == 0.0:
        reference, excess = _kept_without_push_back(reference, h, flown, towards(normals, motion.braking), config)
    lost_m = config.h_min_m + config.margin_m - distance_m
    gain_1_s, most_m_s = given_back(config)
    back = np.clip(lost_m * gain_1_s, 0.0, most_m_s) * np.minimum(asked / FULL_FROM_M_S, 1.0)
    return np.where(back > 0.0, np.minimum(reference, -back), reference), excess


def _kept_without_push_back(
    reference: Array, read_m: Array, flown: Array, held: Array, config: LimiterConfig
) -> tuple[Array, Array]:
    """What keeps the distance where no push-back is permitted: bounds and excess, m/s.

    Below h_desired nothing returns what an overshoot takes, so what is flown beyond the curve there is braked, as
    beyond the hard bound: asked for less than nothing while the vehicle still closes in, and no longer.
    """
    near = np.clip((config.h_desired_m - read_m) / BRAKES_WITHIN_M, 0.0, 1.0)
    excess = near * np.maximum(flown - np.maximum(reference, 0.0), 0.0)
    return _braked(reference, excess, held, config), excess


def nearest_ahead(distance_m: Array, normals: Array, ned_v_m_s: Array, config: LimiterConfig) -> tuple[Array, Array]:
    """Where moving obstacles will be nearest to the vehicle's place within the foresight, but no nearer than h_min.

    Kept free as if an obstacle stood there: the half-space in front of it has the whole path behind it, whenever the
    obstacle gets there.

    Args:
        distance_m: (..., K), m.
        normals: unit vectors towards the obstacles, (..., K, 3).
        ned_v_m_s: velocities of the obstacles, (..., K, 3).
        config: foresight and h_min.

    Returns:
        Distances (..., K), m, and unit vectors (..., K, 3).
    """
    if not ned_v_m_s.any():
        return distance_m, normals
    speed2 = (ned_v_m_s * ned_v_m_s).sum(axis=-1)
    along = (normals * ned_v_m_s).sum(axis=-1) * distance_m  # r·v
    safe2 = np.maximum(speed2, 1e-9)
    nearest_s = -along / safe2
    root = along * along - safe2 * (distance_m * distance_m - config.h_min_m**2)
    enters_s = (-along - np.sqrt(np.maximum(root, 0.0))) / safe2
    t_s = np.where(root > 0.0, np.minimum(nearest_s, enters_s), nearest_s)
    t_s = np.where((along < 0.0) & (distance_m > config.h_min_m), np.clip(t_s, 0.0, config.foresight_s), 0.0)
    place = distance_m[..., None] * normals + t_s[..., None] * ned_v_m_s
    ahead_m = np.sqrt((place * place).sum(axis=-1))
    moved = (t_s > 0.0) & (ahead_m > 1e-6)
    unit = place / np.maximum(ahead_m, 1e-6)[..., None]
    return np.where(moved, ahead_m, distance_m), np.where(moved[..., None], unit, normals)


def braking_bound(room_m: Array, normals: Array, motion: Motion, config: LimiterConfig) -> Bounds:
    """The hard bound: what can be stopped within a room, less what a vehicle that is faster needs to brake.

    Args:
        room_m: free distance along each normal, m, (..., K).
        normals: unit vectors, (..., K, 3).
        motion: of the vehicle.
        config: what it can do.
    """
    bound = stoppable(room_m, config)
    speed = np.sqrt((motion.flown * motion.flown).sum(axis=-1, keepdims=True))
    excess = np.maximum(towards(normals, motion.flown) - stopped_as_a_whole(bound, speed, config), 0.0)
    braked = _braked(bound, excess, towards(normals, motion.braking), config)
    return Bounds(normals, braked, excess, np.ones(bound.shape, dtype=bool))


def _braked(bound_m_s: Array, excess_m_s: Array, held_m_s: Array, config: LimiterConfig) -> Array:
    """Bounds less what a vehicle that is faster by an excess is asked for to brake, m/s."""
    less = config.brake_lead * excess_m_s + np.maximum(held_m_s, 0.0) * np.minimum(excess_m_s / HELD_FROM_M_S, 1.0)
    return np.maximum(bound_m_s - less, np.minimum(bound_m_s, -config.brake_m_s))


def obstacle_bound(
    distance_m: Array, normals: Array, ned_v_m_s: Array, unsure_m: Array, motion: Motion, config: LimiterConfig
) -> Bounds:
    """The hard bound before obstacles, moving ones included: (..., K).

    What comes nearer, and would come nearer than h_desired, is given way to, capped by the push-back. What is uncertain
    about a place takes away from the room, not from the way to it: which side to give way to, the path tells even where
    the obstacle may be anywhere about the vehicle.
    """
    ahead_m, ahead = nearest_ahead(distance_m, normals, ned_v_m_s, config)
    certain_m = ahead_m - unsure_m
    held = braking_bound(certain_m - config.h_min_m - config.margin_m, ahead, motion, config)
    closing = np.clip(-(normals * ned_v_m_s).sum(axis=-1) / YIELD_M_S, 0.0, 1.0)
    retreat = np.clip((config.h_desired_m - certain_m) * config.push_back_gain_1_s, 0.0, config.push_back_m_s)
    return held._replace(
        bounds_m_s=np.where(closing * retreat > 0.0, np.minimum(held.bounds_m_s, -closing * retreat), held.bounds_m_s)
    )


def obstacle_rows(
    distance_m: Array,
    normals: Array,
    ned_v_m_s: Array,
    motion: Motion,
    config: LimiterConfig,
    unsure_m: Array | None = None,
) -> Bounds:
    """Curve and bound of each obstacle as half-spaces: the figures of `plain_rows`, at a multiple of its speed.

    Args:
        distance_m: (K,), or (N, K) for many vehicles, m.
        normals: unit vectors towards the obstacles, (..., K, 3).
        ned_v_m_s: velocities of the obstacles, (..., K, 3).
        motion: of the vehicle.
        config: the law.
        unsure_m: how far from there each obstacle may be, (..., K), m; None for not at all.
    """
    shape, count = distance_m.shape[:-1], distance_m.shape[-1]
    many = shape[0] if shape else 1
    rows, bounds, excess = np.empty((many, 2 * count, 3)), np.empty((many, 2 * count)), np.empty((many, 2 * count))
    compiled.fill_rows(
        _plain(distance_m).reshape(many, count),
        np.zeros((many, count)) if unsure_m is None else _plain(unsure_m).reshape(many, count),
        _plain(normals).reshape(many, count, 3),
        _plain(ned_v_m_s).reshape(many, count, 3),
        np.array(motion).reshape(4, many, 3).transpose(1, 0, 2).copy(),
        numbers(config),
        rows,
        bounds,
        excess,
    )
    firm = np.zeros((*shape, 2 * count), dtype=bool)
    firm[..., count:] = True
    return Bounds(
        rows.reshape(*shape, 2 * count, 3), bounds.reshape(*shape, 2 * count), excess.reshape(*shape, 2 * count), firm
    )


def _plain(array: Array) -> Array:
    return np.ascontiguousarray(array, dtype=float)


def plain_rows(
    distance_m: Array,
    normals: Array,
    ned_v_m_s: Array,
    motion: Motion,
    config: LimiterConfig,
    unsure_m: Array | None = None,
) -> Bounds:
    """Curve and bound of each obstacle as half-spaces, (..., 2 K), the curves first: the reference of `obstacle_rows`.

    Args:
        distance_m: (..., K), m.
        normals: unit vectors towards the obstacles, (..., K, 3).
        ned_v_m_s: velocities of the obstacles, (..., K, 3).
        motion: of the vehicle.
        config: the law.
        unsure_m: how far from there each obstacle may be, (..., K), m; None for not at all.
    """
    unsure = np.zeros(distance_m.shape) if unsure_m is None else unsure_m
    comfortable, excess = curve(np.maximum(distance_m - unsure, 0.0), normals, ned_v_m_s, motion, config)
    hard = obstacle_bound(distance_m, normals, ned_v_m_s, unsure, motion, config)
    return Bounds(
        np.concatenate([normals, hard.normals], axis=-2),
        np.concatenate([comfortable, hard.bounds_m_s], axis=-1),
        np.concatenate([excess, hard.excess_m_s], axis=-1),
        np.concatenate([~hard.firm, hard.firm], axis=-1),
    )


def deepest_braking(rows: Bounds) -> Array:
    """How far below standstill the setpoint may go to brake, whatever the sight in that direction, m/s, (...)."""
    if not rows.bounds_m_s.shape[-1]:
        return np.zeros(rows.bounds_m_s.shape[:-1])
    return np.where(rows.excess_m_s > 0.0, np.maximum(-rows.bounds_m_s, 0.0), 0.0).max(axis=-1)


def braking_after(bounds: Bounds, motion: Motion, config: LimiterConfig, dt_s: float) -> Array:
    """The summed excess one step later, (..., 3), m/s: grows along the largest excess, fades without one."""
    excess = bounds.excess_m_s
    if not excess.shape[-1]:
        return motion.braking * max(1.0 - 2.0 * dt_s, 0.0)
    worst = excess.argmax(axis=-1)[..., None]
    most = np.take_along_axis(excess, worst, axis=-1)
    normal = np.take_along_axis(bounds.normals, worst[..., None], axis=-2)[..., 0, :]
    grown = motion.braking + config.brake_integral_1_s * dt_s * most * normal
    size = np.sqrt((grown * grown).sum(axis=-1, keepdims=True))
    grown = grown * np.minimum(1.0, config.brake_m_s / np.maximum(size, 1e-9))
    return np.where(most > 0.0, grown, motion.braking * max(1.0 - 2.0 * dt_s, 0.0))
