"""The repulsive law at its marks, in its traps, and the stopping bound against PX4's measured stop."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from common.config import ConfigError, build
from common.messages import Obstacle
from onboard.limiter.config import LimiterConfig
from onboard.limiter.law import allowed_approach, coefficients, repulsion, stoppable, zone
from onboard.limiter.limiter import limit

CONFIG = LimiterConfig()
WALL_NORTH = Obstacle(distance_m=1.6, ned_direction=(1.0, 0.0, 0.0))


@pytest.mark.parametrize("v_i", [0.1, 0.7, 1.4, 2.1, 3.9])
def test_the_curve_passes_through_its_two_points(v_i: float):
    assert repulsion(CONFIG.h_desired_m, v_i, CONFIG) == pytest.approx(v_i)
    assert repulsion(CONFIG.h_min_m, v_i, CONFIG) == pytest.approx(CONFIG.v_max_m_s)


@pytest.mark.parametrize("v_i", [0.1, 0.7, 2.1, 3.9, 6.0])
def test_below_the_collision_distance_it_stays_at_its_maximum(v_i: float):
    assert repulsion(0.0, v_i, CONFIG) == repulsion(CONFIG.h_min_m, v_i, CONFIG) >= v_i


def test_b_changes_sign_as_the_experiments_of_the_paper_need():
    assert coefficients(0.7, CONFIG)[1] > 0
    hyperbola = CONFIG.v_max_m_s * CONFIG.h_min_m / CONFIG.h_desired_m
    assert coefficients(hyperbola, CONFIG)[1] == pytest.approx(0.0)
    assert coefficients(3.0, CONFIG)[1] < 0


def test_the_printed_law_would_speed_up_far_off_and_ours_does_not():
    a, b = coefficients(0.1, CONFIG)
    assert a / 4.0 + b / 16.0 < 0
    assert repulsion(4.0, 0.1, CONFIG) == 0.0


def test_no_step_at_the_border_of_the_safe_zone():
    values = [repulsion(CONFIG.h_max_m + 0.01 * k, 1.5, CONFIG) for k in range(-20, 3)]
    assert max(abs(a - b) for a, b in pairwise(values)) < 0.02
    assert values[-1] == 0.0


def test_the_stoppable_speed_fits_the_measured_stop():
    """PX4 covered 2.29 m from 2 m/s (default drag): 2 m/s is allowed at that distance, not much nearer."""
    assert stoppable(CONFIG.h_min_m + 2.29, CONFIG) == pytest.approx(2.0, abs=0.05)
    assert stoppable(CONFIG.h_min_m + 1.5, CONFIG) < 1.6


def test_a_moving_obstacle_takes_its_share():
    assert allowed_approach(4.0, 1.0, 3.0, CONFIG) == 0.0
    assert allowed_approach(4.0, 1.0, -3.0, CONFIG) == allowed_approach(4.0, 1.0, 0.0, CONFIG)


def test_zones():
    assert [zone(h, CONFIG) for h in (7.0, 3.0, 1.0, 0.5)] == ["safe", "warning", "transition", "collision"]


def test_along_a_wall_nothing_is_taken_away():
    asked = (-0.5, 2.0, 0.3)
    assert limit(asked, [WALL_NORTH], CONFIG).ned_v_m_s == asked


def test_towards_a_wall_only_the_approach_is_taken_away():
    limited = limit((2.0, 1.0, -0.2), [Obstacle(distance_m=1.2, ned_direction=(1.0, 0.0, 0.0))], CONFIG)
    assert limited.ned_v_m_s == pytest.approx((0.0, 1.0, -0.2), abs=1e-6)
    assert (limited.zone, limited.changed) == ("transition", True)


def test_a_corner_stops():
    corner = [Obstacle(distance_m=1.0, ned_direction=(math.cos(a), math.sin(a), 0.0)) for a in (-0.7, 0.7)]
    assert limit((2.0, 0.0, 0.0), corner, CONFIG).ned_v_m_s == pytest.approx((0.0, 0.0, 0.0), abs=1e-5)


def test_old_distances_are_brought_up_to_date():
    wall = [Obstacle(distance_m=3.0, ned_direction=(1.0, 0.0, 0.0))]
    fresh = limit((2.0, 0.0, 0.0), wall, CONFIG, ned_vehicle_v_m_s=(2.0, 0.0, 0.0))
    old = limit((2.0, 0.0, 0.0), wall, CONFIG, ned_vehicle_v_m_s=(2.0, 0.0, 0.0), age_s=0.5)
    assert old.distance_m == pytest.approx(2.0)
    assert old.ned_v_m_s[0] < fresh.ned_v_m_s[0]


@pytest.mark.parametrize("asked", [(math.nan, 0.0, 0.0), (0.0, math.inf, 0.0)])
def test_no_number_means_no_motion(asked):
    assert limit(asked, [], CONFIG).ned_v_m_s == (0.0, 0.0, 0.0)
    assert limit((1.0, 0.0, 0.0), [Obstacle(distance_m=math.nan, ned_direction=(1.0, 0.0, 0.0))], CONFIG).ned_v_m_s == (
        0.0,
        0.0,
        0.0,
    )


def test_without_data_it_is_blind_and_stands_still_where_data_is_required():
    assert limit((1.0, 0.0, 0.0), None, CONFIG).ned_v_m_s == (1.0, 0.0, 0.0)
    blind = limit((1.0, 0.0, 0.0), None, CONFIG, required=True)
    assert (blind.ned_v_m_s, blind.zone) == ((0.0, 0.0, 0.0), "blind")


@pytest.mark.parametrize(
    ("table", "text"),
    [
        ({"h_min_m": 2.0}, "h_min_m < h_desired_m"),
        ({"band_m": 5.0}, "band_m"),
        ({"h_dessired_m": 1.0}, "did you mean 'h_desired_m'"),
    ],
)
def test_settings_in_contradiction_are_refused(table, text: str):
    with pytest.raises(ConfigError, match=text):
        build(LimiterConfig, table, "kite [limiter]")


@pytest.mark.parametrize("speed", [0.7, 1.4, 2.1])
def test_the_three_experiments_stop_at_the_desired_distance(speed: float):
    """Al-Kaff 2019, section 6.3: 0.7, 1.4 and 2.1 m/s all stop at h_desired (here with PX4's velocity loop)."""
    h, v, integral, lag1, lag2, dt = 8.0, speed, 0.0, 0.0, 0.0, 0.01
    lowest = h
    for _ in range(4000):
        target = allowed_approach(h, speed, 0.0, CONFIG) if h > 0 else 0.0
        error = target - v
        integral += 0.4 * error * dt
        command = 1.8 * error + integral
        lag1 += (command - lag1) * dt / 0.14
        lag2 += (lag1 - lag2) * dt / 0.14
        v += (lag2 - 0.1 * v) * dt
        h -= v * dt
        lowest = min(lowest, h)
    assert h == pytest.approx(CONFIG.h_desired_m, abs=0.25)
    assert lowest > CONFIG.h_min_m
