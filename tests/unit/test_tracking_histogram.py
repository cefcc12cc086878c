"""Histograms and their distance against closed forms, and the fast path against every pixel."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.painted_scene import Pose, Scene, straight
from common.tracking.colour import ColourBins, bhattacharyya_coefficient, bhattacharyya_distance
from common.tracking.histogram import LAYOUTS, Backend, learn_model, state_histograms


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


def _state(pose: Pose) -> np.ndarray:
    return np.array([pose.x_px, pose.y_px, pose.angle_rad, 1.0 / (math.sqrt(96 * 48) * pose.scale)])


def _scattered(pose: Pose) -> np.ndarray:
    """States on the target, around it, across the edge, outside the picture, and of less than a pixel; (131, 4)."""
    state, rng = _state(pose), np.random.default_rng(0)
    near = state + rng.normal(size=(80, 4)) * [30.0, 30.0, 3.0, 0.2 * state[3]]
    far = state + rng.normal(size=(50, 4)) * [400.0, 300.0, 3.0, 0.0]
    states = np.concatenate([near, far, state[None] * [1, 1, 1, 200]])
    states[:, 3] = np.maximum(states[:, 3], 0.3 * state[3])
    return states


@pytest.mark.parametrize("layout", LAYOUTS)
def test_target_itself_is_nearest(layout: str) -> None:
    frame, pose = _first()
    state = _state(pose)
    model = learn_model(frame, state, 0.5, LAYOUTS[layout])
    others = state + np.array([[0, 0, 0, 0], [30, 0, 0, 0], [0, 25, 0, 0], [0, 0, 0.8, 0], [150, 60, 0, 0]])
    distances = model.distances(frame, others)
    assert np.argmin(distances) == 0
    assert distances[0] == pytest.approx(0.0, abs=1e-6)
    assert distances[4] > 0.7


def test_flat_patch_fills_one_bin() -> None:
    frame = np.full((100, 200, 3), (10, 100, 200), np.uint8)
    bins = ColourBins()
    histograms = state_histograms(bins.of(frame), np.array([100.0, 50.0, 0.3, 1 / 40.0]), 0.5, LAYOUTS["five"])
    assert histograms[:, 0 * 64 + 3 * 8 + 6].tolist() == pytest.approx([1.0] * 5)
    assert histograms.sum() == pytest.approx(5.0)


def test_kernel_half_outside_the_picture_has_half_the_mass() -> None:
    frame = np.full((100, 200, 3), 90, np.uint8)
    state = np.array([-0.5, 50.0, 0.0, 1 / 40.0])  # the edge of the picture lies half a pixel left of its first column
    histograms = state_histograms(ColourBins().of(frame), state, 0.5, LAYOUTS["whole"])
    assert histograms.sum() == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("thinning", [0, 1, 2, 3])
def test_compiled_sums_are_those_of_the_reference(layout: str, thinning: int) -> None:
    frame, pose = _first()
    compiled, plain = (
        learn_model(frame, _state(pose), 0.5, LAYOUTS[layout], "compiled"),
        learn_model(frame, _state(pose), 0.5, LAYOUTS[layout], "numpy"),
    )
    states = _scattered(pose)
    gain = np.array([1.1, 0.9, 1.0])
    expected = plain.distances(frame, states, gain, thinning)
    assert compiled.distances(frame, states, gain, thinning) == pytest.approx(expected, abs=1e-9)
    assert expected.min() < 0.7 < expected.max()


def test_a_view_of_a_larger_picture_is_read_as_it_is() -> None:
    frame, pose = _first()
    model = learn_model(frame, _state(pose), 0.5, LAYOUTS["five"])
    wide = np.concatenate([frame, frame], axis=1)[:, : frame.shape[1]]
    assert not wide.flags.c_contiguous
    states = _scattered(pose)
    assert model.distances(wide, states).tolist() == model.distances(frame, states).tolist()


def test_large_target_is_read_on_a_lattice_that_says_the_same() -> None:
    scene = Scene(lambda t_s: Pose(320.0, 240.0, 0.3, 4.0), seed=3)
    _, frame, pose = next(iter(scene.frames(0.1)))
    state = _state(pose)
    kernels = LAYOUTS["five"]
    assert kernels.thinning(_state(Pose(0, 0)), 2000.0) == 0
    assert kernels.thinning(state, 2000.0) == 3
    model = learn_model(frame, state, 0.5, kernels)
    states = state + np.random.default_rng(0).normal(size=(60, 4)) * [30.0, 30.0, 0.15, 0.03 * state[3]]
    difference = model.distances(frame, states, thinning=3) - model.distances(frame, states)
    assert np.sqrt(np.mean(difference**2)) < 0.01


def _by_every_pixel(frame: np.ndarray, state: np.ndarray, aspect: float, bins: ColourBins) -> np.ndarray:
    """Equation 1 as it is written: every pixel of the picture, its kernel value, its bin; layout `five`."""
    centers, half_axes = LAYOUTS["five"].centers, LAYOUTS["five"].half_axes
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
@pytest.mark.parametrize("backend", ["compiled", "numpy"])
@pytest.mark.parametrize("angle_rad", [0.0, 0.5])
def test_distances_are_those_of_equations_1_to_4(angle_rad: float, backend: Backend) -> None:
    frame, pose = _first()
    model = learn_model(frame, _state(pose), 0.5, LAYOUTS["five"], backend)
    state = _state(pose) + np.array([9.0, -6.0, angle_rad, 0.0])
    plain = _by_every_pixel(frame, state, 0.5, model.bins)
    rho = np.sqrt(plain * model.reference).sum(axis=1)  # eq. 2
    expected = np.sqrt(1.0 - rho).mean()  # eqs 3 and 4
    assert model.distances(frame, state[None])[0] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("backend", ["compiled", "numpy"])
def test_many_gains_at_once_are_each_one_by_itself(backend: Backend) -> None:
    frame, pose = _first()
    state = _state(pose) + np.array([0.0, 0.0, 0.3, 0.0])
    model = learn_model(frame, _state(pose), 0.5, LAYOUTS["five"], backend)
    gains = np.array([[1.0, 1.0, 1.0], [0.8, 0.9, 1.1]])
    single = [model.distances(frame, state[None], gain)[0] for gain in gains]
    assert model.relit(frame, state, gains).tolist() == pytest.approx(single)


def test_permuted_states_have_permuted_distances() -> None:
    frame, pose = _first()
    model = learn_model(frame, _state(pose), 0.5, LAYOUTS["five"])
    states = _scattered(pose)
    order = np.random.default_rng(1).permutation(len(states))
    assert model.distances(frame, states[order]).tolist() == model.distances(frame, states)[order].tolist()
