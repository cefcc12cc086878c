"""The regulator: gains from the model of how the vehicle answers, instead of by hand.

What is weighed against the distance to the target is how fast the request changes, not the request: so wind, drag and
the autopilot's integral cost nothing, and no distance is left with them. The paper's hierarchy (P on the position,
eq. 9, inside it PI on the velocity) is the part of the gains on distance, relative velocity and wind. What goes beyond
the paper are the gains on the target's acceleration and on the vehicle's own tilt: without them a loop with a third of
a second of lag is either slow or swings.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ground.pursuit.answer import ERROR, SIZE, STEP_S, Answer

Array = NDArray[np.float64]

_SWEEPS, _SETTLED = 20000, 1e-9


def make_gains(answer: Answer, period_s: float, effort: float) -> Array:
    """Gains (10,) of Δr = −gains · (x, r) that minimise ∫ e² + effort · (dr/dt)², r being the request.

    The discrete Riccati equation, by iteration: the uncontrollable integrators of the model (a steady target, a steady
    wind) forbid the usual solvers, and their cost is finite all the same.

    Args:
        answer: how the vehicle answers.
        period_s: time between two requests, s.
        effort: weight, in m² per square of the request's rate.

    Raises:
        ValueError: a weight or a period that is not positive, or the iteration does not settle.
    """
    if effort <= 0.0 or period_s < STEP_S:
        raise ValueError(f"regulator: got an effort of {effort} and a period of {period_s} s, expected more")
    transition, entry = np.eye(SIZE + 1), np.zeros(SIZE + 1)
    step = np.eye(SIZE + 1)
    step[:SIZE, :SIZE], step[:SIZE, SIZE] = answer.transition, answer.request
    for _ in range(round(period_s / STEP_S)):
        transition = step @ transition
    entry = transition[:, SIZE].copy()
    cost = np.zeros_like(transition)
    cost[ERROR, ERROR] = period_s
    price = effort / period_s
    value, last = cost.copy(), np.zeros(SIZE + 1)
    for _ in range(_SWEEPS):
        carried = entry @ value
        gains = (carried @ transition) / (price + carried @ entry)
        closed = transition - np.outer(entry, gains)
        value = cost + closed.T @ value @ closed + price * np.outer(gains, gains)
        value = (value + value.T) / 2.0
        if np.abs(gains - last).max() < _SETTLED * max(1.0, np.abs(gains).max()):
            return gains
        last = gains
    raise ValueError(f"regulator: no gains for an effort of {effort}; choose a larger one")
