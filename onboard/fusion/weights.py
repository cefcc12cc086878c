"""How far a source is trusted: the outlier weight, the vote, and the variance they give (Echeverri 2016, 4.2, 4.3)."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from scipy.stats import chi2

_LARGEST_EXPONENT = 700.0


def mahalanobis(innovation: np.ndarray, variance: np.ndarray) -> float:
    """Approximated Mahalanobis distance of an innovation (N,) with the diagonal (N,) of its covariance (eq. 4.3).

    It is the sum of the components' own distances, hence between the distance of eq. 4.2 and sqrt(N) times it.
    """
    return float(np.add.reduce(np.abs(innovation) / np.sqrt(variance)))


@cache
def outlier_switch(size: int, confidence: float) -> float:
    """Distance ζ/η at which eq. 4.4 switches, for N values: sqrt(N χ²_N(confidence)).

    That is the largest value of eq. 4.3 inside the ellipsoid that holds this share of healthy measurements.
    """
    return math.sqrt(size * float(chi2.ppf(confidence, size)))


def outlier_weight(distance: float, slope: float, zeta: float) -> float:
    """Weight w_M of a distance M, 0 to 1 (eq. 4.4); one half at M = ζ/η."""
    return 1.0 / (1.0 + math.exp(min(_LARGEST_EXPONENT, zeta - slope * distance)))


def vote_weight(distance: float, omega_0: float, omega: float, slope: float, lambda_: float) -> float:
    """Weight w_d of the distance to the nearest other source (eq. 4.7): from ω₀ to ω₀ + 2 ω, ω₀ + ω at λ/η."""
    return omega_0 + omega * (1.0 + math.tanh(slope * distance - lambda_))


def severity(ratio: float) -> float:
    """Factor on a penalty for a distance of so many times its switch: 1 up to there, then its fourth power.

    Both weights of the thesis are bounded, so the pull of a far measurement on the linear update would grow with its
    distance; with this it falls, and a source at infinity has none.
    """
    return min(max(1.0, ratio), 1e15) ** 4


def separations(points: np.ndarray, voters: np.ndarray) -> np.ndarray:
    """Distances (n, m) of each of n points (n, N) to each of m voters (m, N) (eq. 4.5)."""
    offsets = points[:, None, :] - voters[None, :, :]
    return np.sqrt(np.vecdot(offsets, offsets))


def combine(values: np.ndarray, variances: np.ndarray, correlation: float) -> tuple[np.ndarray, np.ndarray]:
    """Weighted mean (N,) of n measurements (n, N) with variances (n, N), and its variance (N,).

    Errors have the given correlation: n equal sources give R (ρ + (1 - ρ) / n). With unequal ones, n is Kish's
    effective number (ΣW)² / ΣW² of the weights W = 1 / R.
    """
    weights = 1.0 / variances
    total = np.add.reduce(weights)
    alone = (total * total) / np.add.reduce(weights * weights)
    return np.add.reduce(weights * values) / total, (1.0 + correlation * (alone - 1.0)) / total
