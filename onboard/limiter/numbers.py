"""The law's numbers: those that no vehicle file changes, and all of them in the order of the compiled loops."""

from __future__ import annotations

from functools import cache

import numpy as np

from onboard.limiter import compiled
from onboard.limiter.config import LimiterConfig
from onboard.limiter.law import FULL_FROM_M_S

Array = np.ndarray
HELD_FROM_M_S = 0.1
"""The summed excess acts in full from this excess on: no jump where it ends."""
BRAKES_WITHIN_M = 0.2
"""Below h_desired, without push-back, braking grows in within this distance."""
CREEP_M_S = 0.05
"""What the curve leaves at least just beyond h_desired, where less than a decimetre is left."""
GIVEN_BACK_1_S, PUSHED_BACK_1_S = 1.0, 4.0
"""Drift into the hard bound's margin is given back at this speed per metre, without and with push-back."""
YIELD_M_S = 0.5
"""An obstacle that comes nearer at this speed is given way to at the full push-back."""


def given_back(config: LimiterConfig) -> tuple[float, float]:
    """Speed at which drift into the hard bound's margin is given back per metre, 1/s, and at most, m/s.

    Without push-back as slowly as an estimate drifts. With it fast enough for a velocity loop that still holds 0.3 m/s
    of what it has learnt (PX4's after seconds before an obstacle, with the drag of its built-in quadrotor).
    """
    if config.push_back_m_s == 0.0:
        return GIVEN_BACK_1_S, FULL_FROM_M_S
    return PUSHED_BACK_1_S, config.push_back_m_s


@cache
def numbers(config: LimiterConfig) -> Array:
    """The law's numbers in the order of `compiled`."""
    values = {
        compiled.STRATEGY: {"proposed": compiled.PROPOSED, "tti": compiled.TTI, "dpf": compiled.DPF}[config.strategy],
        compiled.H_MIN: config.h_min_m,
        compiled.H_DESIRED: config.h_desired_m,
        compiled.H_MAX: config.h_max_m,
        compiled.BAND: config.band_m,
        compiled.V_MAX: config.v_max_m_s,
        compiled.DPF_MIN: config.dpf.h_min_m,
        compiled.DPF_MID: config.dpf.h_mid_m,
        compiled.DPF_MAX: config.dpf.h_max_m,
        compiled.DPF_V_MID: config.dpf.v_mid_m_s,
        compiled.DPF_V_MAX: config.dpf.v_max_m_s,
        compiled.DELAY: config.stop_delay_s,
        compiled.DECELERATION: config.stop_deceleration_m_s2,
        compiled.LEAD: config.brake_lead,
        compiled.BRAKE: config.brake_m_s,
        compiled.MARGIN: config.margin_m,
        compiled.FORESIGHT: config.foresight_s,
        compiled.PUSH: config.push_back_m_s,
        compiled.PUSH_GAIN: config.push_back_gain_1_s,
        compiled.FULL_FROM: FULL_FROM_M_S,
        compiled.HELD_FROM: HELD_FROM_M_S,
        compiled.YIELD: YIELD_M_S,
        compiled.CURVE_LEAD: config.curve_lead_s,
        compiled.CREEP: CREEP_M_S,
        compiled.BRAKES_WITHIN: BRAKES_WITHIN_M,
        compiled.GIVEN_BACK: given_back(config)[0],
        compiled.GIVEN_MOST: given_back(config)[1],
    }
    return np.array([values[place] for place in range(len(values))], dtype=float)
