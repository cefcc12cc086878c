"""The fusion core against closed forms: weights, experts, vote, fusion centre, restarts."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import chi2

from common.config import ConfigError, build
from onboard.fusion.center import Fused, Fusion
from onboard.fusion.config import FusionConfig
from onboard.fusion.drift import DriftWatch
from onboard.fusion.expert import Expert
from onboard.fusion.motion import MotionFilter, process_noise, transition
from onboard.fusion.source import Measurement, Source
from onboard.fusion.weights import (
    combine,
    mahalanobis,
    outlier_switch,
    outlier_weight,
    separations,
    severity,
    vote_weight,
)

PERIOD_NS = 50_000_000


def _line(count: int, seed: int = 0, noise: float = 0.1) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    return [np.array([k * 0.05, 1.0 - k * 0.02]) + rng.normal(0.0, noise, 2) for k in range(count)]


def _standard(values: list[np.ndarray], noise: float, config: FusionConfig) -> np.ndarray:
    """State of a textbook Kalman filter, written out, after these measurements."""
    size, dt_s = len(values[0]), PERIOD_NS * 1e-9
    a, h = np.eye(2 * size), np.eye(size, 2 * size)
    a[:size, size:] = dt_s * np.eye(size)
    q = config.acceleration**2 * np.block(
        [[dt_s**3 / 3 * np.eye(size), dt_s**2 / 2 * np.eye(size)], [dt_s**2 / 2 * np.eye(size), dt_s * np.eye(size)]]
    )
    x = np.concatenate([values[0], np.zeros(size)])
    p = np.diag([noise**2] * size + [config.start_rate**2] * size)
    for value in values[1:]:
        x, p = a @ x, a @ p @ a.T + q
        gain = p @ h.T @ np.linalg.inv(h @ p @ h.T + noise**2 * np.eye(size))
        x, p = x + gain @ (value - h @ x), (np.eye(2 * size) - gain @ h) @ p
        p = (p + p.T) / 2
    return x


def _run(fusion: Fusion, rows: list[dict[str, object]], begin: int = 0) -> Fused:
    """Fuse rows of source to value (an array, None for lost, or (value, confidence)), one a period."""
    fused = None
    for index, row in enumerate(rows, begin):
        t_ns = index * PERIOD_NS
        measured = []
        for name, said in row.items():
            value, confidence = said if isinstance(said, tuple) else (said, 1.0)
            measured.append(Measurement(name, t_ns, value, confidence))  # pyright: ignore[reportArgumentType]
        fused = fusion.step(measured, t_ns)
    assert fused is not None
    return fused


def _sources(count: int, noise: float = 0.1, size: int = 2, threshold: float = 0.0) -> list[Source]:
    return [Source(f"s{i}", (noise,) * size, threshold) for i in range(count)]


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


def test_a_filter_at_uneven_stamps_is_the_textbook_one_to_rounding() -> None:
    rng, t_ns = np.random.default_rng(3), 0
    ours = MotionFilter(np.zeros(3), 0, np.full(3, 0.1), np.full(3, 2.0))
    state, covariance = ours.state.copy(), ours.covariance.copy()
    h, density = np.eye(3, 6), np.array([1.0, 4.0, 9.0])
    for _ in range(20):
        dt_ns, value, variance = int(rng.integers(1, 10**8)), rng.normal(size=3), rng.uniform(0.01, 1.0, 3)
        ours.predict(t_ns := t_ns + dt_ns, density)
        ours.update(value, variance)
        a = transition(3, dt_ns * 1e-9)
        state, covariance = a @ state, a @ covariance @ a.T + process_noise(density, dt_ns * 1e-9)
        gain = covariance @ h.T @ np.linalg.inv(h @ covariance @ h.T + np.diag(variance))
        state, covariance = state + gain @ (value - h @ state), (np.eye(6) - gain @ h) @ covariance
    np.testing.assert_allclose(ours.state, state, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(ours.covariance, covariance, rtol=1e-9, atol=1e-12)


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
    density = np.array([2.0, 0.5])
    twice = transition(2, 0.3) @ process_noise(density, 0.2) @ transition(2, 0.3).T + process_noise(density, 0.3)
    np.testing.assert_allclose(twice, process_noise(density, 0.5), rtol=1e-12)


def test_commanded_acceleration_moves_the_prediction() -> None:
    """B·u of eq. 3.4 in real time: x = ½ a t², rate a t."""
    moving = MotionFilter(np.array([1.0]), 0, np.array([0.1]), np.array([0.0]))
    moving.predict(500_000_000, np.array([1.0]), np.array([4.0]))
    assert moving.state == pytest.approx([1.5, 2.0])


def test_expert_without_outliers_is_the_standard_kalman_filter() -> None:
    config = FusionConfig(acceleration=1.0, delta=0.0)
    expert, values = Expert(_sources(1)[0], config), _line(60)
    for index, value in enumerate(values):
        expert.hear(value, index * PERIOD_NS, 1.0, np.ones(2))
    assert expert.filter is not None
    np.testing.assert_allclose(expert.filter.state, _standard(values, 0.1, config), atol=1e-9)


def test_expert_holds_at_a_spike_and_follows_a_real_jump() -> None:
    expert, values = Expert(_sources(1)[0], FusionConfig(acceleration=1.0)), _line(40)
    for index, value in enumerate(values):
        expert.hear(value, index * PERIOD_NS, 1.0, np.ones(2))
    assert expert.filter is not None
    before = expert.filter.value.copy()
    opinion = expert.hear(values[-1] + 5.0, 40 * PERIOD_NS, 1.0, np.ones(2))
    assert opinion.weight > 0.99
    assert np.abs(expert.filter.value - before).max() < 0.1
    for index in range(41, 140):
        expert.hear(np.array([7.0, 6.0]), index * PERIOD_NS, 1.0, np.ones(2))
    np.testing.assert_allclose(expert.filter.value, [7.0, 6.0], atol=0.3)


def test_low_confidence_raises_delta() -> None:
    """The thesis: 10 to 10,000 below the threshold; the filter of a lost tracker has followed it, so M says nothing."""
    config = FusionConfig(delta=10.0)
    expert = Expert(_sources(1, threshold=0.5)[0], config)
    sure = expert.hear(np.zeros(2), 0, 0.9, np.ones(2))
    unsure = expert.hear(np.zeros(2), PERIOD_NS, 0.4, np.ones(2))
    assert sure.mahalanobis == unsure.mahalanobis == 0.0
    assert sure.penalty < 1e-3
    assert unsure.penalty == 0.5 * 10_000.0 / 10.0


def test_fusion_without_penalties_is_the_filter_over_all_sources() -> None:
    """Three independent sources of equal noise are one of a third of the variance."""
    config = FusionConfig(acceleration=1.0, correlation=0.0, omega=0.0, delta=0.0)
    streams = [_line(50, seed) for seed in (1, 2, 3)]
    fused = _run(Fusion(_sources(3), config), [{f"s{i}": s[k] for i, s in enumerate(streams)} for k in range(50)])
    mean = [np.mean(row, axis=0) for row in zip(*streams, strict=True)]
    np.testing.assert_allclose(
        np.concatenate([fused.value, fused.rate]), _standard(mean, 0.1 / math.sqrt(3), config), atol=1e-9
    )


def test_identical_sources_give_the_answer_of_one() -> None:
    config = FusionConfig(correlation=1.0, vote_slope=60.0, vote_lambda=20.0)
    values = _line(50)
    one = _run(Fusion(_sources(1), config), [{"s0": v} for v in values])
    three = _run(Fusion(_sources(3), config), [{f"s{i}": v for i in range(3)} for v in values])
    np.testing.assert_allclose(three.value, one.value, atol=1e-9)
    np.testing.assert_allclose(three.covariance, one.covariance, atol=1e-9)


def test_majority_outvotes_a_drifting_source_which_is_then_to_be_started_anew() -> None:
    fusion, asked = Fusion(_sources(3, 0.02), FusionConfig(restart_every_s=10.0)), []
    for k in range(100):
        drift = np.array([max(0.0, 0.04 * (k - 20)), 0.0])
        rows = {"s0": np.zeros(2), "s1": np.zeros(2), "s2": drift}
        fused = _run(fusion, [rows], k)
        asked += [(k, name) for name in fused.restart]
    assert np.abs(fused.value).max() < 0.02
    assert fused.sources["s2"].reliability < 1e-3
    assert fused.sources["s0"].reliability > 0.9
    assert fused.confidence > 0.85
    assert [name for _, name in asked] == ["s2"], "once, then not again for ten seconds"
    assert 33 <= asked[0][0] <= 55, "half a second beyond half a unit"


def test_of_two_that_disagree_the_one_that_fits_the_past_is_believed() -> None:
    fusion = Fusion(_sources(2, 0.05), FusionConfig())
    steady = _run(fusion, [{"s0": np.zeros(2), "s1": np.zeros(2)}] * 40)
    assert steady.state == "tracking"
    fused = _run(fusion, [{"s0": np.zeros(2), "s1": np.array([3.0, 0.0])}] * 40, 40)
    assert np.abs(fused.value).max() < 0.05
    assert fused.sources["s1"].reliability < 1e-3 < fused.sources["s0"].reliability


def test_a_jump_that_two_see_alike_is_followed_at_once_and_one_that_one_sees_is_not() -> None:
    still, away = np.zeros(2), np.array([6.0, -4.0])
    quiet: list[dict[str, object]] = [{"s0": still, "s1": still, "s2": still}] * 20
    for seen, expected in ((("s0", "s1"), away), (("s0",), still)):
        fusion = Fusion(_sources(3), FusionConfig(common_jumps=True))
        _run(fusion, quiet)
        rows: list[dict[str, object]] = [{n: away if n in seen else still for n in ("s0", "s1", "s2")}]
        answer = _run(fusion, rows, 20)
        np.testing.assert_allclose(answer.value, expected, atol=0.1)
        assert answer.state == "tracking"


def test_one_left_is_believed_and_none_left_is_predicted_then_lost_then_found_again() -> None:
    fusion = Fusion(_sources(2, 0.05), FusionConfig(predict_for_s=1.0))
    _run(fusion, [{"s0": np.array([0.05 * k, 0.0]), "s1": np.array([0.05 * k, 0.0])} for k in range(40)])
    alone = _run(fusion, [{"s0": np.array([0.05 * k, 0.0]), "s1": None} for k in range(40, 60)], 40)
    assert alone.state == "tracking"
    assert alone.value[0] == pytest.approx(0.05 * 59, abs=0.05)
    states = [_run(fusion, [{"s0": None, "s1": None}], k) for k in range(60, 90)]
    assert [s.state for s in states[:20]] == ["predicted"] * 20
    assert states[-1].state == "lost"
    assert states[19].value[0] == pytest.approx(0.05 * 79, abs=0.3), "predicted on with its rate"
    assert states[19].confidence < 0.2 < alone.confidence
    found = _run(fusion, [{"s0": np.array([9.0, 9.0]), "s1": None}] * 20, 90)
    assert found.state == "tracking"
    np.testing.assert_allclose(found.value, [9.0, 9.0], atol=0.1)


def test_all_unsure_is_not_seen() -> None:
    fusion = Fusion(_sources(2, 0.05, threshold=0.5), FusionConfig(predict_for_s=0.5))
    _run(fusion, [{"s0": np.zeros(2), "s1": np.zeros(2)}] * 20)
    states = [_run(fusion, [{"s0": (np.ones(2), 0.1), "s1": (np.ones(2), 0.2)}], k).state for k in range(20, 40)]
    assert states[0] == "predicted"
    assert states[-1] == "lost"


def test_late_measurement_counts_at_its_capture_time() -> None:
    """A source whose results come 200 ms late pulls a moving target's estimate by nothing."""
    fusion = Fusion(_sources(2, 0.02), FusionConfig())
    for k in range(100):
        t_ns, late_ns = k * PERIOD_NS, (k - 4) * PERIOD_NS
        said = [Measurement("s0", t_ns, np.array([0.1 * k, 0.0]))]
        if k >= 4:
            said.append(Measurement("s1", late_ns, np.array([0.1 * (k - 4), 0.0])))
        fused = fusion.step(said, t_ns)
    assert fused.value[0] == pytest.approx(9.9, abs=0.02)
    assert fused.sources["s1"].reliability > 0.5
    fusion.step([Measurement("s1", 0, np.zeros(2))], 100 * PERIOD_NS)
    assert fusion.outdated == 1


