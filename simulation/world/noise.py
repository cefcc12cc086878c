"""What light, sensor and video link do to a picture: pure functions on frames (H, W, 3), BGR, uint8."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from simulation.world.scenario import LightConfig, RadioConfig, SensorConfig

Frame = NDArray[np.uint8]

_TILE_MARGIN_PX = 64
_TILE_BIAS = 128


def light_gain(light: LightConfig, t_s: float) -> tuple[float, float, float]:
    """Factors on blue, green and red at a world time, s."""
    time = t_s % light.repeat_s if light.repeat_s else t_s
    gain = np.array([light.gain * tint for tint in light.tint])
    for step in light.steps:
        if time < step.at_s:
            break
        target = np.array([step.gain * tint for tint in step.tint])
        share = min((time - step.at_s) / step.ramp_s, 1.0) if step.ramp_s else 1.0
        gain = gain + share * (target - gain)
    gain *= 1.0 + light.drift * np.sin(2 * np.pi * t_s / light.drift_period_s)
    return float(gain[2]), float(gain[1]), float(gain[0])


def exposure_gain(sensor: SensorConfig, seed: int, t_s: float) -> float:
    """Exposure factor at a world time, s: constant for an interval, then another one."""
    interval = int(t_s / sensor.exposure_interval_s)
    if not sensor.exposure_jump or interval <= 0:
        return 1.0
    rng = np.random.default_rng((seed, interval))
    return 1.0 + sensor.exposure_jump * float(rng.uniform(-1.0, 1.0))


def vignette_map(width: int, height: int, loss: float) -> Frame:
    """Brightness (height, width, 3), 0 to 255, that falls by `loss` (0 to 1) towards the corners, with the square of
    the distance from the centre."""
    y, x = np.mgrid[0:height, 0:width]
    radius = ((2 * x / (width - 1) - 1) ** 2 + (2 * y / (height - 1) - 1) ** 2) / 2
    return np.repeat(np.round(255 * (1 - loss * radius)).astype(np.uint8)[..., None], 3, axis=2)


def shade(frame: Frame, bgr_gain: tuple[float, float, float], vignette: Frame | None) -> Frame:
    """Frame under a light and behind a vignette (None: none), clipped at white."""
    common = max(bgr_gain)
    tint = tuple(g / common if common > 0 else 0.0 for g in bgr_gain)
    if vignette is not None:
        frame = cv2.multiply(frame, vignette, scale=common / 255).astype(np.uint8, copy=False)
    elif abs(common - 1.0) > 1e-3:
        frame = cv2.convertScaleAbs(frame, alpha=common).astype(np.uint8, copy=False)
    if min(tint) < 0.999:
        frame = cv2.multiply(frame, np.array([*tint, 0.0])).astype(np.uint8, copy=False)
    return frame


def noise_tile(rng: np.random.Generator, width: int, height: int, sigma: float) -> Frame:
    """Gaussian noise around 128, a little larger than a frame, to be added at a random offset each time.

    Args:
        rng: source of randomness.
        width: columns of the frames, px.
        height: rows of the frames, px.
        sigma: standard deviation, grey levels.
    """
    shape = (height + _TILE_MARGIN_PX, width + _TILE_MARGIN_PX, 3)
    noise = rng.standard_normal(shape, dtype=np.float32) * sigma + _TILE_BIAS
    return np.clip(np.round(noise), 0, 255).astype(np.uint8)


def add_noise(frame: Frame, tile: Frame, rng: np.random.Generator) -> Frame:
    """Frame with sensor noise from a tile of `noise_tile`."""
    row, column = (int(i) for i in rng.integers(0, _TILE_MARGIN_PX, 2))
    part = tile[row : row + frame.shape[0], column : column + frame.shape[1]]
    return cv2.addWeighted(frame, 1.0, part, 1.0, -_TILE_BIAS).astype(np.uint8, copy=False)


def break_blocks(frame: Frame, radio: RadioConfig, rng: np.random.Generator) -> Frame:
    """Copy of a frame with runs of broken blocks, as a link leaves them that lost part of a picture.

    Each run lies in one row of blocks and is grey, smeared from its first block, taken from elsewhere, or noise.
    """
    out = frame.copy()
    side = radio.block_px
    rows, columns = frame.shape[0] // side, frame.shape[1] // side
    for _ in range(radio.block_count):
        row, start = int(rng.integers(rows)) * side, int(rng.integers(columns))
        length = min(int(rng.integers(1, 9)), columns - start)
        left, right = start * side, (start + length) * side
        part = out[row : row + side, left:right]
        kind = int(rng.integers(4))
        if kind == 0:
            part[:] = 128
        elif kind == 1:
            part[:] = np.tile(frame[row : row + side, left : left + side], (1, length, 1))
        elif kind == 2:
            other = int(rng.integers(rows)) * side
            part[:] = frame[other : other + side, left:right]
        else:
            coarse = rng.integers(0, 256, (2, 2 * length, 3), dtype=np.uint8)
            part[:] = cv2.resize(coarse, (right - left, side), interpolation=cv2.INTER_NEAREST)
    return out
