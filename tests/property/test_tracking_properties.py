"""What the particle filter's steps and the histograms' distance promise for all numbers."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from common.track_tool import upright_box
from common.tracking.base import TrackResult
from common.tracking.colour import bhattacharyya_coefficient, bhattacharyya_distance
from common.tracking.histogram import PSI
from common.tracking.particles import expected_state, likelihood_weights, systematic_resample

_DISTANCES = arrays(float, st.integers(1, 60), elements=st.floats(0.0, 1.0))
_SEEDS = st.integers(0, 2**32 - 1)


def _histogram(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    counts = rng.random(512) * (rng.random(512) < 0.1) + 1e-9
    return counts / counts.sum()


@given(_DISTANCES, st.floats(0.1, 500.0))
def test_weights_sum_to_one_and_fall_with_the_distance(distances: np.ndarray, sharpness: float) -> None:
    weights = likelihood_weights(distances, sharpness)

    assert math.isclose(weights.sum(), 1.0, rel_tol=1e-9)
    assert (weights >= 0.0).all()
    assert (np.diff(weights[np.argsort(distances)]) <= 1e-15).all()


@given(_DISTANCES, st.floats(0.0, 1.0, exclude_max=True))
def test_each_particle_is_drawn_as_often_as_its_weight_says(distances: np.ndarray, start: float) -> None:
    weights = likelihood_weights(distances, 20.0)
    drawn = np.bincount(systematic_resample(weights, start), minlength=len(weights))

    assert drawn.sum() == len(weights)
    assert (np.abs(drawn - len(weights) * weights) < 1.0 + 1e-9).all()


@given(_DISTANCES, _SEEDS)
def test_the_order_of_the_particles_changes_nothing(distances: np.ndarray, seed: int) -> None:
    rng = np.random.default_rng(seed)
    states = rng.normal(size=(len(distances), 4)) * [100.0, 100.0, 1.0, 0.01]
    order = rng.permutation(len(distances))
    weights = likelihood_weights(distances, 20.0)
    mean, spread = expected_state(states, weights)
    other, other_spread = expected_state(states[order], likelihood_weights(distances[order], 20.0))

    np.testing.assert_allclose(likelihood_weights(distances[order], 20.0), weights[order], rtol=1e-9)
    np.testing.assert_allclose(other, mean, rtol=1e-6, atol=1e-6)
    assert math.isclose(spread, other_spread, abs_tol=1e-5)


@given(st.floats(-math.pi, math.pi), _DISTANCES, _SEEDS)
def test_the_mean_angle_turns_with_the_particles(turn_rad: float, distances: np.ndarray, seed: int) -> None:
    states = np.random.default_rng(seed).normal(size=(len(distances), 4)) * [1.0, 1.0, 0.5, 0.01]
    weights = likelihood_weights(distances, 20.0)
    mean, _ = expected_state(states, weights)
    states[:, PSI] += turn_rad
    turned, _ = expected_state(states, weights)

    assert abs(math.remainder(turned[PSI] - mean[PSI] - turn_rad, 2 * math.pi)) < 1e-6


@given(_SEEDS, _SEEDS)
def test_distance_is_symmetric_bounded_and_zero_for_equals(one: int, two: int) -> None:
    a, b = _histogram(one), _histogram(two)

    assert 0.0 <= bhattacharyya_distance(a, b) <= 1.0
    assert math.isclose(bhattacharyya_distance(a, b), bhattacharyya_distance(b, a), abs_tol=1e-12)
    assert bhattacharyya_distance(a, a) < 1e-6
    assert bhattacharyya_coefficient(a, b) <= 1.0 + 1e-12


@given(st.floats(-4.0, 4.0), st.floats(5.0, 200.0), st.floats(5.0, 200.0))
def test_upright_box_lies_within_the_corners_and_turns_by_quarters(angle: float, width: float, height: float) -> None:
    result = TrackResult((10.0, 20.0), (width, height), angle, 1.0, 0.0, "tracking", 0.0)
    x, y, across, down = upright_box(result)
    low, high = result.corners_px().min(axis=0), result.corners_px().max(axis=0)

    assert low[0] - 1e-6 <= x and x + across <= high[0] + 1e-6
    assert low[1] - 1e-6 <= y and y + down <= high[1] + 1e-6
    turned = TrackResult((10.0, 20.0), (height, width), angle + math.pi / 2, 1.0, 0.0, "tracking", 0.0)
    np.testing.assert_allclose(upright_box(turned), (x, y, across, down), atol=1e-6)