def test_silent_source_has_no_vote_and_a_step_without_news_predicts() -> None:
    fusion = Fusion(_sources(3, 0.05), FusionConfig())
    _run(fusion, [{f"s{i}": np.zeros(2) for i in range(3)}] * 20)
    later = fusion.step([Measurement("s0", 40 * PERIOD_NS, np.zeros(2))], 40 * PERIOD_NS)
    assert later.sources["s0"].distance == math.inf
    between = fusion.step([], 41 * PERIOD_NS)
    assert between.state == "tracking"
    assert between.t_ns == 41 * PERIOD_NS
    assert between.covariance[0, 0] > later.covariance[0, 0]


def test_nothing_measured_yet() -> None:
    fused = Fusion(_sources(2), FusionConfig()).step([], 0)
    assert fused.state == "waiting"
    assert np.isnan(fused.value).all()


def test_drift_has_hysteresis() -> None:
    config = FusionConfig(drift_enter=1.0, drift_leave=0.5, drift_after_s=0.2, restart_every_s=1.0)
    watch = DriftWatch(config)
    distances = [0.9, 1.1, 0.8, 0.8, 0.8, 0.8, 0.8, 0.4, 0.9, 0.9]
    asked = [watch.look(d, 2.0, k * 100_000_000) for k, d in enumerate(distances)]
    assert asked == [False, False, False, True] + [False] * 6
    assert not watch.drifted
    assert not DriftWatch(config).look(9.0, 0.0, 0), "nobody vouches for the fused answer"


