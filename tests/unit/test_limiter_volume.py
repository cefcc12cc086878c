"""Floor, ceiling and fence, and what is left when the bound, the curve and they meet."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from benchmarks.approach_flight import Simulated, fly
from common.messages import Obstacle, Vec3
from onboard.limiter.config import LimiterConfig
from onboard.limiter.law import stoppable
from onboard.limiter.limiter import limit
from onboard.limiter.surroundings import Surroundings, of_obstacles
from onboard.limiter.volume import edges, inside

FREE = Surroundings()
L_SHAPE = ((0.0, 0.0), (20.0, 0.0), (20.0, 10.0), (10.0, 10.0), (10.0, 20.0), (0.0, 20.0))
"""An inward corner at (10, 10)."""


def _uses_up(v_m_s: float, room_m: float, beside_m_s: float, config: LimiterConfig) -> bool:
    """Whether a speed towards an edge, with another along it, uses up a room: braked as a whole, v_n (t + v/(2 a))."""
    whole_m_s = math.hypot(v_m_s, beside_m_s)
    used_m = v_m_s * (config.stop_delay_s + whole_m_s / (2.0 * config.stop_deceleration_m_s2))
    return used_m == pytest.approx(room_m)


def _at(v: Vec3, p: Vec3, config: LimiterConfig) -> Vec3:
    return limit(v, FREE, config, ned_p_m=p).ned_v_m_s


@pytest.mark.parametrize(("down", "height", "why"), [(1.0, 2.5, "floor"), (-1.0, 9.5, "ceiling")])
def test_floor_and_ceiling_stop_a_vertical_motion_and_nothing_else(down: float, height: float, why: str):
    config = LimiterConfig(floor_m=2.0, ceiling_m=10.0)
    limited = limit((1.0, 0.0, down), FREE, config, ned_p_m=(0.0, 0.0, -height))
    assert limited.ned_v_m_s[:2] == pytest.approx((1.0, 0.0))
    assert _uses_up(abs(limited.ned_v_m_s[2]), 0.5, 1.0, config) and limited.ned_v_m_s[2] * down > 0.0
    assert limited.why == why
    beyond = _at((1.0, 0.0, down), (0.0, 0.0, -1.0 if down > 0 else -11.0), config)
    assert beyond == pytest.approx((1.0, 0.0, 0.0))
    assert _at((1.0, 0.0, -down), (0.0, 0.0, -height), config) == (1.0, 0.0, -down)


def test_inside_and_outside_of_a_polygon_with_an_inward_corner():
    corners = np.array(L_SHAPE)
    assert inside((5.0, 15.0), corners) and inside((15.0, 5.0), corners)
    assert not inside((15.0, 15.0), corners) and not inside((-0.1, 5.0), corners)


def test_the_fence_lets_a_vehicle_slide_along_and_stops_it_in_a_corner():
    config = LimiterConfig(fence=L_SHAPE)
    along = _at((-2.0, 1.0, 0.0), (0.3, 10.0, -5.0), config)
    assert along[1:] == pytest.approx((1.0, 0.0)) and _uses_up(-along[0], 0.3, 1.0, config)
    assert _at((-2.0, 0.0, 0.0), (0.3, 10.0, -5.0), config) == pytest.approx((-float(stoppable(0.3, config)), 0.0, 0.0))
    assert _at((-2.0, -2.0, 0.0), (0.0, 0.0, -5.0), config) == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
    assert _at((1.0, 1.0, 0.0), (5.0, 5.0, -5.0), config) == pytest.approx((1.0, 1.0, 0.0))


def test_the_inward_corner_is_rounded_and_its_extended_sides_bar_nothing():
    config = LimiterConfig(fence=L_SHAPE)
    here = (9.5, 9.5, -5.0)
    towards = _at((2.0, 2.0, 0.0), here, config)
    assert towards == pytest.approx((float(stoppable(math.hypot(0.5, 0.5), config)) * math.sqrt(0.5),) * 2 + (0.0,))
    assert _at((2.0, 0.0, 0.0), (9.5, 5.0, -5.0), config) == (2.0, 0.0, 0.0), "the other leg is open"


def test_from_outside_only_the_way_back_is_free():
    config = LimiterConfig(fence=L_SHAPE)
    outside = (-2.0, 5.0, -5.0)
    assert _at((-1.0, 0.5, 0.0), outside, config) == pytest.approx((0.0, 0.5, 0.0))
    assert _at((1.0, 0.5, 0.0), outside, config) == (1.0, 0.5, 0.0)
    assert len(edges(outside, config).rooms_m) == 1


def test_a_corner_of_walls_stops_without_a_tremor():
    config = LimiterConfig()
    walls = [Obstacle(distance_m=1.6, ned_direction=(math.cos(a), math.sin(a), 0.0)) for a in (-0.7, 0.7)]
    aside = [limit((2.0, 0.01 * k, 0.0), of_obstacles(walls), config).ned_v_m_s for k in range(-5, 6)]
    assert all(abs(v[1]) < 0.06 and 0.0 < v[0] < 0.3 for v in aside), "what is asked aside, and no more"
    assert max(abs(a[1] - b[1]) for a, b in pairwise(aside)) < 0.012
    shut = limit((2.0, 0.0, 0.0), of_obstacles([*walls, *walls]), config).ned_v_m_s
    assert shut[0] <= 0.2 and shut[1] == pytest.approx(0.0, abs=1e-9)


def test_between_two_obstacles_that_are_too_near_it_keeps_to_the_middle():
    config = LimiterConfig()
    squeeze = [
        Obstacle(distance_m=1.0, ned_direction=(s, 0.0, 0.0), ned_v_m_s=(-0.3 * s, 0.0, 0.0)) for s in (1.0, -1.0)
    ]
    assert limit((0.0, 1.0, 0.0), of_obstacles(squeeze), config).ned_v_m_s == pytest.approx((0.0, 1.0, 0.0), abs=1e-6)


def test_what_comes_nearer_is_given_way_to_and_only_as_far_as_allowed():
    walker = of_obstacles([Obstacle(distance_m=1.2, ned_direction=(1.0, 0.0, 0.0), ned_v_m_s=(-1.0, 0.0, 0.0))])
    limited = limit((0.0, 0.0, 0.0), walker, LimiterConfig())
    assert limited.ned_v_m_s == pytest.approx((-0.5, 0.0, 0.0), abs=0.02) and limited.why == "push-back"
    assert limit((0.0, 0.0, 0.0), walker, LimiterConfig(push_back_m_s=0.0)).ned_v_m_s == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("place_m", [(3.36, 2.33), (2.79, 2.01), (2.26, 1.72)])
def test_who_comes_slantwise_is_given_way_to_across_his_way_and_not_along_it(place_m: tuple[float, float]):
    """Three moments of an encounter in which the vehicle once slid along until it was caught up with."""
    place, walk, size = np.array(place_m), np.array([-0.58, -0.62]), math.hypot(*place_m)
    direction = (place_m[0] / size, place_m[1] / size, 0.0)
    walker = of_obstacles([Obstacle(distance_m=size, ned_direction=direction, ned_v_m_s=(-0.58, -0.62, 0.0))])
    passing = place - (place @ walk) / (walk @ walk) * walk
    assert 0.4 < np.linalg.norm(passing) < 0.9, "he would pass too near, and on this side"
    v = np.array(limit((0.5, 0.0, 0.0), walker, LimiterConfig()).ned_v_m_s[:2])
    assert v @ passing / np.linalg.norm(passing) < -0.2


def test_without_push_back_a_vehicle_brakes_while_it_closes_in_and_never_backs_away():
    config = LimiterConfig(push_back_m_s=0.0)
    wall = of_obstacles([Obstacle(distance_m=1.3, ned_direction=(1.0, 0.0, 0.0))])

    def north(flown_m_s: float, asked_m_s: float = 2.0, at: Surroundings = wall) -> float:
        return limit((asked_m_s, 0.0, 0.0), at, config, ned_vehicle_v_m_s=(flown_m_s, 0.0, 0.0)).ned_v_m_s[0]

    assert -2.5 <= north(0.6) < -0.3
    assert north(0.0) == north(-0.3) == 0.0
    drifted = of_obstacles([Obstacle(distance_m=0.95, ned_direction=(1.0, 0.0, 0.0))])
    assert north(0.0, at=drifted) == pytest.approx(-0.05, rel=0.05), "back to h_min and the margin, slowly"
    assert -0.01 <= north(0.0, 0.02, at=drifted) < -0.005
    assert north(0.0, 0.0, at=drifted) == 0.0, "only against a stick that pushes in"


def test_a_stick_held_at_a_wall_without_push_back_never_leads_within_h_min():
    """With PX4's default drag, whose velocity loop holds on to what it has learnt, and an estimate that errs."""
    config = LimiterConfig(push_back_m_s=0.0)
    flight = fly(Simulated(1.0, 207), config, 2.1, 32.0, 207, start_m=16.0)
    assert flight.speed_m_s.max() > 1.5
    assert flight.distance_m.min() >= config.h_min_m
    assert flight.distance_m[-1] <= config.h_desired_m
