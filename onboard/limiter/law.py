"""The repulsive velocity law for one obstacle, and the bound of what can be stopped (Al-Kaff 2019, section 5.1.1).

The operator's or task's velocity component towards an obstacle, v_i, becomes v_i - v_rep (eq. 19) with

    v_rep(h) = a/h + b/h²                                  (eq. 20)
    b = (v_max - v_i h_desired/h_min) / (1/h_min² - 1/(h_min h_desired)),  a = v_i h_desired - b/h_desired   (eq. 21)

so that v_rep passes through (h_desired, v_i), where the vehicle stops, and (h_min, v_max).

Where we differ from the print, and why:
- The curve does not vanish at h_max and would step there: it is blended in over a band below h_max.
- With v_i far below v_max, a is negative and so is v_rep at long range: the printed law would speed up.
  Clamped at zero.
- With v_i above v_max the curve has its peak beyond h_min and lets the vehicle through: v_max is raised to
  v_i h_desired/h_min there (then b = 0, the time-to-impact hyperbola).
- Below h_min v_rep stays at v_max instead of growing without bound.
- The result is not negative: this version slows down and stops, it does not back away.
"""

from __future__ import annotations

import math
from typing import Literal

from onboard.limiter.config import LimiterConfig

Zone = Literal["safe", "warning", "transition", "collision", "blind"]


def coefficients(v_i_m_s: float, config: LimiterConfig) -> tuple[float, float]:
    """The a (m²/s) and b (m³/s) of the curve for an approach speed v_i > 0, m/s (Al-Kaff 2019, eq. 21)."""
    h_min, h_desired = config.h_min_m, config.h_desired_m
    v_max = config.v_max_m_s if v_i_m_s < config.v_max_m_s else v_i_m_s * h_desired / h_min
    # b = (v_max - v_i h_desired/h_min) / (1/h_min² - 1/(h_min h_desired))
    b = (v_max - v_i_m_s * h_desired / h_min) / (1.0 / h_min**2 - 1.0 / (h_min * h_desired))
    return v_i_m_s * h_desired - b / h_desired, b


def repulsion(h_m: float, v_i_m_s: float, config: LimiterConfig) -> float:
    """Repulsive velocity, m/s, not negative, at distance h from an obstacle approached at v_i (eq. 20, blended)."""
    if v_i_m_s <= 0.0 or h_m >= config.h_max_m:
        return 0.0
    a, b = coefficients(v_i_m_s, config)
    h = max(h_m, config.h_min_m)
    v_rep = max(a / h + b / h**2, 0.0)  # eq. 20
    fraction = min((config.h_max_m - h_m) / config.band_m, 1.0)
    return v_rep * fraction * fraction * (3.0 - 2.0 * fraction)


def stoppable(h_m: float, config: LimiterConfig) -> float:
    """Largest approach speed, m/s, from which the vehicle still stops at h_min.

    Solves v t + v²/(2 a) = h - h_min for v, with the delay t and deceleration a of the configuration.
    """
    room_m = h_m - config.h_min_m
    if room_m <= 0.0:
        return 0.0
    a, t = config.stop_deceleration_m_s2, config.stop_delay_s
    return math.sqrt((a * t) ** 2 + 2.0 * a * room_m) - a * t


def allowed_approach(h_m: float, v_i_m_s: float, closing_m_s: float, config: LimiterConfig) -> float:
    """Largest own speed towards an obstacle, m/s, not negative.

    Args:
        h_m: distance, m.
        v_i_m_s: own speed asked towards it, m/s.
        closing_m_s: speed at which the obstacle itself comes nearer, m/s; one that recedes counts as standing.
        config: the law.

    Returns:
        The lesser of eq. 19, taken for the relative approach speed, and the stoppable speed; v_i itself when it is
        zero or below.
    """
    if v_i_m_s <= 0.0:
        return 0.0
    closing = max(closing_m_s, 0.0)
    relative = v_i_m_s + closing
    if h_m <= config.h_desired_m:
        return 0.0
    reference = relative - repulsion(h_m, relative, config)  # eq. 19
    return min(max(min(reference, stoppable(h_m, config)) - closing, 0.0), v_i_m_s)


def zone(h_m: float, config: LimiterConfig) -> Zone:
    """Name of the zone of a distance: safe, warning, transition or collision (Al-Kaff 2019, figure 8)."""
    if h_m > config.h_max_m:
        return "safe"
    if h_m > config.h_mid_m:
        return "warning"
    return "transition" if h_m > config.h_min_m else "collision"
