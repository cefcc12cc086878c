"""How what is out of view is carried on: with which velocity, for how long, and how uncertain its place becomes."""

from __future__ import annotations

import numpy as np

from onboard.limiter.config import LimiterConfig

Array = np.ndarray
STANDING_M_S = 0.2
"""What is slower stands."""
_MEAN_OVER_S = 1.0


def averaged(mean_m_s: Array, samples: Array, newest_m_s: Array, dt_s: Array | float) -> tuple[Array, Array]:
    """Velocity of an obstacle over about its last second in view, by exponential forgetting.

    While an obstacle is in view its newest velocity counts, error and all: the next sample mends it. Out of view an
    error would be carried on, and grow into metres; that of the mean is by the root of the samples smaller.

    Args:
        mean_m_s: mean so far, (..., 3), m/s.
        samples: how many it is worth, (...); 0 for none.
        newest_m_s: of a new sample, (..., 3), m/s.
        dt_s: time since the sample before, (...), s.

    Returns:
        The mean (..., 3), m/s, and how many samples it is worth, (...).
    """
    worth = samples * np.exp(-np.asarray(dt_s) / _MEAN_OVER_S) + 1.0
    return mean_m_s + (newest_m_s - mean_m_s) / worth[..., None], worth


def unsure_m(age_s: Array, samples: Array, config: LimiterConfig) -> Array:
    """How far from where it should be an obstacle may be, m, (...), by how long ago it was seen.

    Args:
        age_s: since it was seen, s, (...).
        samples: how many samples its velocity is the mean of, (...), at least 1.
        config: how fast it may stray, and how wrong the velocity of one sample may be.
    """
    stray, error = config.spread_m_s, config.velocity_error_m_s
    return np.maximum(age_s - config.stale_s, 0.0) * np.sqrt(stray * stray + error * error / samples)


def keep_s(ned_v_m_s: Array, nearest_m: Array, config: LimiterConfig, looks: bool) -> Array:
    """How long obstacles are kept without a new measurement, s, (...): longer, of a source that looks, those that stand
    or may be within h_max by now.

    Args:
        ned_v_m_s: their velocities, (..., 3), m/s.
        nearest_m: how near to the vehicle they may be by now, (...), m.
        config: both times.
        looks: whether their source would say so if they were gone.
    """
    longer = (ned_v_m_s * ned_v_m_s).sum(axis=-1) < STANDING_M_S**2
    longer |= nearest_m <= config.h_max_m
    return np.where(longer & looks, config.remember_s, config.keep_s)
