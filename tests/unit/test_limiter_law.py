"""The curves at their marks, in their traps, and the braking bound against PX4's measured stop."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from common.config import ConfigError, build
from onboard.limiter.config import LimiterConfig
from onboard.limiter.law import (
    coefficients,
    monotone,
    repulsion,
    stoppable,
    stopped_as_a_whole,
    stopping_distance_m,
    zone,
)

CONFIG = LimiterConfig()
PAPER = LimiterConfig(h_min_m=0.7, v_max_m_s=3.0, h_max_m=8.0)
"""b is zero at 1.4 m/s, as in the paper's second experiment."""


@pytest.mark.parametrize("v_i", [0.1, 0.7, 1.4, 2.1, 3.0])
def test_the_curve_passes_through_its_two_points(v_i: float):
    assert repulsion(CONFIG.h_desired_m, v_i, CONFIG) == pytest.approx(v_i)
    assert repulsion(CONFIG.h_min_m, v_i, CONFIG) == pytest.approx(CONFIG.v_max_m_s)


def test_coefficients_are_those_of_the_paper_where_it_can_be_worked_by_hand():
    a, b = coefficients(0.7, PAPER)
    assert b == pytest.approx((3.0 - 0.7 * 1.5 / 0.7) / (1 / 0.49 - 1 / 1.05))
    assert a == pytest.approx(1.05 - b / 1.5)
    assert coefficients(1.4, PAPER)[1] == pytest.approx(0.0, abs=1e-12), "experiment 2"
    assert coefficients(2.1, PAPER)[1] < 0.0, "experiment 3"


def test_experiment_2_is_the_time_to_impact_hyperbola():
    tti = msgspec.structs.replace(PAPER, strategy="tti")
    h = np.linspace(0.7, 9.0, 50)
    assert repulsion(h, 1.4, PAPER) == pytest.approx(repulsion(h, 1.4, tti))
    assert repulsion(3.0, 1.4, tti) == pytest.approx(0.7)


def test_the_field_is_piecewise_linear_and_knows_no_speed():
    dpf = msgspec.structs.replace(PAPER, strategy="dpf")
    h = np.array([9.0, 3.0, 2.375, 1.75, 1.5, 1.0, 0.6, 0.1])
    expected = [0.0, 0.0, 0.175, 0.35, 0.7, 1.4, 1.96, 1.96]
    for v_i in (0.3, 2.0):
        assert repulsion(h, v_i, dpf) == pytest.approx(expected)
    assert (repulsion(h, 0.0, dpf) == 0.0).all()


@pytest.mark.parametrize("strategy", ["proposed", "tti", "dpf"])
@pytest.mark.parametrize("v_i", [0.02, 0.7, 2.1, 6.0])
def test_nearer_is_never_less_and_nothing_jumps(strategy: str, v_i: float):
    config = msgspec.structs.replace(CONFIG, strategy=strategy)
    v_rep = repulsion(np.linspace(0.0, 8.0, 4001), v_i, config)
    assert (np.diff(v_rep) <= 1e-9).all()
    assert np.abs(np.diff(v_rep)).max() < 0.002 * 40.0, "no step, at h_max neither"
    assert v_rep[-1] == 0.0 and v_rep[0] == repulsion(CONFIG.h_min_m if strategy != "dpf" else 0.6, v_i, config)


def test_the_printed_law_would_speed_up_far_off_and_ours_does_not():
    a, b = coefficients(0.1, CONFIG)
    assert a / 4.0 + b / 16.0 < 0
    assert repulsion(4.0, 0.1, CONFIG) == 0.0


def test_a_curve_that_does_not_fall_is_refused_with_the_reason():
    monotone(2.1, PAPER)
    with pytest.raises(
        ConfigError, match=r"v_max_m_s: got 3; for an approach at 3 m/s the curve peaks at 0\.\d+ m, bey"
    ):
        monotone(3.0, PAPER)
    with pytest.raises(ConfigError, match=r"h_min_m < h_desired_m < h_mid_m < h_max_m: got 2\.0, 1\.5, 2\.5, 6\.0"):
        build(LimiterConfig, {"h_min_m": 2.0}, "limiter")


def test_the_limit_of_refusal_is_where_the_peak_reaches_h_min():
    v_i = PAPER.v_max_m_s * PAPER.h_min_m / PAPER.h_desired_m * (2.0 - PAPER.h_min_m / PAPER.h_desired_m)
    a, b = coefficients(v_i, PAPER)
    assert -2.0 * b / a == pytest.approx(PAPER.h_min_m)
    monotone(v_i - 0.01, PAPER)
    with pytest.raises(ConfigError):
        monotone(v_i + 0.01, PAPER)


def test_the_stoppable_speed_fits_the_measured_stop():
    """PX4 covered 2.29 m from 2 m/s (default drag): 2 m/s is allowed at that distance, not much nearer."""
    assert stoppable(2.29, CONFIG) == pytest.approx(2.0, abs=0.05)
    assert stoppable(1.5, CONFIG) < 1.6
    assert stoppable(0.0, CONFIG) == stoppable(-1.0, CONFIG) == 0.0


@pytest.mark.parametrize("v", [0.2, 1.0, 3.0])
@pytest.mark.parametrize("closing", [0.0, 0.5, 1.5])
def test_the_stoppable_speed_uses_up_the_room_exactly(v: float, closing: float):
    t_s = CONFIG.stop_delay_s + v / CONFIG.stop_deceleration_m_s2
    room_m = stopping_distance_m(v, CONFIG) + closing * t_s
    assert stoppable(room_m, CONFIG, closing) == pytest.approx(v)


@pytest.mark.parametrize("v", [0.0, 0.2, 1.0])
@pytest.mark.parametrize("speed", [0.0, 0.5, 2.1])
def test_a_stop_as_a_whole_uses_up_the_same_room(v: float, speed: float):
    """Of the deceleration of a faster flight v_n/v is left towards the obstacle; straight at it nothing changes."""
    towards = float(stopped_as_a_whole(v, speed, CONFIG))
    whole_s = CONFIG.stop_delay_s + max(speed, v) / (2.0 * CONFIG.stop_deceleration_m_s2)
    assert towards * whole_s == pytest.approx(stopping_distance_m(v, CONFIG))
    assert towards == v or towards < v < speed
    assert stopped_as_a_whole(-0.3, speed, CONFIG) == -0.3, "what backs away is left alone"


def test_zones():
    assert [zone(h, CONFIG) for h in (7.0, 3.0, 1.0, 0.5, math.nan)] == [
        "safe",
        "warning",
        "transition",
        "collision",
        "collision",
    ]


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"band_m": 5.0}, "band_m: got 5.0, expected at most h_max_m - h_desired_m = 4.5"),
        ({"margin_m": 0.8}, "margin_m: got 0.8, expected at most h_desired_m - h_min_m = 0.7"),
        ({"floor_m": 5.0, "ceiling_m": 4.0}, "floor_m: got 5.0, expected less than ceiling_m = 4.0"),
        ({"fence": [[0.0, 0.0], [1.0, 0.0]]}, "fence: got 2 corners, expected at least three"),
        ({"dpf": {"h_mid_m": 0.5}}, "h_min_m < h_mid_m < h_max_m: got 0.6, 0.5, 3.0"),
        ({"strategy": "dfp"}, "strategy"),
    ],
)
def test_settings_that_contradict_each_other_are_refused(fields: dict[str, object], words: str):
    with pytest.raises(ConfigError, match=words):
        build(LimiterConfig, fields, "limiter")
