"""Struck: the machine's dual against its definition, the features, and a painted car that hides and comes back."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.painted_scene import ground_picture
from common.tracking.struck_features import SIZE, Window
from common.tracking.struck_svm import StructuredSvm


def _machine(budget: int, patterns: int) -> tuple[StructuredSvm, list[np.ndarray], np.ndarray]:
    """One that has learned patterns whose targets lie near one direction, and the others near a second one."""
    rng = np.random.default_rng(4)
    machine = StructuredSvm(8, budget, 100.0, 1.0, np.random.default_rng(5))
    losses = np.concatenate([[0.0], np.linspace(0.3, 1.0, 9)])
    seen = []
    for _ in range(patterns):
        features = rng.normal(0.0, 0.25, (10, 8))
        features[0, 0] += 1.0
        features[1:, 1] += 1.0
        features /= np.linalg.norm(features, axis=1, keepdims=True)
        machine.learn(features.astype(np.float32), losses, 4, 10)
        seen.append(features.astype(np.float32))
    return machine, seen, losses


@pytest.mark.parametrize("budget", [12, 200])
def test_machine_ranks_the_target_first_and_keeps_the_dual(budget: int) -> None:
    machine, seen, losses = _machine(budget, 25)
    n = machine.support_vectors
    assert 2 <= n <= budget
    beta, pattern, choice = machine._beta[:n], machine._pattern[:n], machine._choice[:n]
    for number in np.unique(pattern):
        assert beta[pattern == number].sum() == pytest.approx(0.0, abs=1e-6), "the coefficients of a pattern cancel"
    assert (beta[choice == 0] > 0).all()
    assert (beta[choice != 0] < 0).all()
    expected = -losses[choice] - machine.evaluate(machine._vectors[:n])
    np.testing.assert_allclose(machine._gradient[:n], expected, atol=1e-4)
    first = [int(machine.evaluate(features).argmax()) for features in seen]
    assert first == [0] * len(seen)


def test_features_of_a_window_are_those_of_the_box_alone() -> None:
    rng = np.random.default_rng(6)
    frame = ground_picture(rng)
    size = np.array([40.0, 24.0])
    window = Window(frame, np.array([200.0, 150.0]), size, (8, 8))
    there = window.features(np.array([[8, -4]]))
    alone = Window(frame, np.array([210.0, 147.0]), size, (8, 8)).features(np.zeros((1, 2), int))
    assert there.shape == (1, SIZE)
    assert np.linalg.norm(there) == pytest.approx(1.0, abs=1e-4)
    assert (there @ alone.T).item() > 0.98
    far = window.features(np.array([[-8, 8]]))
    assert (there @ far.T).item() < 0.95
    brighter = Window(np.clip(frame * 1.3, 0, 255).astype(np.uint8), np.array([200.0, 150.0]), size, (8, 8))
    assert (brighter.features(np.array([[8, -4]])) @ there.T).item() > 0.97
