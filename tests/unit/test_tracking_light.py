"""The light's gain by channel: followed while it creeps, found after it jumped, left alone when switched off."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.painted_scene import Scene, straight
from common.tracking.config import ParticleFilterConfig
from common.tracking.histogram import LAYOUTS, learn_model
from common.tracking.light import Light
from common.tracking.particle_filter import ParticleFilterTracker

KERNELS = LAYOUTS["five"]


def _lit(frame: np.ndarray, bgr: tuple[float, float, float]) -> np.ndarray:
    return np.clip(frame * np.array(bgr), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("bgr", [(0.6, 0.6, 0.6), (0.65, 0.6, 0.57), (1.2, 1.25, 1.3)])
def test_a_jump_of_light_costs_a_few_pictures_at_most(bgr: tuple[float, float, float]) -> None:
    tracker = ParticleFilterTracker(ParticleFilterConfig(), np.random.default_rng(1))
    unseen, last_error = 0, math.inf
    for index, (t_ns, frame, pose) in enumerate(Scene(straight(100.0), seed=3).frames(3.0)):
        if index == 0:
            tracker.init(frame, pose.box(), pose.angle_rad, t_ns)
            continue
        result = tracker.update(_lit(frame, bgr) if index >= 30 else frame, t_ns)
        unseen += result.state != "tracking"
        last_error = math.dist(result.center_px, (pose.x_px, pose.y_px))
    assert unseen <= 4
    assert last_error < 8.0


def test_each_channel_is_followed_by_itself() -> None:
    _, frame, pose = next(iter(Scene(straight(100.0, start_px=300.0), seed=3, noise=0.0).frames(0.1)))
    state = np.array([pose.x_px, pose.y_px, 0.0, 1.0 / np.sqrt(96 * 48)])
    model, light = learn_model(frame, state, 0.5, KERNELS), Light(0.1)
    tint = (0.9, 1.0, 1.12)
    before = model.distances(_lit(frame, tint), state[None], light.gain)[0]
    for _ in range(40):
        light.follow(model, _lit(frame, tint), state, 1, 0.05)
    after = model.distances(_lit(frame, tint), state[None], light.gain)[0]
    assert after < 0.6 * before
    assert light.gain[0] > light.gain[2]


def test_switched_off_it_changes_nothing() -> None:
    _, frame, pose = next(iter(Scene(straight(100.0, start_px=300.0), seed=3).frames(0.1)))
    state = np.array([pose.x_px, pose.y_px, 0.0, 1.0 / np.sqrt(96 * 48)])
    light = Light(0.0)
    light.follow(learn_model(frame, state, 0.5, KERNELS), _lit(frame, (0.7, 0.7, 0.7)), state, 1, 0.05)
    assert light.gain.tolist() == [1.0, 1.0, 1.0]
    assert light.jumps(frame) == []


def test_a_black_picture_gives_finite_gains() -> None:
    assert all(np.isfinite(gain).all() for gain in Light(0.1).jumps(np.zeros((480, 640, 3), np.uint8)))
