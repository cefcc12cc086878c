"""Histograms and their distance against closed forms, and the fast path against every pixel."""

from __future__ import annotations

import numpy as np
import pytest

from common.tracking.colour import bhattacharyya_coefficient, bhattacharyya_distance
from common.tracking.histogram import kernel_grid, learn_model
from tests.unit.tracking_scene import Pose, Scene, straight


def test_equal_histograms_have_distance_zero() -> None:
    histogram = np.array([0.25, 0.25, 0.5])
    assert bhattacharyya_coefficient(histogram, histogram) == pytest.approx(1.0)
    assert bhattacharyya_distance(histogram, histogram) == pytest.approx(0.0, abs=1e-7)


def test_disjoint_histograms_have_distance_one() -> None:
    assert bhattacharyya_distance(np.array([1.0, 0.0]), np.array([0.0, 1.0])) == pytest.approx(1.0)


def test_half_shared_histograms() -> None:
    # rho = sqrt(0.5 * 1) (eq. 2), d = sqrt(1 - rho) (eq. 3).
    expected = np.sqrt(1.0 - np.sqrt(0.5))
    assert bhattacharyya_distance(np.array([0.5, 0.5]), np.array([1.0, 0.0])) == pytest.approx(expected)


def _first() -> tuple[np.ndarray, Pose]:
    _, frame, pose = next(iter(Scene(straight(100.0, start_px=300.0), seed=3).frames(0.1)))
    return frame, pose


@pytest.mark.parametrize("layout", ["whole", "halves", "quarters", "five", "nine"])
def test_target_itself_is_nearest(layout: str) -> None:
    frame, pose = _first()
    state = np.array([pose.x_px, pose.y_px, 0.0, 1.0 / np.sqrt(96 * 48)])
    model = learn_model(frame, state, 0.5, kernel_grid(layout, 40))
    others = state + np.array([[0, 0, 0, 0], [30, 0, 0, 0], [0, 25, 0, 0], [0, 0, 0.8, 0], [150, 60, 0, 0]])
    distances = model.distances(frame, others, kernel_grid(layout, 10))
    assert np.argmin(distances) == 0
    assert distances[0] < 0.3
    assert distances[4] > 0.7


def test_sampling_grid_agrees_with_every_pixel() -> None:
    frame, pose = _first()
    state = np.array([pose.x_px, pose.y_px, 0.0, 1.0 / np.sqrt(96 * 48)])
    model = learn_model(frame, state, 0.5, kernel_grid("five", 48))
    rng = np.random.default_rng(0)
    states = state + rng.normal(size=(60, 4)) * [12.0, 12.0, 0.2, 0.0005]
    coarse = model.distances(frame, states, kernel_grid("five", 10))
    dense = model.distances(frame, states, kernel_grid("five", 60))
    assert np.corrcoef(coarse, dense)[0, 1] > 0.97
    assert np.sqrt(np.mean((coarse - dense) ** 2)) < 0.08
