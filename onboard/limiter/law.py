"""The comfortable curve and the hard braking bound for the distance to an obstacle: pure functions over arrays.

The component v_i of the asked velocity towards an obstacle becomes v_i - v_rep (Al-Kaff 2019, eq. 19) with

    v_rep(h) = a/h + b/h²                                                                            (eq. 20)
    b = (v_max - v_i h_desired/h_min) / (1/h_min² - 1/(h_min h_desired)),  a = v_i h_desired - b/h_desired    (eq. 21)

which passes through (h_desired, v_i), where the vehicle stops, and (h_min, v_max). Two other strategies are
selectable: time to impact, v_rep = v_i h_desired/h, and the Dynamic Parametric Field (Brandt & Colton 2010), piecewise
linear in h whatever v_i.

Where we differ from the print, and why:
- The curve does not vanish at h_max and would step there: it is blended in over a band below h_max.
- Below h_min v_rep stays at v_max instead of growing without bound.
- Near h_min the curve (and everywhere the field, which does not know v_i) would act in full on the slightest approach:
  both grow over the first 0.1 m/s of v_i.
- v_i so small that a is negative (v_i < v_max h_min²/h_desired²) makes v_rep negative far off: the printed law would
  speed up. Clamped at zero.
- v_i so large that the curve has its peak beyond h_min (h_min < -2b/a, that is v_max h_min (2 - h_min/h_desired) <
  v_i h_desired) would let a vehicle that got nearer through. `monotone` refuses such a set with the reason; in flight,
  where a refusal would leave no limiter, v_max is raised to the least value that keeps the curve falling.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from common.config import ConfigError
from onboard.limiter.config import LimiterConfig

Zone = Literal["safe", "warning", "transition", "collision", "blind"]
Array = np.ndarray
_FALL_S = 1.0
FULL_FROM_M_S = 0.1
"""Approach speed from which the curve acts in full, m/s."""


def coefficients(v_i_m_s: Array | float, config: LimiterConfig) -> tuple[Array, Array]:
    """a, m²/s, and b, m³/s, of the curve (Al-Kaff 2019, eq. 21), v_max raised where the curve would not fall.

    Args:
        v_i_m_s: approach speed, m/s, any shape.
        config: the law.
    """
    h_min, h_desired = config.h_min_m, config.h_desired_m
    v_i = np.asarray(v_i_m_s, dtype=float)
    v_max = np.maximum(config.v_max_m_s, v_i * (h_desired / h_min / (2.0 - h_min / h_desired)))
    # b = (v_max - v_i h_desired/h_min) / (1/h_min² - 1/(h_min h_desired))
    b = (v_max - v_i * (h_desired / h_min)) / (1.0 / h_min**2 - 1.0 / (h_min * h_desired))
    return v_i * h_desired - b / h_desired, b


def monotone(v_i_m_s: float, config: LimiterConfig) -> None:
    """Refuse a set of parameters whose printed curve does not fall from h_min on, for an approach speed.

    Raises:
        ConfigError: h_min <= -2b/a; the text names the least v_max that would do.
    """
    h_min, h_desired, v_max = config.h_min_m, config.h_desired_m, config.v_max_m_s
    least = v_i_m_s * h_desired / h_min / (2.0 - h_min / h_desired)
    if v_max <= least:
        b = (v_max - v_i_m_s * h_desired / h_min) / (1.0 / h_min**2 - 1.0 / (h_min * h_desired))
        a = v_i_m_s * h_desired - b / h_desired
        peak = f"peaks at {-2.0 * b / a:.2f} m" if a > 0.0 else "rises with the distance"
        raise ConfigError(
            f"v_max_m_s: got {v_max:g}; for an approach at {v_i_m_s:g} m/s the curve {peak}, beyond "
            f"h_min_m = {h_min:g}: expected more than {least:.2f}, or a larger h_min_m"
        )


def repulsion(h_m: Array | float, v_i_m_s: Array | float, config: LimiterConfig) -> Array:
    """Repulsive velocity of the chosen strategy, m/s, not negative, falling with the distance.

    Args:
        h_m: distances, m, not negative.
        v_i_m_s: approach speeds, m/s; none repels a vehicle that does not approach.
        config: the law.

    Returns:
        The shape that both broadcast to.
    """
    h, v_i = np.asarray(h_m, dtype=float), np.maximum(v_i_m_s, 0.0)
    if config.strategy == "dpf":
        field = config.dpf
        v_rep = np.interp(h, (field.h_min_m, field.h_mid_m, field.h_max_m), (field.v_max_m_s, field.v_mid_m_s, 0.0))
        return v_rep * np.minimum(v_i / FULL_FROM_M_S, 1.0)
    near = np.maximum(h, config.h_min_m)
    if config.strategy == "tti":
        v_rep = v_i * (config.h_desired_m / near)
    else:
        a, b = coefficients(v_i, config)
        v_rep = np.maximum((a + b / near) / near, 0.0) * np.minimum(v_i / FULL_FROM_M_S, 1.0)  # eq. 20
    share = np.clip((config.h_max_m - h) / config.band_m, 0.0, 1.0)
    return v_rep * (share * share * (3.0 - 2.0 * share))


def stoppable(room_m: Array | float, config: LimiterConfig, closing_m_s: Array | float = 0.0) -> Array:
    """Largest own speed, m/s, from which the vehicle comes to rest within a room that itself shrinks.

    Solves v t + v²/(2 a) + c (t + v/a) = room for v, with the delay t and deceleration a of the configuration: while
    the vehicle stops, an obstacle that comes nearer at c covers its share.

    Args:
        room_m: distance that is free, m; none or less gives 0.
        config: what the vehicle can do.
        closing_m_s: speed at which the obstacle comes nearer, m/s, not negative.
    """
    a, t = config.stop_deceleration_m_s2, config.stop_delay_s
    c = np.asarray(closing_m_s, dtype=float)
    free = np.maximum(np.asarray(room_m, dtype=float) - c * t, 0.0)
    linear = a * t + c
    return np.sqrt(linear * linear + 2.0 * a * free) - linear


def stopped_as_a_whole(bound_m_s: Array | float, speed_m_s: Array | float, config: LimiterConfig) -> Array:
    """What a bound from `stoppable` becomes for a vehicle that is faster than it across the way, and brakes straight.

    The room is v_b t + v_b²/(2 a), of which a flight at a speed v uses v_n t + v_n v/(2 a) towards the obstacle.

    Args:
        bound_m_s: v_b, m/s; what is not positive stays.
        speed_m_s: v, m/s; one that is not above the bound changes nothing.
        config: what the vehicle can do.
    """
    bound, twice, t = np.asarray(bound_m_s, dtype=float), 2.0 * config.stop_deceleration_m_s2, config.stop_delay_s
    positive = np.maximum(bound, 0.0)
    return np.minimum(bound, positive * (t + positive / twice) / (t + np.maximum(speed_m_s, positive) / twice))


def stopping_distance_m(v_m_s: float, config: LimiterConfig) -> float:
    """Distance covered from a stop command at a speed to rest, m."""
    return v_m_s * config.stop_delay_s + v_m_s * v_m_s / (2.0 * config.stop_deceleration_m_s2)


def sight_speed(free_m_s: Array | float, age_s: Array | float, silent_s: Array | float, config: LimiterConfig) -> Array:
    """Fastest speed towards a place by how long ago it was looked at, m/s.

    A place that was looked at stays known for a while, as long as something else is looked at meanwhile. While nothing
    is, whoever comes in at the edge of the last picture is not seen, and a vehicle that goes on outruns the picture
    that would show them: it slows down as soon as the next one is late.

    Args:
        free_m_s: what may be flown where it is looked at now, m/s.
        age_s: since it was looked at, s.
        silent_s: since any source has seen anything, s; a long silence is a standstill.
        config: ageing.
    """
    span_s, silent = max(config.memory_s - config.stale_s, 1e-3), np.asarray(silent_s, dtype=float)
    known = np.clip((config.memory_s - np.asarray(age_s, dtype=float)) / span_s, 0.0, 1.0)
    sight = np.clip((config.stale_s - silent) / (config.stale_s - config.late_s), 0.0, 1.0)
    known = np.minimum(known, sight * sight)  # at once, and without a jump: most of it goes while the vehicle is fast
    speed = config.unseen_speed_m_s + known * np.maximum(free_m_s - config.unseen_speed_m_s, 0.0)
    blind_s = silent - config.stale_s - config.unseen_stop_s
    return speed * (1.0 - np.clip(blind_s / _FALL_S, 0.0, 1.0))


def zone(h_m: float, config: LimiterConfig) -> Zone:
    """Name of the zone of a distance: safe, warning, transition or collision (Al-Kaff 2019, figure 8)."""
    if math.isnan(h_m) or h_m <= config.h_min_m:
        return "collision"
    if h_m > config.h_max_m:
        return "safe"
    return "warning" if h_m > config.h_mid_m else "transition"
