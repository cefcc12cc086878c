"""The regulator of the orientation mode: gains from a model of how the vehicle answers, instead of by hand.

One axis of the relative motion of target and vehicle, both horizontal axes being alike:

    e' = v,   v' = a_target − a,   a_target' = −a_target / T        (Singer 1970, DOI 10.1109/TAES.1970.310128)
    a'' by two equal lags from the commanded acceleration, which acts after a delay

The paper's hierarchy (P on the position, eq. 9, inside it PI on the velocity) is the part of the gains on e and v; the
integral is the disturbance that `relative` estimates. What goes beyond the paper are the gains on the target's
acceleration, on the vehicle's own tilt and on the commands that are still under way: without them a loop with a third
of a second of lag is either slow or swings.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ERROR, VELOCITY, TARGET, OWN, LAGGED = range(5)
_MOTION = 5
_SWEEPS, _SETTLED = 5000, 1e-10
_TERMS = 24


@dataclass(frozen=True)
class Response:
    """How the vehicle answers an acceleration command."""

    lag_s: float
    """Time constant of each of two equal lags in series, s."""
    delay_s: float
    """From the capture of a picture until the command that it gave begins to act, s."""
    target_s: float
    """Time constant with which a target's acceleration fades, s."""


@dataclass(frozen=True)
class Model:
    """x[k+1] = transition x[k] + entry u[k]: error, relative velocity, accelerations, then the commands under way."""

    transition: Array
    """Shape (N, N)."""
    entry: Array
    """Shape (N,)."""


def make_model(response: Response, period_s: float) -> Model:
    """Exact discretisation for a command each period, held until the next one acts.

    Raises:
        ValueError: period or lag not positive, or a negative delay.
    """
    if period_s <= 0.0 or response.lag_s <= 0.0 or response.target_s <= 0.0 or response.delay_s < 0.0:
        raise ValueError(f"regulator: got {response} and a period of {period_s} s, expected positive times")
    whole = int(response.delay_s / period_s)
    rest_s = response.delay_s - whole * period_s
    before, before_entry = _propagated(response, rest_s)
    after, after_entry = _propagated(response, period_s - rest_s)
    size = _MOTION + whole + 1
    transition, entry = np.zeros((size, size)), np.zeros(size)
    transition[:_MOTION, :_MOTION] = after @ before
    transition[:_MOTION, size - 1] = after @ before_entry  # the oldest command acts until the next one does
    if whole:
        transition[:_MOTION, size - 2] += after_entry
    else:
        entry[:_MOTION] = after_entry
    entry[_MOTION] = 1.0
    for index in range(_MOTION + 1, size):
        transition[index, index - 1] = 1.0
    return Model(transition, entry)


def _propagated(response: Response, t_s: float) -> tuple[Array, Array]:
    """Transition (5, 5) of the motion over a time, and what a held command adds (5,)."""
    rates = np.zeros((_MOTION + 1, _MOTION + 1))
    rates[ERROR, VELOCITY] = 1.0
    rates[VELOCITY, TARGET], rates[VELOCITY, OWN] = 1.0, -1.0
    rates[TARGET, TARGET] = -1.0 / response.target_s
    rates[OWN, OWN], rates[OWN, LAGGED] = -1.0 / response.lag_s, 1.0 / response.lag_s
    rates[LAGGED, LAGGED], rates[LAGGED, _MOTION] = -1.0 / response.lag_s, 1.0 / response.lag_s
    total = term = np.eye(_MOTION + 1)
    for n in range(1, _TERMS):
        term = term @ rates * (t_s / n)
        total = total + term
    return total[:_MOTION, :_MOTION], total[:_MOTION, _MOTION]


def make_gains(model: Model, effort: float) -> Array:
    """Gains (N,) of u = −gains · x that minimise Σ e² + effort · u² (discrete Riccati equation, by iteration).

    Raises:
        ValueError: the iteration does not settle.
    """
    cost = np.zeros_like(model.transition)
    cost[ERROR, ERROR] = 1.0
    value = cost.copy()
    for _ in range(_SWEEPS):
        carried = model.entry @ value
        gains = (carried @ model.transition) / (effort + carried @ model.entry)
        update = cost + model.transition.T @ value @ (model.transition - np.outer(model.entry, gains))
        update = (update + update.T) / 2.0
        if np.abs(update - value).max() < _SETTLED * max(1.0, np.abs(update).max()):
            return gains
        value = update
    raise ValueError(f"regulator: no gains for an effort of {effort}; choose a larger one")