@pytest.mark.parametrize(
    ("measurement", "words"),
    [
        (Measurement("x", 0, np.zeros(2)), "expected each at most once"),
        (Measurement("s0", 0, np.zeros(3)), "expected 2 finite numbers"),
        (Measurement("s0", 0, np.array([1.0, math.nan])), "expected 2 finite numbers"),
        (Measurement("s0", 9, np.zeros(2)), "the present"),
        (Measurement("s0", 0, np.zeros(2), math.nan), "confidence nan"),
    ],
)
def test_bad_measurement_changes_nothing(measurement: Measurement, words: str) -> None:
    fusion = Fusion(_sources(2), FusionConfig())
    with pytest.raises(ValueError, match=words):
        fusion.step([measurement], 0)
    assert fusion.step([], 0).state == "waiting"


def test_bad_sources_and_settings() -> None:
    for sources in ([], _sources(1) + _sources(1), [*_sources(1), Source("x", (1.0,))]):
        with pytest.raises(ValueError, match="fusion: got sources"):
            Fusion(sources, FusionConfig())
    with pytest.raises(ValueError, match="positive standard deviations"):
        Source("x", (0.0,))
    with pytest.raises(ConfigError, match="drift_leave"):
        build(FusionConfig, {"drift_leave": 2.0}, "fusion")
    fusion = Fusion(_sources(1), FusionConfig())
    fusion.step([], 10)
    with pytest.raises(ValueError, match="at least the last instant"):
        fusion.step([], 9)
