"""Figures of a step response: when shares are reached, overshoot, way. Arrays in, numbers out."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np


def crossing_s(times_s: Sequence[float], values: Sequence[float], level: float) -> float:
    """Time at which a rising signal first reaches a level, linearly between samples, s; infinite when never."""
    for index, value in enumerate(values):
        if value >= level:
            if index == 0:
                return times_s[0]
            share = (value - level) / (value - values[index - 1])
            return times_s[index] - share * (times_s[index] - times_s[index - 1])
    return math.inf


def value_at(times_s: Sequence[float], values: Sequence[float], t_s: float) -> float:
    """Mean of a signal within 0.15 s of a time, NaN without samples."""
    t, v = np.asarray(times_s), np.asarray(values)
    near = v[np.abs(t - t_s) <= 0.15]
    return float(near.mean()) if near.size else math.nan


def integral(times_s: Sequence[float], values: Sequence[float], until_s: float) -> float:
    """Integral of a signal from 0 to a time by trapezoids: the way of a speed."""
    t, v = np.asarray(times_s), np.asarray(values)
    inside = (t >= 0.0) & (t <= until_s)
    return float(np.trapezoid(v[inside], t[inside])) if inside.any() else math.nan


def deviation(got_s: dict[float, float], expected_s: dict[float, float]) -> float:
    """Mean relative deviation of the shares that were reached, for choosing the reference that fits."""
    shares = [abs(got_s[k] / expected_s[k] - 1.0) for k in expected_s if math.isfinite(got_s.get(k, math.inf))]
    return sum(shares) / len(shares) if shares else math.inf
