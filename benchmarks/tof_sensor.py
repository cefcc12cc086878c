"""What a time-of-flight camera with a range of a metre reads (Echeverri 2016, 3.4)."""

from __future__ import annotations

import numpy as np

RANGE_M = 1.0
"""Distance up to which it reads depths."""
_FADE_M = 0.06
"""Over about this distance around that the pixels lose their depth, m."""
_MOST_TIMES = 2.0
"""Ranges beyond which its noise grows no more."""
_FALSE_M = (0.3, 1.2)
"""Where the false depths of things beyond its range lie, m."""


def read_depths(rng: np.random.Generator, depth_m: np.ndarray, shared_m: float = 0.0) -> np.ndarray:
    """Depths that it reads: fewer and noisier pixels towards its range, false ones beyond; of any shape, m, 0 for none.

    Args:
        rng: draws the errors.
        depth_m: true depths, m.
        shared_m: standard deviation of an error that all pixels of the picture have, m.
    """
    noise = 0.01 + 0.04 * np.minimum(depth_m / RANGE_M, _MOST_TIMES) ** 4
    read = depth_m + noise * rng.standard_normal(depth_m.shape)
    if shared_m > 0.0:
        read = read + shared_m * rng.standard_normal()
    beyond = np.clip((depth_m - RANGE_M) / (_FADE_M / 2), -40.0, 40.0)
    valid = rng.random(depth_m.shape) < 0.03 + 0.93 / (1.0 + np.exp(beyond))
    false = rng.random(depth_m.shape) < 0.5 / (1.0 + np.exp(-beyond))
    read = np.where(false, rng.uniform(*_FALSE_M, depth_m.shape), read)
    return np.where(valid, np.maximum(read, 0.05), 0.0)
