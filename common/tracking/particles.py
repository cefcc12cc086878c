"""The steps of CONDENSATION on weighted states (Teulière 2011, section II-C, fig. 5)."""

from __future__ import annotations

import math

import numpy as np

from common.tracking.histogram import PSI


def likelihood_weights(distances: np.ndarray, sharpness: float) -> np.ndarray:
    """Weights proportional to exp(-lambda d^2) (eq. 5), summing to one; distances and weights are (N,)."""
    # The smallest distance is taken out first: the weights are the same, and none underflows to 0 / 0.
    weights = np.exp(-sharpness * (distances**2 - np.min(distances) ** 2))
    return weights / weights.sum()


def systematic_resample(weights: np.ndarray, start: float) -> np.ndarray:
    """Indices (N,) of the drawn particles: each is drawn N times its weight, up to one more or less.

    Args:
        weights: (N,), summing to one.
        start: uniform random number in [0, 1) that places the comb.
    """
    comb = (np.arange(len(weights)) + start) / len(weights)
    return np.minimum(np.searchsorted(np.cumsum(weights), comb, side="right"), len(weights) - 1)


def expected_state(states: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, float]:
    """Weighted mean (4,) of states (N, 4), circular in psi, and the circular standard deviation of psi, rad."""
    mean = weights @ states
    cosine, sine = float(weights @ np.cos(states[:, PSI])), float(weights @ np.sin(states[:, PSI]))
    mean[PSI] = math.atan2(sine, cosine)
    return mean, math.sqrt(max(0.0, -2.0 * math.log(max(math.hypot(cosine, sine), 1e-9))))
