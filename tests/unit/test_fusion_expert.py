"""Below the fusion centre, against closed forms: weights, the filter, experts, drift."""

from __future__ import annotations

import math

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from scipy.stats import chi2

from onboard.fusion.config import FusionConfig
from onboard.fusion.drift import DriftWatch
from onboard.fusion.expert import Expert
from onboard.fusion.motion import MotionFilter
from onboard.fusion.weights import (
    combine,
    mahalanobis,
    outlier_switch,
    outlier_weight,
    separations,
    severity,
    vote_weight,
)
from tests.unit.fusion_rig import PERIOD_NS, control_matrix, line, process_noise, sources, standard, transition

DENSITY = np.ones(2)


def test_outlier_weight_switches_at_zeta_over_eta() -> None:
    """Eq. 4.4: one half at M = ζ/η, nothing far below, one far above, also where exp would overflow."""
    assert outlier_weight(10.0, 1.0, 10.0) == 0.5
    assert outlier_weight(400.0 / 0.01, 0.01, 400.0) == 0.5
    assert outlier_weight(0.0, 1.0, 40.0) < 1e-15
    assert outlier_weight(1e9, 1.0, 10.0) == pytest.approx(1.0)
    assert 0.0 <= outlier_weight(0.0, 1.0, 1e6) < 1e-300


def test_switch_follows_chi_square_and_is_the_thesis_figure_for_boxes() -> None:
    assert outlier_switch(4, 0.9999) == pytest.approx(10.0, abs=0.4)
    assert outlier_switch(1, 0.99) == pytest.approx(math.sqrt(chi2.ppf(0.99, 1)))


def test_approximated_distance_lies_between_the_true_one_and_root_n_of_it() -> None:
    innovation, variance = np.array([1.0, -2.0, 0.5, 3.0]), np.array([1.0, 4.0, 0.25, 2.0])
    true = math.sqrt(float((innovation**2 / variance).sum()))
    assert true <= mahalanobis(innovation, variance) <= 2.0 * true
    assert mahalanobis(np.array([3.0]), np.array([4.0])) == 1.5


def test_vote_weight_at_its_extremes() -> None:
    """Eq. 4.7 with the thesis's figures for TLD: ω₀ at home, ω₀ + ω at λ/η, ω₀ + 2 ω far off."""
    assert vote_weight(0.0, 10.0, 500.0, 0.1, 10.0) == pytest.approx(10.0, abs=1e-4)
    assert vote_weight(100.0, 10.0, 500.0, 0.1, 10.0) == 510.0
    assert vote_weight(1e6, 10.0, 500.0, 0.1, 10.0) == 1010.0


def test_separations_of_three_points_and_two_voters() -> None:
    points = np.array([[0.0, 0.0], [0.0, 1.0], [4.0, 0.0]])
    assert separations(points, points[:2]).tolist() == [[0.0, 1.0], [1.0, 0.0], [4.0, pytest.approx(math.sqrt(17.0))]]


