"""Every tracker of the registry on a painted car: the contract; and what DSST alone does: size, occlusion, return."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
import pytest

from benchmarks.painted_scene import Pose, Scene, car_picture, ground_picture, paint, straight
from common.config import ConfigError
from common.processes import load_config
from common.tracking.appearance import Appearance, upright_patch
from common.tracking.base import Placeable, TrackResult
from common.tracking.correlation import CorrelationFilter, peak_of, peak_to_sidelobe
from common.tracking.hog import CHANNELS, gradients_of_cells
from common.tracking.registry import TRACKERS, make_tracker, tracker_class

CONFIG = load_config(None)
FILM = list(Scene(straight(120.0), seed=7).frames(1.0))


@pytest.mark.parametrize("name", sorted(set(TRACKERS) - {"nano", "vit"}))
def test_each_tracker_follows_and_keeps_the_contract(name: str) -> None:
    tracker = make_tracker(name, CONFIG, np.random.default_rng(3))
    _, frame, pose = FILM[0]
    with pytest.raises(ValueError, match="update before init"):
        tracker.update(frame, 0)
    with pytest.raises(ValueError, match="expected a BGR picture"):
        tracker.init(frame[..., 0], pose.box())
    with pytest.raises(ValueError, match="expected finite"):
        tracker.init(frame, (math.nan, 0.0, 10.0, 10.0))
    tracker.init(frame, pose.box(), 0.0, 0)
    for t_ns, picture, truth in FILM[1:]:
        result = tracker.update(picture, t_ns)
        assert result.state == "tracking"
        assert math.dist(result.center_px, (truth.x_px, truth.y_px)) < 16.0
        assert 0.0 <= result.score <= 1.0
        assert result.overlap(truth.box()) > 0.6
    with pytest.raises(ValueError, match="as at the start"):
        tracker.update(frame[:-8], t_ns + 1)


def test_unknown_tracker_is_named() -> None:
    with pytest.raises(ConfigError, match="did you mean 'dsst'"):
        tracker_class("dst")


def test_filter_answers_with_its_peak_at_the_shift() -> None:
    rng = np.random.default_rng(1)
    picture = cv2.GaussianBlur(rng.normal(size=(24, 32, 3)).astype(np.float32), (0, 0), 1.0)
    one = CorrelationFilter((24, 32), (1.0, 1.0), 1e-4)
    with pytest.raises(ValueError, match="before learn"):
        one.response(picture)
    one.learn(picture, 1.0)
    at_home = one.response(picture)
    assert peak_of(at_home) == pytest.approx((0.0, 0.0), abs=0.05)
    assert at_home.max() == pytest.approx(1.0, abs=0.05)
    moved = one.response(np.roll(picture, (2, -3), axis=(0, 1)))
    assert peak_of(moved) == pytest.approx((2.0, -3.0), abs=0.2)
    other = one.response(rng.normal(size=(24, 32, 3)).astype(np.float32))
    assert peak_to_sidelobe(moved) > 3 * peak_to_sidelobe(other)


def test_gradients_point_across_the_edge_and_know_no_brightness() -> None:
    step = np.zeros((1, 16, 16), np.float32)
    step[:, :, 8:] = 100.0
    features = gradients_of_cells(step)
    assert features.shape == (1, 4, 4, CHANNELS)
    signed = features[0, 1, 2, :18]
    assert np.argmax(signed) == 0, "from dark to bright along x"
    np.testing.assert_allclose(gradients_of_cells(step + 50.0), features, atol=1e-6)
    assert features[0, :, 0].max() < 0.01


def test_patches_tell_the_target_from_what_is_like_it() -> None:
    rng = np.random.default_rng(2)
    grey = cv2.GaussianBlur(rng.integers(0, 255, (120, 160), np.uint8), (0, 0), 3.0)
    box, other = (20.0, 20.0, 30.0, 24.0), (90.0, 60.0, 30.0, 24.0)
    patch = upright_patch(grey, box)
    assert patch.sum() == pytest.approx(0.0, abs=1e-3)
    assert float(patch @ patch) == pytest.approx(1.0, abs=1e-2)
    memory = Appearance()
    memory.learn_target(patch)
    own, different = memory.similarity(patch), memory.similarity(upright_patch(grey, other))
    assert own[0] > 0.95 > different[0]
    assert own[1] > 0.98 > 0.6 > different[1]
    found = memory.search(grey, (30.0, 24.0), (1.0,), 3)[0]
    assert math.dist(found.box[:2], box[:2]) < 3.0


BOXES = ("dsst", "cmt", "struck", "tld")


def _of(name: str) -> Any:
    kind = tracker_class(name)
    return kind(kind.config_type(), np.random.default_rng(0))


def _followed(name: str, scene: Scene, duration_s: float) -> list[tuple[TrackResult, Pose]]:
    frames = iter(scene.frames(duration_s))
    _, frame, pose = next(frames)
    tracker = _of(name)
    tracker.init(frame, pose.box(), 0.0, 0)
    return [(tracker.update(picture, t_ns), pose) for t_ns, picture, pose in frames]


@pytest.mark.parametrize("name", BOXES)
def test_size_is_followed(name: str) -> None:
    scene = Scene(lambda t_s: Pose(320.0, 240.0, 0.0, 1.0 + 0.2 * t_s), seed=3)
    result, pose = _followed(name, scene, 2.0)[-1]
    assert math.sqrt(result.size_px[0] * result.size_px[1]) == pytest.approx(math.sqrt(96 * 48) * pose.scale, rel=0.1)
    assert math.dist(result.center_px, (pose.x_px, pose.y_px)) < 6.0


@pytest.mark.parametrize("name", BOXES)
def test_hidden_target_is_not_reported_and_is_found_elsewhere(name: str) -> None:
    ground = ground_picture(np.random.default_rng(9))

    def hide(frame: np.ndarray, t_s: float) -> None:
        if 0.6 <= t_s < 1.6:
            frame[:] = ground[::-1]

    scene = Scene(lambda t_s: Pose(150.0, 120.0) if t_s < 1.0 else Pose(480.0, 350.0), seed=9, decorate=hide)
    results = _followed(name, scene, 2.8)
    hidden = [r for k, (r, _) in enumerate(results, 1) if 0.7 <= k / 20 < 1.55]
    assert {r.state for r in hidden} <= {"predicted", "lost"}
    result, pose = results[-1]
    assert result.state == "tracking"
    assert result.overlap(pose.box()) > 0.6
    assert sum(r.reinitialised for r, _ in results) == 1


@pytest.mark.parametrize("name", BOXES)
def test_placed_tracker_keeps_what_it_learned(name: str) -> None:
    frames = [ground_picture(np.random.default_rng(4)) for _ in range(3)]
    for frame, pose in zip(frames, (Pose(150.0, 120.0), Pose(450.0, 300.0), Pose(452.0, 300.0)), strict=True):
        paint(frame, car_picture(), pose)
    tracker = _of(name)
    assert isinstance(tracker, Placeable)
    with pytest.raises(ValueError, match=f"{name}: place before init"):
        tracker.place(frames[1], Pose(446.0, 302.0).box())
    tracker.init(frames[0], Pose(150.0, 120.0).box(), 0.0, 0)
    tracker.place(frames[1], Pose(446.0, 302.0).box())
    result = tracker.update(frames[2], 50_000_000)
    assert result.state == "tracking"
    assert math.dist(result.center_px, (452.0, 300.0)) < 4.0
    with pytest.raises(ValueError, match="most of it"):
        tracker.place(frames[1], (900.0, 10.0, 50.0, 50.0))
