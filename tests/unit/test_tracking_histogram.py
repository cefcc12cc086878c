"""Histograms and their distance against closed forms, and the fast path against every pixel."""

from __future__ import annotations

import math

import numpy as np
import pytest

from common.tracking.colour import ColourBins, bhattacharyya_coefficient, bhattacharyya_distance
from common.tracking.histogram import LAYOUTS, kernel_grid, learn_model
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


def _by_every_pixel(frame: np.ndarray, state: np.ndarray, aspect: float, bins: ColourBins) -> np.ndarray:
    """Equation 1 as it is written: every pixel of the picture, its kernel value, its bin; layout `five`."""
    centers, half_axes = LAYOUTS["five"]
    width = 1.0 / (state[3] * math.sqrt(aspect))
    height = width * aspect
    of_pixel = bins.of(frame)
    histograms = np.zeros((len(centers), 512))
    cosine, sine = math.cos(state[2]), math.sin(state[2])
    for row in range(frame.shape[0]):
        for column in range(frame.shape[1]):
            dx, dy = column - state[0], row - state[1]
            u, v = (cosine * dx + sine * dy) / width, (-sine * dx + cosine * dy) / height
            if max(abs(u), abs(v)) > 0.6:
                continue
            for index, (cx, cy) in enumerate(centers):
                kernel = 1.0 - ((u - cx) / half_axes[0]) ** 2 - ((v - cy) / half_axes[1]) ** 2
                histograms[index, of_pixel[row, column]] += max(kernel, 0.0)
    return histograms / histograms.sum(axis=1, keepdims=True)


@pytest.mark.slow
@pytest.mark.parametrize("angle_rad", [0.0, 0.5])
def test_distances_are_those_of_equations_1_to_4(angle_rad: float) -> None:
    frame, pose = _first()
    scale = 1.0 / math.sqrt(96 * 48)
    model = learn_model(frame, np.array([pose.x_px, pose.y_px, 0.0, scale]), 0.5, kernel_grid("five", 60))
    state = np.array([pose.x_px + 9.0, pose.y_px - 6.0, angle_rad, scale])
    plain = _by_every_pixel(frame, state, 0.5, model.bins)
    rho = np.sqrt(plain * model.reference).sum(axis=1)  # eq. 2
    expected = np.sqrt(1.0 - rho).mean()  # eqs 3 and 4
    assert model.distances(frame, state[None], kernel_grid("five", 60))[0] == pytest.approx(expected, abs=0.02)


def test_points_looked_up_singly_give_what_the_window_gives(monkeypatch: pytest.MonkeyPatch) -> None:
    frame, pose = _first()
    state = np.array([pose.x_px, pose.y_px, 0.0, 1.0 / np.sqrt(96 * 48)])
    model, grid = learn_model(frame, state, 0.5, kernel_grid("five", 30)), kernel_grid("five", 10)
    states = state + np.random.default_rng(0).normal(size=(40, 4)) * [400.0, 300.0, 2.0, 0.001]
    found = []
    for bound in (0.0, 1e9):
        monkeypatch.setattr("common.tracking.histogram._GATHER_FROM", bound)
        found.append(model.distances(frame, states, grid, np.array([1.1, 0.9, 1.0])))
    assert found[0].tolist() == found[1].tolist()


def test_many_gains_at_once_are_each_one_by_itself() -> None:
    frame, pose = _first()
    state = np.array([pose.x_px, pose.y_px, 0.3, 1.0 / np.sqrt(96 * 48)])
    model, grid = learn_model(frame, state, 0.5, kernel_grid("five", 30)), kernel_grid("five", 30)
    gains = np.array([[1.0, 1.0, 1.0], [0.8, 0.9, 1.1]])
    single = [model.distances(frame, state[None], grid, gain)[0] for gain in gains]
    assert model.relit(frame, state, grid, gains).tolist() == pytest.approx(single)
