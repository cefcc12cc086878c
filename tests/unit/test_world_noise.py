"""What light, sensor and radio do to a picture."""

import numpy as np
import pytest

from simulation.world.noise import (
    add_noise,
    break_blocks,
    exposure_gain,
    light_gain,
    noise_tile,
    shade,
    vignette_map,
)
from simulation.world.radio import LinkState, next_fate
from simulation.world.scenario import LightConfig, LightStepConfig, RadioConfig, SensorConfig

GREY = np.full((120, 160, 3), 100, np.uint8)


def test_noise_has_its_deviation_no_bias_and_its_seed() -> None:
    tile = noise_tile(np.random.default_rng(1), 160, 120, 6.0)
    noisy = add_noise(GREY, tile, np.random.default_rng(2))
    difference = noisy.astype(float) - GREY
    assert difference.std() == pytest.approx(6.0, rel=0.05)
    assert abs(difference.mean()) < 0.2
    assert (noisy == add_noise(GREY, tile, np.random.default_rng(2))).all()
    assert (noisy != add_noise(GREY, tile, np.random.default_rng(3))).mean() > 0.8
    assert (tile == noise_tile(np.random.default_rng(1), 160, 120, 6.0)).all()


def test_the_vignette_darkens_the_corners_only() -> None:
    shaded = shade(GREY, (1.0, 1.0, 1.0), vignette_map(160, 120, 0.4))
    assert shaded[60, 80, 0] == 100
    np.testing.assert_allclose(shaded[[0, 0, -1, -1], [0, -1, 0, -1]], 60, atol=1)


@pytest.mark.parametrize("vignette", [None, vignette_map(160, 120, 0.0)])
@pytest.mark.parametrize("gain", [(1.0, 1.0, 1.0), (0.5, 0.5, 0.5), (1.2, 1.0, 0.8), (3.0, 3.0, 3.0)])
def test_shade_multiplies_each_channel_and_clips(gain: tuple[float, float, float], vignette: np.ndarray | None) -> None:
    expected = np.minimum(np.array(gain) * 100, 255)
    np.testing.assert_allclose(shade(GREY, gain, vignette)[60, 80], expected, atol=1.5)


def test_light_ramps_steps_drifts_and_repeats() -> None:
    steps = (
        LightStepConfig(at_s=10.0, gain=0.5, ramp_s=4.0),
        LightStepConfig(at_s=20.0, gain=1.0, tint=(1.1, 1.0, 0.9)),
    )
    light = LightConfig(steps=steps, repeat_s=30.0)
    assert light_gain(light, 5.0) == (1.0, 1.0, 1.0)
    assert light_gain(light, 12.0) == pytest.approx((0.75, 0.75, 0.75))
    assert light_gain(light, 15.0) == pytest.approx((0.5, 0.5, 0.5))
    assert light_gain(light, 20.0) == pytest.approx((0.9, 1.0, 1.1))  # blue, green, red
    assert light_gain(light, 45.0) == pytest.approx(light_gain(light, 15.0))
    drifting = LightConfig(drift=0.2, drift_period_s=40.0)
    assert light_gain(drifting, 10.0) == pytest.approx((1.2, 1.2, 1.2))


def test_exposure_jumps_between_intervals_within_its_bound() -> None:
    sensor = SensorConfig(exposure_jump=0.1, exposure_interval_s=2.0)
    gains = [exposure_gain(sensor, 4, t) for t in np.arange(0.0, 60.0, 0.5)]
    assert gains[0] == 1.0 and gains[4] == gains[5]
    assert 0.9 <= min(gains) < 0.95 and 1.05 < max(gains) <= 1.1
    assert exposure_gain(SensorConfig(), 4, 30.0) == 1.0


def test_broken_blocks_are_aligned_few_and_seeded() -> None:
    frame = np.random.default_rng(0).integers(0, 256, (96, 160, 3), dtype=np.uint8)
    radio = RadioConfig(block_count=3, block_px=16)
    broken = break_blocks(frame, radio, np.random.default_rng(5))
    changed = (broken != frame).any(axis=2).reshape(6, 16, 10, 16).any(axis=(1, 3))
    assert 1 <= changed.any(axis=1).sum() <= 3
    assert changed.sum() <= 3 * 8
    assert (broken == break_blocks(frame, radio, np.random.default_rng(5))).all()
    assert (frame == np.random.default_rng(0).integers(0, 256, (96, 160, 3), dtype=np.uint8)).all()


def run_link(radio: RadioConfig, frames: int, seed: int = 1) -> list[str]:
    """What became of each of many frames at 20 Hz."""
    rng, state, fates = np.random.default_rng(seed), LinkState(), []
    for i in range(frames):
        state, fate = next_fate(state, radio, i * 50_000_000, rng)
        fates.append("lost" if fate.lost else "frozen" if fate.frozen else "broken" if fate.broken else "ok")
    return fates


def test_a_good_link_passes_everything() -> None:
    assert set(run_link(RadioConfig(), 200)) == {"ok"}


def test_losses_come_in_bursts_and_freezes_last() -> None:
    fates = run_link(RadioConfig(lost_probability=0.01, lost_burst_frames=4), 5000)
    lost = "".join("x" if fate == "lost" else "." for fate in fates)
    bursts = [len(b) for b in lost.split(".") if b]
    assert 25 < len(bursts) < 75
    assert 1 in bursts and 3 <= max(bursts) <= 8
    frozen = run_link(RadioConfig(frozen_probability=0.01, frozen_s=1.0), 5000)
    assert 0.03 < frozen.count("frozen") / 5000 < 0.2
    broken = run_link(RadioConfig(block_probability=0.1), 5000)
    assert 0.07 < broken.count("broken") / 5000 < 0.13


def test_the_seed_decides_and_settings_do_not_shift_each_other() -> None:
    both = RadioConfig(lost_probability=0.05, block_probability=0.1)
    assert run_link(both, 500) == run_link(both, 500)
    assert run_link(both, 500) != run_link(both, 500, seed=2)
    blocks = run_link(RadioConfig(block_probability=0.1), 500)
    assert all(a == b for a, b in zip(run_link(both, 500), blocks, strict=True) if a != "lost")
