"""The angle at which a state fits best, found by turning it."""

from __future__ import annotations

import numpy as np

from common.tracking.histogram import PSI, HistogramModel

_SWEPT = 4
"""Angles on either side that are tried."""


def best_turn(
    model: HistogramModel, frame: np.ndarray, mean: np.ndarray, gain: np.ndarray, thinning: int, sweep_rad: float
) -> float:
    """How far a mean state has to be turned to fit best, rad, within a sweep.

    A target that turns changes its histograms little at first: the likelihood of eq. 5 is so flat in the angle that the
    weighted mean lags behind a turn by half a radian. Its smallest distance does not.

    Args:
        model: what the target looks like.
        frame: (H, W, 3) uint8.
        mean: the state, (4,): x, y (px), psi (rad), 1/sqrt(A) (1/px).
        gain: (3,) factor on the picture's values that undoes the light.
        thinning: how often every other pixel is left out.
        sweep_rad: how far it is turned either way.
    """
    turns = np.arange(-_SWEPT, _SWEPT + 1) * (sweep_rad / _SWEPT)
    states = np.tile(mean, (len(turns), 1))
    states[:, PSI] += turns
    distances = model.distances(frame, states, gain, thinning)
    best = int(distances.argmin())
    if best in (0, len(turns) - 1):
        return float(turns[best])
    before, at, after = distances[best - 1 : best + 2]
    bend = before - 2.0 * at + after
    offset = 0.5 * (before - after) / bend if bend > 0.0 else 0.0
    return float(turns[best] + offset * (turns[1] - turns[0]))
