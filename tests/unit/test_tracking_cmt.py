"""CMT: its votes against closed forms, and a painted car that turns, grows, hides and comes back elsewhere."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.painted_scene import Pose, Scene, ground_picture
from common.tracking.base import Placeable, TrackResult
from common.tracking.cmt import CmtTracker
from common.tracking.cmt_config import CmtConfig
from common.tracking.cmt_consensus import largest_cluster, rotated, similarity_of
from common.tracking.cmt_keypoints import View, differing, unique_matches
from common.tracking.flow import follow_points


def _results(scene: Scene, duration_s: float) -> list[tuple[TrackResult, Pose]]:
    frames = iter(scene.frames(duration_s))
    _, frame, pose = next(frames)
    tracker = CmtTracker(CmtConfig(), np.random.default_rng(0))
    assert isinstance(tracker, Placeable)
    tracker.init(frame, pose.box(), pose.angle_rad, 0)
    return [(tracker.update(picture, t_ns), pose) for t_ns, picture, pose in frames]


def test_size_and_rotation_are_the_votes_of_most_pairs() -> None:
    rng = np.random.default_rng(3)
    model = rng.normal(0.0, 20.0, (40, 2))
    seen = rotated(model, 1.4, 2.8) + np.array([50.0, 60.0])
    seen[:8] += rng.normal(0.0, 40.0, (8, 2))
    change = similarity_of(model, seen)
    assert change is not None
    assert change[0] == pytest.approx(1.4, rel=0.02)
    assert math.remainder(change[1] - 2.8, 2 * math.pi) == pytest.approx(0.0, abs=0.02)
    together = largest_cluster(seen - rotated(model, 1.4, 2.8), 3.0)
    assert together[8:].all()
    assert together[:8].sum() <= 1
    assert similarity_of(model[:1], seen[:1]) is None


def test_single_linkage_follows_chains() -> None:
    chain = np.column_stack([np.arange(12.0), np.zeros(12)])
    votes = np.concatenate([chain, chain[:5] + np.array([0.0, 9.0])])
    np.testing.assert_array_equal(largest_cluster(votes, 1.1), np.arange(17) < 12)


def test_descriptors_differ_in_bits_and_match_only_mutually() -> None:
    one = np.array([[0, 0, 0, 0], [2**64 - 1, 0, 0, 0]], np.uint64)
    np.testing.assert_allclose(differing(one, one), [[0.0, 0.25], [0.25, 0.0]])
    rows, columns = unique_matches(np.array([[0.1, 0.3], [0.2, 0.4]], np.float32), 0.25)
    assert (rows.tolist(), columns.tolist()) == ([0], [0])


def test_view_undoes_zoom_and_rotation() -> None:
    view = View((100.0, 80.0), 2.0, math.pi / 2, (41, 41))
    np.testing.assert_allclose(
        view.in_picture(np.array([[20.0, 20.0], [30.0, 20.0]])), [[100, 80], [100, 85]], atol=1e-9
    )


def test_flow_comes_back_on_what_moved_and_not_on_what_is_new() -> None:
    ground = ground_picture(np.random.default_rng(5))[..., 0]
    moved = np.roll(ground, (2, 3), axis=(0, 1))
    moved[200:280, 200:280] = np.random.default_rng(6).integers(0, 255, (80, 80), np.uint8)
    places, error = follow_points(ground, moved, np.array([[100.0, 100.0], [240.0, 240.0]]))
    np.testing.assert_allclose(places[0], [103.0, 102.0], atol=0.2)
    assert error[0] < 0.2 < error[1]


def test_turning_growing_car_is_followed_with_its_angle() -> None:
    scene = Scene(lambda t: Pose(320.0 + 40.0 * t, 240.0, 0.6 * t, 1.0 + 0.15 * t), seed=3)
    results = _results(scene, 2.0)
    result, pose = results[-1]
    assert all(r.state == "tracking" for r, _ in results)
    assert math.dist(result.center_px, (pose.x_px, pose.y_px)) < 6.0
    assert result.angle_rad == pytest.approx(pose.angle_rad, abs=0.06)
    assert math.sqrt(result.size_px[0] * result.size_px[1]) == pytest.approx(math.sqrt(96 * 48) * pose.scale, rel=0.08)
