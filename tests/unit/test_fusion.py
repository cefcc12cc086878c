"""The fusion centre against closed forms: one filter over all, vote, loss, late and bad measurements."""

from __future__ import annotations

import math

import numpy as np
import pytest

from common.config import ConfigError, build
from onboard.fusion.center import Fused, Fusion
from onboard.fusion.config import FusionConfig
from onboard.fusion.source import Measurement, Source
from tests.unit.fusion_rig import PERIOD_NS, line, sources, standard


def run(fusion: Fusion, rows: list[dict[str, object]], begin: int = 0) -> Fused:
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


def test_fusion_without_penalties_is_the_filter_over_all_sources() -> None:
    """Three independent sources of equal noise are one of a third of the variance."""
    config = FusionConfig(acceleration=1.0, correlation=0.0, omega=0.0, delta=0.0)
    streams = [line(50, seed) for seed in (1, 2, 3)]
    fused = run(Fusion(sources(3), config), [{f"s{i}": s[k] for i, s in enumerate(streams)} for k in range(50)])
    mean = [np.mean(row, axis=0) for row in zip(*streams, strict=True)]
    np.testing.assert_allclose(
        np.concatenate([fused.value, fused.rate]), standard(mean, 0.1 / math.sqrt(3), config), atol=1e-9
    )


def test_identical_sources_give_the_answer_of_one() -> None:
    config = FusionConfig(correlation=1.0, vote_slope=60.0, vote_lambda=20.0)
    values = line(50)
    one = run(Fusion(sources(1), config), [{"s0": v} for v in values])
    three = run(Fusion(sources(3), config), [{f"s{i}": v for i in range(3)} for v in values])
    np.testing.assert_allclose(three.value, one.value, atol=1e-9)
    np.testing.assert_allclose(three.covariance, one.covariance, atol=1e-9)


def test_majority_outvotes_a_drifting_source_which_is_then_to_be_started_anew() -> None:
    fusion, asked = Fusion(sources(3, 0.02), FusionConfig(restart_every_s=10.0)), []
    for k in range(100):
        drift = np.array([max(0.0, 0.04 * (k - 20)), 0.0])
        rows = {"s0": np.zeros(2), "s1": np.zeros(2), "s2": drift}
        fused = run(fusion, [rows], k)
        asked += [(k, name) for name in fused.restart]
    assert np.abs(fused.value).max() < 0.02
    assert fused.sources["s2"].reliability < 1e-3
    assert fused.sources["s0"].reliability > 0.9
    assert fused.confidence > 0.85
    assert [name for _, name in asked] == ["s2"], "once, then not again for ten seconds"
    assert 33 <= asked[0][0] <= 55, "half a second beyond half a unit"


def test_of_two_that_disagree_the_one_that_fits_the_past_is_believed() -> None:
    fusion = Fusion(sources(2, 0.05), FusionConfig())
    steady = run(fusion, [{"s0": np.zeros(2), "s1": np.zeros(2)}] * 40)
    assert steady.state == "tracking"
    fused = run(fusion, [{"s0": np.zeros(2), "s1": np.array([3.0, 0.0])}] * 40, 40)
    assert np.abs(fused.value).max() < 0.05
    assert fused.sources["s1"].reliability < 1e-3 < fused.sources["s0"].reliability


def test_of_two_that_see_again_and_disagree_the_one_that_fits_the_prediction_is_believed() -> None:
    fusion = Fusion(sources(2, 0.05), FusionConfig())
    run(fusion, [{"s0": np.zeros(2), "s1": np.zeros(2)}] * 40)
    assert run(fusion, [{"s0": None, "s1": None}] * 4, 40).state == "predicted"
    again = run(fusion, [{"s0": np.zeros(2), "s1": np.array([0.45, 0.0])}], 44)
    assert again.state == "tracking"
    assert again.sources["s0"].reliability > 0.9
    assert again.sources["s1"].reliability < 0.1


