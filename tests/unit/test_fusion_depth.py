"""Distance from time of flight and scale: reliability, both measures, the learned scale, the six-state filter."""

from __future__ import annotations

import math

import numpy as np
import pytest

from onboard.fusion.config import DepthConfig
from onboard.fusion.depth import DepthEstimate, DepthFusion, size_ratio, tof_distance, unreliability

IMAGE_PX = (320.0, 240.0)
CENTER_PX = (160.0, 120.0)
FOCAL_PX, SIDE_M = 250.0, 0.2


def _box(z_m: float) -> tuple[float, float]:
    side = FOCAL_PX * SIDE_M / z_m
    return side, side


def _patch(z_m: float, empty_share: float) -> np.ndarray:
    patch = np.full((10, 10), z_m)
    patch.flat[: round(100 * empty_share)] = 0.0
    return patch


def _follow(fusion: DepthFusion, z_m: np.ndarray, empty: np.ndarray, begin: int = 0, bias_m: float = 0.0) -> list:
    return [
        fusion.update((begin + k) * 33_000_000, CENTER_PX, _box(z), _patch(z + bias_m, e))
        for k, (z, e) in enumerate(zip(z_m, empty, strict=True))
    ]


def test_distance_is_the_mean_of_the_pixels_that_have_one() -> None:
    distance_m, empty = tof_distance(np.array([[0.0, 0.5], [0.7, 0.0]]))
    assert distance_m == pytest.approx(0.6)
    assert empty == 0.5
    nothing, empty = tof_distance(np.zeros((3, 4)))
    assert math.isnan(nothing)
    assert empty == 1.0


def test_reliability_switches_at_zeta_over_eta() -> None:
    """Eq. 3.12 with the thesis's figures: η = 20, ζ = 12, so at 60 % of empty pixels."""
    assert unreliability(0.6, 20.0, 12.0) == pytest.approx(0.5)
    assert unreliability(0.0, 20.0, 12.0) == pytest.approx(1.0 / (1.0 + math.exp(12.0)), rel=1e-6)
    assert unreliability(1.0, 20.0, 12.0) == pytest.approx(1.0 - 1.0 / (1.0 + math.exp(8.0)))
    assert unreliability(1.0, 1e6, 1.0) == 1.0


def test_size_gives_distance_up_to_a_constant() -> None:
    """Eq. 3.11: half the size, twice the distance."""
    assert size_ratio((20.0, 30.0), IMAGE_PX) == pytest.approx(2.0 * size_ratio((40.0, 60.0), IMAGE_PX))
    assert size_ratio(IMAGE_PX, IMAGE_PX) == 1.0


def test_scale_is_learned_at_the_first_valid_depth_and_refined() -> None:
    fusion = DepthFusion(DepthConfig(), IMAGE_PX)
    assert fusion.update(0, CENTER_PX, _box(0.7), _patch(0.7, 1.0)) is None, "no distance was ever measured"
    assert fusion.scale_m is None
    true_scale_m = 0.7 / size_ratio(_box(0.7), IMAGE_PX)
    fusion.update(33_000_000, CENTER_PX, _box(0.7), _patch(0.77, 0.0))
    assert fusion.scale_m == pytest.approx(1.1 * true_scale_m), "from one reading that is 10 % too long"
    for k in range(2, 60):
        fusion.update(k * 33_000_000, CENTER_PX, _box(0.7), _patch(0.7, 0.0))
    assert fusion.scale_m == pytest.approx(true_scale_m, rel=0.005)


def test_within_range_the_time_of_flight_counts_and_beyond_it_the_scale() -> None:
    fusion = DepthFusion(DepthConfig(), IMAGE_PX)
    near = _follow(fusion, np.full(90, 0.6), np.zeros(90))[-1]
    assert near.position[2] == pytest.approx(0.6, abs=1e-3)
    assert near.reliability < 1e-4
    out = _follow(fusion, np.linspace(0.6, 1.6, 150), np.linspace(0.0, 1.0, 150), 90)
    far = _follow(fusion, np.full(60, 1.6), np.full(60, 0.95), 240, bias_m=-0.9)[-1]
    assert isinstance(far, DepthEstimate)
    assert max(abs(e.position[2] - z) for e, z in zip(out, np.linspace(0.6, 1.6, 150), strict=True)) < 0.05
    assert far.reliability > 0.99
    assert far.tof_m == pytest.approx(0.7)
    assert far.position[2] == pytest.approx(1.6, abs=0.02)


