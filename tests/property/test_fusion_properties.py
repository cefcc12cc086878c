"""What the fusion promises for all numbers."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from onboard.fusion.center import Fused, Fusion
from onboard.fusion.config import FusionConfig
from onboard.fusion.source import Measurement, Source

_SEEDS = st.integers(0, 2**32 - 1)


def _run(seed: int, order: list[int], far: float | None = None) -> list[Fused]:
    """Three or four sources, some silent at times, in a given order; the last one far away from a time on."""
    rng = np.random.default_rng(seed)
    sources = [Source(f"s{i}", (0.05, 0.1)) for i in range(len(order))]
    fusion = Fusion([sources[i] for i in order], FusionConfig())
    answers, t_ns = [], 0
    for step in range(30):
        t_ns += int(rng.integers(1, 100_000_000))
        values = rng.normal(0.0, 0.1, (4, 2)) + step * 0.01
        silent = rng.random(4) < 0.2
        if far is not None and step >= 10:
            values[len(order) - 1] = far
        said = [Measurement(f"s{i}", t_ns, values[i], 0.5) for i in order if not silent[i]]
        answers.append(fusion.step(said, t_ns))
    return answers


@settings(max_examples=15)
@given(_SEEDS, st.permutations([0, 1, 2, 3]))
def test_order_of_sources_changes_nothing(seed: int, order: list[int]) -> None:
    for one, other in zip(_run(seed, [0, 1, 2, 3]), _run(seed, order), strict=True):
        np.testing.assert_array_equal(one.value, other.value)
        assert (one.state, one.confidence, one.restart) == (other.state, other.confidence, other.restart)


@settings(max_examples=15)
@given(_SEEDS, st.floats(-1e9, 1e9))
def test_covariance_stays_symmetric_and_positive(seed: int, far: float) -> None:
    for answer in _run(seed, [0, 1, 2], far):
        if answer.state != "waiting":
            np.testing.assert_array_equal(answer.covariance, answer.covariance.T)
            assert np.linalg.eigvalsh(answer.covariance).min() > 0.0
            assert 0.0 <= answer.confidence <= 1.0


@settings(max_examples=15)
@given(_SEEDS, st.floats(1e6, 1e12))
def test_source_at_infinity_has_no_influence(seed: int, far: float) -> None:
    near, gone = _run(seed, [0, 1, 2, 3], 1e15), _run(seed, [0, 1, 2, 3], far)
    for one, other in zip(near, gone, strict=True):
        np.testing.assert_allclose(one.value, other.value, atol=1e-4)
    assert abs(gone[-1].value).max() < 1.0
