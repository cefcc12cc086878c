"""The filter: the nearest velocity that keeps to every bound, for any number of obstacles, edges and unseen space."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from common.messages import Vec3
from onboard.limiter.config import LimiterConfig
from onboard.limiter.constraints import (
    Bounds,
    Motion,
    braking_after,
    braking_bound,
    deepest_braking,
    obstacle_rows,
    towards,
)
from onboard.limiter.law import Zone, stopped_as_a_whole, zone
from onboard.limiter.project import project_many, project_whole_stops, retreat_many
from onboard.limiter.surroundings import Surroundings
from onboard.limiter.volume import edges

Array = np.ndarray
Why = Literal["clear", "curve", "bound", "blind", "floor", "ceiling", "fence", "push-back", "no data"]
_CHANGED_M_S = 1e-6
_ROUNDING_M_S = 1e-7
_BRAKING_FROM_M_S = 0.1
_ZERO: Vec3 = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Limited:
    """What the limiter made of a velocity."""

    asked_ned_v_m_s: Vec3
    """The velocity asked, or the one that it is on its way to, NED, m/s."""
    ned_v_m_s: Vec3
    """The velocity that may be flown, NED, m/s."""
    zone: Zone
    """Zone of the nearest obstacle; `blind` without obstacle data."""
    distance_m: float = -1.0
    """Distance of the nearest obstacle, m; -1 when there is none."""
    ned_direction: Vec3 = _ZERO
    """Unit vector towards it, NED; zero when there is none."""
    why: Why = "clear"
    """What took the most away."""
    culprit: int = -1
    """Index of the obstacle that limits, or the nearest when none does; -1 when there is none."""
    braking_ned_v_m_s: Vec3 = _ZERO
    """What to pass as `braking_ned_v_m_s` the next time, NED, m/s."""

    @property
    def changed(self) -> bool:
        """Whether anything was changed."""
        return self.why != "clear"


def limit(
    ned_v_m_s: Vec3,
    around: Surroundings | None,
    config: LimiterConfig,
    *,
    ned_vehicle_v_m_s: Vec3 = _ZERO,
    ned_intended_v_m_s: Vec3 | None = None,
    ned_p_m: Vec3 | None = None,
    braking_ned_v_m_s: Vec3 = _ZERO,
    dt_s: float = 0.0,
) -> Limited:
    """The velocity nearest to the asked one that keeps to the law for every obstacle and edge.

    Each obstacle sets a half-space v·n <= bound: the lesser of the comfortable curve and the braking bound; each edge
    of the flight volume one more. The velocity is projected onto all of them, negative ones as standstill, the braking
    bounds for a vehicle that stops as a whole from it (`project.project_whole_stops`). Where one is negative it then
    brakes or backs away (`project.retreat`), under the hard bounds; then its speed is cut to what the sight in its
    direction allows. So the result is never longer than what was asked, but for braking and push-back, both capped;
    what approaches nothing, in sight, passes unchanged.

    Args:
        ned_v_m_s: asked velocity, NED, m/s.
        around: obstacles and sight; None where standing still is all that is known to be safe.
        config: the law.
        ned_vehicle_v_m_s: present velocity of the vehicle, NED, m/s.
        ned_intended_v_m_s: what the asked velocity is on its way to, where its change is limited, NED, m/s; the curve
            is that of the faster of the two towards each obstacle. None for the asked one.
        ned_p_m: position from home, NED, m; None leaves floor, ceiling and fence out.
        braking_ned_v_m_s: as the last call returned it; zero at the beginning.
        dt_s: time since then, s.

    Returns:
        The limited velocity; zero when a number is not finite.
    """
    if around is None or not _finite(
        ned_v_m_s, ned_intended_v_m_s or _ZERO, ned_vehicle_v_m_s, ned_p_m or _ZERO, braking_ned_v_m_s, (dt_s,)
    ):
        return Limited(ned_v_m_s, _ZERO, "blind", why="clear" if ned_v_m_s == _ZERO else "no data")
    count = len(around.distance_m)
    least_m = around.least_m
    if count and not math.isfinite(float(least_m.sum() + around.ned_direction.sum() + around.ned_v_m_s.sum())):
        return Limited(ned_v_m_s, _ZERO, "collision", why="no data")
    intended = ned_v_m_s if ned_intended_v_m_s is None else ned_intended_v_m_s
    motion = Motion(*(np.array(v) for v in (ned_v_m_s, intended, ned_vehicle_v_m_s, braking_ned_v_m_s)))
    rows, kinds = _rows(around, motion, ned_p_m, config)
    v, rows = bounded(motion.asked, rows, config)
    # A setpoint against the motion brakes and leads nowhere: sight does not bound it.
    fastest = max(around.fastest_m_s(_vector(v)), float(deepest_braking(rows)))
    speed = math.sqrt(float(v @ v))
    if blind := speed > fastest:
        v = v * (fastest / speed)
    why, culprit = _reason(motion.asked, v, rows, kinds, blind, config)
    nearest = int(least_m.argmin()) if count else -1
    distance_m = float(least_m[nearest]) if count else -1.0
    return Limited(
        intended,
        ned_v_m_s if why == "clear" else _vector(v),
        zone(distance_m, config) if count else ("blind" if around.blind else "safe"),
        distance_m,
        _vector(around.ned_direction[nearest]) if count else _ZERO,
        why,
        culprit % count if count and culprit >= 0 else nearest,
        _vector(braking_after(rows, motion, config, dt_s)),
    )


def bounded(asked_m_s: Array, rows: Bounds, config: LimiterConfig) -> tuple[Array, Bounds]:
    """The nearest velocity under every bound, then braking and retreat where a bound is below zero.

    What brakes or backs away keeps to the hard bounds, not to the curves of obstacles that are not in its way: behind
    the vehicle a curve would leave no room to give way to.

    Args:
        asked_m_s: velocity, (3,).
        rows: R half-spaces.
        config: what the vehicle can do.

    Returns:
        The velocity, (3,), m/s, and the half-spaces, the hard ones as low as they are at its speed.
    """
    many, together = bounded_many(asked_m_s[None], Bounds(*(part[None] for part in rows)), config)
    return many[0], Bounds(*(part[0] for part in together))


def bounded_many(asked_m_s: Array, rows: Bounds, config: LimiterConfig) -> tuple[Array, Bounds]:
    """`bounded` for many vehicles, (N, 3), each with R half-spaces of its own."""
    v, rows = _projected(asked_m_s, rows, config)
    back = np.nonzero((rows.bounds_m_s < 0.0).any(axis=1))[0]
    if len(back):
        some = Bounds(*(part[back] for part in rows))
        v[back] = _backing(v[back], some, config)
    return v, rows


def _backing(v: Array, rows: Bounds, config: LimiterConfig) -> Array:
    """Velocities (N, 3) that brake or back away from bounds below zero, under the hard bounds at the speed of it."""
    away = retreat_many(v, rows.normals, rows.bounds_m_s)
    speed = np.sqrt(np.maximum((v * v).sum(axis=-1), (away * away).sum(axis=-1)))
    firm = _firm(rows, speed[..., None], config)
    around, here = (project_many(w, rows.normals, firm) for w in (away, v))
    return around + _braking_share(rows)[..., None] * (_straight(here, away, rows.normals, firm) - around)


def _projected(asked_m_s: Array, rows: Bounds, config: LimiterConfig) -> tuple[Array, Bounds]:
    """Velocities (N, 3) under every bound, negative ones as standstill, and the half-spaces at their speeds."""
    bounds = rows.bounds_m_s
    v, lowered = project_whole_stops(asked_m_s, rows.normals, np.maximum(bounds, 0.0), rows.firm, config)
    return v, rows._replace(bounds_m_s=np.where(bounds < 0.0, bounds, lowered))


def _straight(v: Array, away: Array, normals: Array, firm: Array) -> Array:
    """As far from v (..., 3), which keeps to the firm bounds, towards another velocity as they allow, (..., 3), m/s."""
    step = towards(normals, away - v)
    room = np.maximum(firm - towards(normals, v), 0.0)
    # Along a bound that it already touches a step is a rounding error, of either sign: it must not decide.
    shares = np.where(step > room + _ROUNDING_M_S, room / np.maximum(step, _ROUNDING_M_S), 1.0)
    return v + shares.min(axis=-1)[..., None] * (away - v)


def _braking_share(rows: Bounds) -> Array:
    """Whether it is braking, 1, or giving way, 0: who brakes brakes straight, who gives way goes round, (...)."""
    return np.minimum(rows.excess_m_s.max(axis=-1) / _BRAKING_FROM_M_S, 1.0)


def _firm(rows: Bounds, speed_m_s: Array, config: LimiterConfig) -> Array:
    """Bounds while braking and backing away at up to a speed (..., 1), m/s: the hard ones alone.

    What is nearer than h_desired beside the way back takes its share in the retreat itself. If it closed the way, a
    vehicle between obstacles could not back away from the one that comes nearest.
    """
    hard = np.where(rows.firm, np.maximum(rows.bounds_m_s, 0.0), 0.0)
    return np.where(rows.firm, stopped_as_a_whole(hard, speed_m_s, config), np.inf)


def _rows(
    around: Surroundings, motion: Motion, ned_p_m: Vec3 | None, config: LimiterConfig
) -> tuple[Bounds, tuple[Why, ...]]:
    """Every half-space: the curve of each obstacle, its bound, the edges; and what the kinds of rows are called.

    The names are those of the curve, the bound, and each edge.
    """
    h, n, v = around.distance_m, around.ned_direction, around.ned_v_m_s
    rows = obstacle_rows(h, n, v, motion, config, around.unsure_m)
    kinds: tuple[Why, ...] = ("curve", "bound")
    if ned_p_m is not None and (config.floor_m is not None or config.ceiling_m is not None or config.fence):
        near = edges(ned_p_m, config)
        sides = braking_bound(near.rooms_m, near.normals, motion, config)
        rows = Bounds(*(np.concatenate(pair) for pair in zip(rows, sides, strict=True)))
        kinds += near.names
    return rows, kinds


def _reason(
    asked: Array, v: Array, rows: Bounds, kinds: tuple[Why, ...], blind: bool, config: LimiterConfig
) -> tuple[Why, int]:
    """What took the most away, and the index of its row within its kind; -1 without one."""
    if not len(rows.bounds_m_s):
        return ("blind", -1) if blind else ("clear", -1)
    over = rows.normals @ asked - rows.bounds_m_s
    worst = int(over.argmax())
    if over[worst] <= _CHANGED_M_S:
        return ("blind", -1) if blind else ("clear", -1)
    edges_from = len(over) - (len(kinds) - 2)
    if worst >= edges_from:
        return kinds[2 + worst - edges_from], -1
    count = edges_from // 2
    if rows.bounds_m_s[worst] < 0.0 and rows.normals[worst] @ v < -_CHANGED_M_S and not rows.excess_m_s[worst] > 0.0:
        # Without push-back only what drift took is given back, within the hard bound's margin.
        return ("push-back" if config.push_back_m_s > 0.0 else "bound"), worst
    return kinds[worst // count], worst


def _finite(*vectors: tuple[float, ...]) -> bool:
    return all(math.isfinite(c) for vector in vectors for c in vector)


def _vector(array: Array) -> Vec3:
    x, y, z = array.tolist()
    return (x, y, z)