def test_no_variance_reaches_zero() -> None:
    """Eq. 3.15 as printed is zero at R_ζ = 1: the filter would believe one box for ever."""
    fusion = DepthFusion(DepthConfig(eta=1e4, zeta=12.0), IMAGE_PX)
    _follow(fusion, np.full(5, 0.6), np.zeros(5))
    answer = _follow(fusion, np.full(20, 1.5), np.ones(20), 5)[-1]
    assert answer.reliability == 1.0
    assert np.linalg.eigvalsh(answer.covariance).min() > 0.0
    assert answer.covariance[2, 2] > 1e-4


def test_place_and_rates_follow_with_real_stamps_and_a_commanded_motion() -> None:
    """The vehicle's own acceleration towards the target is known: with it, the rate needs no time to be found."""
    config = DepthConfig(acceleration_m_s=0.05)
    with_control, without = (DepthFusion(config, IMAGE_PX) for _ in range(2))
    errors = {}
    for name, fusion, control in (("with", with_control, np.array([0.0, 0.0, -0.4])), ("without", without, None)):
        for k in range(60):
            t_s = 0.04 * k
            z_m = 0.95 - 0.2 * t_s**2 if t_s < 1.0 else 0.75 - 0.4 * (t_s - 1.0) + 0.0
            known = control if t_s <= 1.0 else None
            answer = fusion.update(round(t_s * 1e9), (160.0 + 50.0 * t_s, 120.0), _box(z_m), _patch(z_m, 0.0), known)
            if k == 25:
                assert answer is not None
                errors[name] = abs(answer.rate[2] + 0.4)
    assert errors["with"] < 0.02 < errors["without"]
    assert answer is not None
    assert answer.rate[0] == pytest.approx(50.0, abs=2.0)
    assert answer.position[0] == pytest.approx(160.0 + 50.0 * 0.04 * 59, abs=1.0)


@pytest.mark.parametrize(
    ("size", "depth", "t_ns", "words"),
    [
        ((0.0, 10.0), None, 1, "size above 0|above 0"),
        ((math.nan, 10.0), None, 1, "expected finite"),
        ((10.0, 10.0), np.full((2, 2), -1.0), 1, "finite depths"),
        ((10.0, 10.0), np.zeros((0, 2)), 1, "finite depths"),
        ((10.0, 10.0), None, -1, "at least the last stamp"),
    ],
)
def test_bad_input_is_refused(size: tuple[float, float], depth: np.ndarray | None, t_ns: int, words: str) -> None:
    fusion = DepthFusion(DepthConfig(), IMAGE_PX)
    fusion.update(0, CENTER_PX, _box(0.6), _patch(0.6, 0.0))
    with pytest.raises(ValueError, match=words):
        fusion.update(t_ns, CENTER_PX, size, depth)


def test_a_target_that_is_farther_than_its_size_says_is_seen_too_large_but_within_bounds() -> None:
    fusion = DepthFusion(DepthConfig(), IMAGE_PX)
    fusion.correct(_box(1.0), 2.0)
    assert fusion.scale_m is None, "nothing is known yet"
    for k in range(3):
        fusion.update(k * 33_000_000, CENTER_PX, _box(0.8), _patch(0.8, 0.1))
    first = fusion.scale_m
    assert first is not None
    fusion.correct(_box(0.8), 0.7)
    assert fusion.scale_m == first, "nearer it is not"
    fusion.correct(_box(0.8), 1.0)
    assert fusion.scale_m == pytest.approx(1.25 * first, rel=0.01)
    fusion.correct(_box(0.8), 5.0)
    assert fusion.scale_m == pytest.approx(1.5 * first, rel=0.01)
    with pytest.raises(ValueError, match="expected finite"):
        fusion.correct(_box(0.8), math.nan)