def test_a_jump_that_two_see_alike_is_followed_at_once_and_one_that_one_sees_is_not() -> None:
    still, away = np.zeros(2), np.array([6.0, -4.0])
    quiet: list[dict[str, object]] = [{"s0": still, "s1": still, "s2": still}] * 20
    for seen, expected in ((("s0", "s1"), away), (("s0",), still)):
        fusion = Fusion(sources(3), FusionConfig(common_jumps=True))
        run(fusion, quiet)
        rows: list[dict[str, object]] = [{n: away if n in seen else still for n in ("s0", "s1", "s2")}]
        answer = run(fusion, rows, 20)
        np.testing.assert_allclose(answer.value, expected, atol=0.1)
        assert answer.state == "tracking"


def test_one_left_is_believed_and_none_left_is_predicted_then_lost_then_found_again() -> None:
    fusion = Fusion(sources(2, 0.05), FusionConfig(predict_for_s=1.0))
    run(fusion, [{"s0": np.array([0.05 * k, 0.0]), "s1": np.array([0.05 * k, 0.0])} for k in range(40)])
    alone = run(fusion, [{"s0": np.array([0.05 * k, 0.0]), "s1": None} for k in range(40, 60)], 40)
    assert alone.state == "tracking"
    assert alone.value[0] == pytest.approx(0.05 * 59, abs=0.05)
    states = [run(fusion, [{"s0": None, "s1": None}], k) for k in range(60, 90)]
    assert [s.state for s in states[:20]] == ["predicted"] * 20
    assert states[-1].state == "lost"
    assert states[19].value[0] == pytest.approx(0.05 * 79, abs=0.3), "predicted on with its rate"
    assert states[19].confidence < 0.2 < alone.confidence
    found = run(fusion, [{"s0": np.array([9.0, 9.0]), "s1": None}] * 20, 90)
    assert found.state == "tracking"
    np.testing.assert_allclose(found.value, [9.0, 9.0], atol=0.1)


def test_all_unsure_is_not_seen() -> None:
    fusion = Fusion(sources(2, 0.05, threshold=0.5), FusionConfig(predict_for_s=0.5))
    run(fusion, [{"s0": np.zeros(2), "s1": np.zeros(2)}] * 20)
    states = [run(fusion, [{"s0": (np.ones(2), 0.1), "s1": (np.ones(2), 0.2)}], k).state for k in range(20, 40)]
    assert states[0] == "predicted"
    assert states[-1] == "lost"


def test_late_measurement_counts_at_its_capture_time() -> None:
    """A source whose results come 200 ms late pulls a moving target's estimate by nothing."""
    fusion = Fusion(sources(2, 0.02), FusionConfig())
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
    fusion = Fusion(sources(3, 0.05), FusionConfig())
    run(fusion, [{f"s{i}": np.zeros(2) for i in range(3)}] * 20)
    later = fusion.step([Measurement("s0", 40 * PERIOD_NS, np.zeros(2))], 40 * PERIOD_NS)
    assert later.sources["s0"].distance == math.inf
    between = fusion.step([], 41 * PERIOD_NS)
    assert between.state == "tracking"
    assert between.t_ns == 41 * PERIOD_NS
    assert between.covariance[0, 0] > later.covariance[0, 0]


def test_nothing_measured_yet() -> None:
    fused = Fusion(sources(2), FusionConfig()).step([], 0)
    assert fused.state == "waiting"
    assert np.isnan(fused.value).all()


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
    fusion = Fusion(sources(2), FusionConfig())
    with pytest.raises(ValueError, match=words):
        fusion.step([measurement], 0)
    assert fusion.step([], 0).state == "waiting"


def test_bad_sources_and_settings() -> None:
    for bad in ([], sources(1) + sources(1), [*sources(1), Source("x", (1.0,))]):
        with pytest.raises(ValueError, match="fusion: got sources"):
            Fusion(bad, FusionConfig())
    with pytest.raises(ValueError, match="positive standard deviations"):
        Source("x", (0.0,))
    with pytest.raises(ConfigError, match="drift_leave"):
        build(FusionConfig, {"drift_leave": 2.0}, "fusion")
    fusion = Fusion(sources(1), FusionConfig())
    fusion.step([], 10)
    with pytest.raises(ValueError, match="at least the last instant"):
        fusion.step([], 9)
