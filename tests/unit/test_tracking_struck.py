"""Struck: the machine's dual against its definition, the features, and a painted car that hides and comes back."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.painted_scene import Pose, Scene, ground_picture, paint
from benchmarks.painted_scene import car_picture as car
from common.tracking.base import Placeable, TrackResult
from common.tracking.struck import StruckTracker
from common.tracking.struck_config import StruckConfig
from common.tracking.struck_features import SIZE, Window
from common.tracking.struck_svm import StructuredSvm


def _results(scene: Scene, duration_s: float) -> list[tuple[TrackResult, Pose]]:
    frames = iter(scene.frames(duration_s))
    _, frame, pose = next(frames)
    tracker = StruckTracker(StruckConfig(), np.random.default_rng(0))
    assert isinstance(tracker, Placeable)
    tracker.init(frame, pose.box(), 0.0, 0)
    return [(tracker.update(picture, t_ns), pose) for t_ns, picture, pose in frames]


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


def test_size_is_followed() -> None:
    result, pose = _results(Scene(lambda t: Pose(320.0, 240.0, 0.0, 1.0 + 0.2 * t), seed=3), 2.0)[-1]
    assert math.sqrt(result.size_px[0] * result.size_px[1]) == pytest.approx(math.sqrt(96 * 48) * pose.scale, rel=0.1)
    assert math.dist(result.center_px, (pose.x_px, pose.y_px)) < 6.0


def test_hidden_target_is_not_reported_and_is_found_elsewhere() -> None:
    ground = ground_picture(np.random.default_rng(9))

    def hide(frame: np.ndarray, t_s: float) -> None:
        if 0.6 <= t_s < 1.4:
            frame[:] = ground[::-1]

    scene = Scene(lambda t: Pose(150.0, 120.0) if t < 1.0 else Pose(480.0, 350.0), seed=9, decorate=hide)
    results = _results(scene, 2.4)
    hidden = [r for k, (r, _) in enumerate(results, 1) if 0.6 <= k / 20 < 1.35]
    assert {r.state for r in hidden} <= {"predicted", "lost"}
    result, pose = results[-1]
    assert result.state == "tracking"
    assert result.overlap(pose.box()) > 0.6
    assert sum(r.reinitialised for r, _ in results) == 1


def test_placed_tracker_keeps_what_it_learned() -> None:
    frames = [ground_picture(np.random.default_rng(4)) for _ in range(3)]
    for frame, pose in zip(frames, (Pose(150.0, 120.0), Pose(450.0, 300.0), Pose(452.0, 300.0)), strict=True):
        paint(frame, car(), pose)
    tracker = StruckTracker(StruckConfig(), np.random.default_rng(0))
    with pytest.raises(ValueError, match="place before init"):
        tracker.place(frames[1], Pose(446.0, 302.0).box())
    tracker.init(frames[0], Pose(150.0, 120.0).box(), 0.0, 0)
    tracker.place(frames[1], Pose(446.0, 302.0).box())
    result = tracker.update(frames[2], 50_000_000)
    assert result.state == "tracking"
    assert math.dist(result.center_px, (452.0, 300.0)) < 4.0
