"""Jumps that are no faults: seen by two, by one whose past is new, by one alone after such, or vouched for."""

from __future__ import annotations

import numpy as np
import pytest

from onboard.fusion.center import Fused, Fusion
from onboard.fusion.config import FusionConfig
from onboard.fusion.source import Measurement, Source

PERIOD_NS = 40_000_000
STILL, AWAY, FURTHER = np.zeros(2), np.array([0.9, -0.8]), np.array([0.2, -0.1])
NAMES = ("a", "b", "c")


def _fusion(common_jumps: bool = True) -> Fusion:
    fusion = Fusion([Source(n, (0.05, 0.05), 0.5) for n in NAMES], FusionConfig(common_jumps=common_jumps))
    for k in range(25):
        _step(fusion, k, dict.fromkeys(NAMES, STILL))
    return fusion


def _step(fusion: Fusion, k: int, said: dict[str, np.ndarray]) -> Fused:
    """One step in which those that are not named say that they are lost."""
    return fusion.step([Measurement(n, k * PERIOD_NS, said.get(n)) for n in NAMES], k * PERIOD_NS)


def test_one_that_has_just_begun_confirms_the_jump_of_another() -> None:
    fusion = _fusion()
    fusion.forget("b")
    answer = _step(fusion, 25, {"a": AWAY, "b": AWAY + 0.1})
    assert answer.state == "tracking"
    np.testing.assert_allclose(answer.value, AWAY + 0.05, atol=0.06)


def test_a_lone_jump_is_an_outlier_unless_as_large_a_one_was_seen_by_two_of_late() -> None:
    quiet, shaken = _fusion(), _fusion()
    _step(shaken, 25, {"a": AWAY, "b": AWAY})
    _step(quiet, 25, {"a": STILL, "b": STILL})
    before = _step(quiet, 26, {"a": AWAY})
    after = _step(shaken, 26, {"a": FURTHER})
    assert before.sources["a"].reliability < 0.1
    assert after.sources["a"].reliability > 0.5
    assert after.state == "tracking"
    for k in range(27, 27 + 250):
        _step(shaken, k, dict.fromkeys(NAMES, FURTHER))
    late = _step(shaken, 277, {"a": FURTHER + AWAY})
    assert late.sources["a"].reliability < 0.1, "ten seconds later it is forgotten"


def test_the_answer_goes_where_one_is_that_somebody_vouches_for() -> None:
    fusion = _fusion()
    fusion.forget("a", follow=True)
    answer = _step(fusion, 25, {"a": AWAY})
    np.testing.assert_allclose(answer.value, AWAY, atol=0.01)
    assert answer.state == "tracking"


@pytest.mark.parametrize("confidence, share", [(0.95, 0.5), (0.5, 0.1)])
def test_one_that_hesitates_counts_less_against_another_and_still_shows_the_target(
    confidence: float, share: float
) -> None:
    fusion = _fusion()
    said = [Measurement("a", 25 * PERIOD_NS, STILL + 0.1, confidence), Measurement("b", 25 * PERIOD_NS, STILL - 0.1)]
    judged = fusion.step(said, 25 * PERIOD_NS).sources
    weight = 1.0 / judged["a"].variance[0] / (1.0 / judged["a"].variance[0] + 1.0 / judged["b"].variance[0])
    assert weight == pytest.approx(share, abs=0.05)
    alone = fusion.step([Measurement("a", 26 * PERIOD_NS, STILL, confidence)], 26 * PERIOD_NS)
    assert alone.state == "tracking"