def test_a_filter_at_uneven_stamps_is_the_textbook_one_and_filterpys_to_rounding() -> None:
    rng, t_ns = np.random.default_rng(3), 0
    ours = MotionFilter(np.zeros(3), 0, np.full(3, 0.1), np.full(3, 2.0))
    state, covariance = ours.state.copy(), ours.covariance.copy()
    plain = KalmanFilter(dim_x=6, dim_z=3)
    plain.x, plain.P, plain.H = state.reshape(-1, 1).copy(), covariance.copy(), np.eye(3, 6)
    h, density = np.eye(3, 6), np.array([1.0, 4.0, 9.0])
    for _ in range(20):
        dt_ns, value, variance = int(rng.integers(1, 10**8)), rng.normal(size=3), rng.uniform(0.01, 1.0, 3)
        known = rng.normal(size=3)
        ours.predict(t_ns := t_ns + dt_ns, density, known)
        ours.update(value, variance)
        a, q, b = transition(3, dt_ns * 1e-9), process_noise(density, dt_ns * 1e-9), control_matrix(3, dt_ns * 1e-9)
        plain.predict(F=a, Q=q, B=b, u=known.reshape(-1, 1))
        plain.update(value.reshape(-1, 1), R=np.diag(variance))
        state, covariance = a @ state + b @ known, a @ covariance @ a.T + q
        gain = covariance @ h.T @ np.linalg.inv(h @ covariance @ h.T + np.diag(variance))
        state, covariance = state + gain @ (value - h @ state), (np.eye(6) - gain @ h) @ covariance
    for x, p in ((state, covariance), (plain.x[:, 0], plain.P)):
        np.testing.assert_allclose(ours.state, x, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(ours.covariance, p, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(("correlation", "expected"), [(0.0, 0.25), (1.0, 1.0), (0.5, 0.625)])
def test_variance_of_equal_sources(correlation: float, expected: float) -> None:
    mean, variance = combine(np.array([[1.0], [2.0], [3.0], [4.0]]), np.ones((4, 1)), correlation)
    assert mean[0] == 2.5
    assert variance[0] == pytest.approx(expected)


def test_severity_begins_at_the_switch() -> None:
    assert severity(0.3) == severity(1.0) == 1.0
    assert severity(2.0) == 16.0
    assert math.isfinite(severity(math.inf))


def test_two_short_steps_add_what_one_long_step_adds() -> None:
    density, stamps = np.array([2.0, 0.5]), ((500_000_000,), (200_000_000, 500_000_000))
    filters = [MotionFilter(np.zeros(2), 0, np.full(2, 0.1), np.full(2, 2.0)) for _ in stamps]
    for one, path in zip(filters, stamps, strict=True):
        for t_ns in path:
            one.predict(t_ns, density)
    np.testing.assert_allclose(filters[1].covariance, filters[0].covariance, rtol=1e-12)
    np.testing.assert_allclose(filters[1].state, filters[0].state, rtol=1e-12)


def test_commanded_acceleration_moves_the_prediction() -> None:
    """B·u of eq. 3.4 in real time: x = ½ a t², rate a t."""
    moving = MotionFilter(np.array([1.0]), 0, np.array([0.1]), np.array([0.0]))
    moving.predict(500_000_000, np.array([1.0]), np.array([4.0]))
    assert moving.state == pytest.approx([1.5, 2.0])


def test_expert_without_outliers_is_the_standard_kalman_filter() -> None:
    config = FusionConfig(acceleration=1.0, delta=0.0)
    expert, values = Expert(sources(1)[0], config), line(60)
    for index, value in enumerate(values):
        expert.hear(value, index * PERIOD_NS, 1.0, np.ones(2), DENSITY)
    assert expert.filter is not None
    np.testing.assert_allclose(expert.filter.state, standard(values, 0.1, config), atol=1e-9)


def test_expert_holds_at_a_spike_and_follows_a_real_jump() -> None:
    expert, values = Expert(sources(1)[0], FusionConfig(acceleration=1.0)), line(40)
    for index, value in enumerate(values):
        expert.hear(value, index * PERIOD_NS, 1.0, np.ones(2), DENSITY)
    assert expert.filter is not None
    before = expert.filter.value.copy()
    opinion = expert.hear(values[-1] + 5.0, 40 * PERIOD_NS, 1.0, np.ones(2), DENSITY)
    assert opinion.weight > 0.99
    assert np.abs(expert.filter.value - before).max() < 0.1
    for index in range(41, 140):
        expert.hear(np.array([7.0, 6.0]), index * PERIOD_NS, 1.0, np.ones(2), DENSITY)
    np.testing.assert_allclose(expert.filter.value, [7.0, 6.0], atol=0.3)


def test_low_confidence_raises_delta() -> None:
    """The thesis: 10 to 10,000 below the threshold; the filter of a lost tracker has followed it, so M says nothing."""
    config = FusionConfig(delta=10.0)
    expert = Expert(sources(1, threshold=0.5)[0], config)
    sure = expert.hear(np.zeros(2), 0, 0.9, np.ones(2), DENSITY)
    unsure = expert.hear(np.zeros(2), PERIOD_NS, 0.4, np.ones(2), DENSITY)
    assert sure.mahalanobis == unsure.mahalanobis == 0.0
    assert sure.penalty < 1e-3
    assert unsure.penalty == 0.5 * 10_000.0 / 10.0


def test_drift_has_hysteresis() -> None:
    config = FusionConfig(drift_enter=1.0, drift_leave=0.5, drift_after_s=0.2, restart_every_s=1.0)
    watch = DriftWatch(config)
    distances = [0.9, 1.1, 0.8, 0.8, 0.8, 0.8, 0.8, 0.4, 0.9, 0.9]
    asked = [watch.look(d, 2.0, k * 100_000_000) for k, d in enumerate(distances)]
    assert asked == [False, False, False, True] + [False] * 6
    assert not watch.drifted
    assert not DriftWatch(config).look(9.0, 0.0, 0), "nobody vouches for the fused answer"
