"""What the vehicle's motion tells the tracker: a jolt of the camera does not lose a target in view."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from benchmarks.painted_scene import Pose, Scene
from common.tracking.base import Expectation
from common.tracking.config import ParticleFilterConfig
from common.tracking.particle_filter import ParticleFilterTracker


def _jolt(t_s: float) -> Pose:
    """Stands, then 200 px to the right within 0.3 s, then stands."""
    return Pose(200.0 + 200.0 * min(max((t_s - 1.0) / 0.3, 0.0), 1.0), 240.0)


def _states(told: bool) -> Iterator[tuple[str, float]]:
    tracker = ParticleFilterTracker(ParticleFilterConfig(), np.random.default_rng(1))
    before = _jolt(0.0)
    for index, (t_ns, frame, pose) in enumerate(Scene(_jolt, seed=3).frames(2.0)):
        if index == 0:
            tracker.init(frame, pose.box(), 0.0, t_ns)
            continue
        if told:
            moved = (pose.x_px - before.x_px, pose.y_px - before.y_px)
            tracker.expect(Expectation((pose.x_px, pose.y_px), 0.0, moved, 0.0, 1.0))
        before = pose
        result = tracker.update(frame, t_ns)
        yield result.state, math.dist(result.center_px, (pose.x_px, pose.y_px))


def test_an_expected_jolt_is_followed() -> None:
    assert all(state == "tracking" and error < 12.0 for state, error in _states(told=True))


def test_the_same_jolt_unannounced_is_too_much() -> None:
    assert any(state != "tracking" or error > 40.0 for state, error in _states(told=False))


def test_a_climb_shrinks_the_rectangle() -> None:
    def shrinking(t_s: float) -> Pose:
        return Pose(320.0, 240.0, 0.0, 1.0 / (1.0 + 0.5 * t_s))

    tracker = ParticleFilterTracker(ParticleFilterConfig(), np.random.default_rng(1))
    before, result, pose = shrinking(0.0), None, shrinking(0.0)
    for index, (t_ns, frame, pose) in enumerate(Scene(shrinking, seed=3).frames(2.0)):
        if index == 0:
            tracker.init(frame, pose.box(), 0.0, t_ns)
            continue
        tracker.expect(Expectation((pose.x_px, pose.y_px), 0.0, (0.0, 0.0), 0.0, pose.scale / before.scale))
        before = pose
        result = tracker.update(frame, t_ns)
    assert result is not None
    assert result.state == "tracking"
    assert abs(math.log(result.size_px[0] / (96 * pose.scale))) < 0.15
