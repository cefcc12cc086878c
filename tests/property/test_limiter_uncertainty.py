"""What the limiter promises about obstacles that may be elsewhere than they should be."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from onboard.limiter.carried import averaged, keep_s, unsure_m
from onboard.limiter.config import LimiterConfig
from onboard.limiter.constraints import Motion, nearest_ahead, obstacle_rows, plain_rows
from onboard.limiter.law import stoppable
from onboard.limiter.limiter import limit
from onboard.limiter.surroundings import Surroundings

_CONFIG = st.sampled_from(
    [*(LimiterConfig(strategy=s) for s in ("proposed", "tti", "dpf")), LimiterConfig(push_back_m_s=0.0)]
)
_VELOCITY = st.tuples(*[st.floats(-3.0, 3.0)] * 3)
_WALK = st.tuples(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5), st.just(0.0))
_FAST = settings(max_examples=max(100, settings().max_examples))
"""As many as the profile says, where it says more."""
_STILL = np.zeros(3)


@st.composite
def _around(draw) -> Surroundings:
    """Up to four obstacles, each uncertain by up to 6 m."""
    count = draw(st.integers(1, 4))
    angles = np.array(draw(st.lists(st.floats(-math.pi, math.pi), min_size=count, max_size=count)))
    h = draw(st.lists(st.floats(0.0, 10.0), min_size=count, max_size=count))
    unsure = draw(st.lists(st.one_of(st.just(0.0), st.floats(0.0, 6.0)), min_size=count, max_size=count))
    walks = draw(st.lists(st.one_of(st.just((0.0, 0.0, 0.0)), _WALK), min_size=count, max_size=count))
    units = np.stack([np.cos(angles), np.sin(angles), np.zeros(count)], axis=-1)
    return Surroundings(np.array(h), units, np.array(walks), unsure_m=np.array(unsure))


def _unsure(around: Surroundings) -> np.ndarray:
    assert around.unsure_m is not None
    return around.unsure_m


@given(_around(), st.lists(_VELOCITY, min_size=4, max_size=4), _CONFIG)
@_FAST
def test_the_compiled_half_spaces_are_those_of_the_law_as_it_is_written(around, velocities, config):
    arguments = (around.distance_m, around.ned_direction, around.ned_v_m_s, Motion(*np.array(velocities)), config)
    rows, plain = obstacle_rows(*arguments, around.unsure_m), plain_rows(*arguments, around.unsure_m)
    for one, other in zip(rows, plain, strict=True):
        assert one.shape == other.shape and np.allclose(one, other, rtol=0.0, atol=1e-9)


@given(_around(), _VELOCITY, st.floats(0.0, 2.0), _CONFIG)
@_FAST
def test_who_knows_less_may_do_less(around, asked, more, config):
    """No bound rises with the uncertainty, and none changes by more than the steepest curve, 60 m/s per metre, and the
    stop, which is steepest where no room is left (1/stop_delay_s)."""
    motion = Motion(np.array(asked), np.array(asked), _STILL, _STILL)
    arguments = (around.distance_m, around.ned_direction, around.ned_v_m_s, motion, config)
    surer, less_sure = obstacle_rows(*arguments, _unsure(around)), obstacle_rows(*arguments, _unsure(around) + more)
    fallen = surer.bounds_m_s - less_sure.bounds_m_s
    assert (fallen >= -1e-9).all() and (fallen <= 60.0 * more + 1e-9).all()
    assert (surer.normals == less_sure.normals).all(), "the way to go round stays the same"


@given(_around(), _VELOCITY, _VELOCITY, _CONFIG)
@_FAST
def test_it_keeps_the_bound_to_wherever_they_may_be(around, asked, flown, config):
    v = np.array(limit(asked, around, config, ned_vehicle_v_m_s=flown).ned_v_m_s)
    ahead_m, normals = nearest_ahead(around.distance_m, around.ned_direction, around.ned_v_m_s, config)
    free = stoppable(ahead_m - _unsure(around) - config.h_min_m - config.margin_m, config)
    assert (normals @ v <= free + 1e-6).all()


@given(st.floats(1.2, 4.0), st.floats(-0.7, 0.7), st.floats(0.6, 1.5), st.floats(0.0, 3.0))
@_FAST
def test_whoever_may_be_anywhere_is_still_given_way_to_across_their_path(distance, aside, pace, more):
    """A walker who comes from the east and would pass north or south of a vehicle that stands: it backs away from the
    side where the path passes, also where the walker may already be beyond it."""
    place = np.array([aside, distance, 0.0])
    h = float(np.linalg.norm(place))
    walker = Surroundings(
        np.array([h]), (place / h)[None], np.array([[0.0, -pace, 0.0]]), unsure_m=np.array([h + more])
    )
    config = LimiterConfig()
    v = np.array(limit((0.0, 0.0, 0.0), walker, config).ned_v_m_s)
    _, normal = nearest_ahead(walker.distance_m, walker.ned_direction, walker.ned_v_m_s, config)
    assert normal[0] @ v < 0.0 and v[0] * aside <= 1e-9


@given(st.lists(_WALK, min_size=1, max_size=30), st.floats(0.02, 1.0))
@_FAST
def test_the_mean_lies_between_what_was_measured_and_is_worth_its_last_second(walks, dt_s):
    mean, worth = np.zeros((1, 3)), np.zeros(1)
    for walk in walks:
        mean, worth = averaged(mean, worth, np.array([walk]), dt_s)
    low, high = np.min(walks, axis=0), np.max(walks, axis=0)
    assert (mean[0] >= low - 1e-9).all() and (mean[0] <= high + 1e-9).all()
    assert 1.0 <= worth[0] <= min(len(walks), 1.0 / (1.0 - math.exp(-dt_s))) + 1e-9


@given(st.floats(0.0, 20.0), st.floats(0.0, 5.0), st.floats(1.0, 10.0))
@_FAST
def test_the_longer_ago_and_the_rarer_it_was_seen_the_less_is_sure(age_s, longer_s, samples):
    config = LimiterConfig()
    ages, few, many = np.array([age_s, age_s + longer_s]), np.ones(2), np.full(2, samples)
    unsure = unsure_m(ages, few, config)
    assert unsure[0] <= unsure[1] and (unsure_m(ages, many, config) <= unsure).all()
    assert (unsure_m(np.array([config.stale_s]), np.ones(1), config) == 0.0).all()
    walking, near = np.array([[1.0, 0.0, 0.0]]), np.array([config.h_max_m - age_s])
    assert keep_s(walking, near, config, True) == config.remember_s
    assert keep_s(walking, near + age_s + 1e-3, config, True) == keep_s(walking, near, config, False) == config.keep_s
