"""How a vehicle answers a request, for one horizontal axis: the model that the chase law estimates and predicts with.

The states, both horizontal axes being alike, the target's acceleration as Singer 1970 (DOI 10.1109/TAES.1970.310128):

    e'  = u − v                     target less vehicle
    v'  = a + d                     vehicle's velocity; tilt, and what tilt does not explain (wind, drag)
    u'  = b,  b' = −b / T           target's velocity and acceleration
    a'  = (l − a) / τ               tilt, as the acceleration that it stands for: two equal lags from …
    l'  = (c + o − s − l) / τ       … what the autopilot commands, an offset, and its slanted horizon s, which is known
    d'  = −k (a + d),  o' = 0       drag grows with the velocity; beyond that, wind and offset wander
    n'  = −n / N                    error of the velocity estimate

With an acceleration request r the autopilot commands c = r. With a velocity request it closes its own loop:

    c  = P (r − v − n) − D (a + d),   o' = I (r − v − n)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ground.pursuit.config import PursuitConfig

Array = NDArray[np.float64]
Form = Literal["velocity", "orientation"]

ERROR, OWN_V, TARGET_V, TARGET_A, TILT, LAGGED, OFFSET, WIND, DOUBT = range(9)
SIZE = 9
STEP_S = 0.005
"""Time between two steps of a prediction, s."""
_TERMS = 16
_REQUEST, _SLANT = SIZE, SIZE + 1


@dataclass(frozen=True)
class Answer:
    """The model over one step of `STEP_S`: x' = transition x + request r + slant s."""

    transition: Array
    """Shape (9, 9)."""
    request: Array
    """What a request adds, shape (9,)."""
    slant: Array
    """What the slant of the autopilot's horizon adds, shape (9,)."""
    noise: Array
    """Covariance that a step adds, shape (9, 9)."""
    command: Array
    """What the autopilot commands in a state, m/s², shape (9,): c + o of the model …"""
    command_request: float
    """… and for a request, m/s² per unit of it."""


def make_answer(config: PursuitConfig, form: Form) -> Answer:
    """Exact discretisation of the model above.

    Args:
        config: lags, the autopilot's velocity loop, how much the target and the wind change.
        form: what is requested.
    """
    c = config
    rates = np.zeros((SIZE + 2, SIZE + 2))
    rates[ERROR, TARGET_V], rates[ERROR, OWN_V] = 1.0, -1.0
    rates[OWN_V, TILT] = rates[OWN_V, WIND] = 1.0
    rates[WIND, [TILT, WIND]] = -c.drag_1_s
    rates[TARGET_V, TARGET_A] = 1.0
    rates[TARGET_A, TARGET_A] = -1.0 / c.target_agility_s
    rates[TILT, TILT], rates[TILT, LAGGED] = -1.0 / c.tilt_lag_s, 1.0 / c.tilt_lag_s
    command = np.zeros(SIZE + 2)
    command[[OFFSET, _SLANT]] = 1.0, -1.0
    rates[DOUBT, DOUBT] = -1.0 / c.velocity_doubt_s
    if form == "orientation":
        command[_REQUEST] = 1.0
    else:
        loop = np.zeros(SIZE + 2)
        loop[[_REQUEST, OWN_V, DOUBT]] = 1.0, -1.0, -1.0
        command += c.autopilot_p_1_s * loop
        command[[TILT, WIND]] -= c.autopilot_d
        rates[OFFSET] += c.autopilot_i_1_s2 * loop
    rates[LAGGED] = command / c.tilt_lag_s
    rates[LAGGED, LAGGED] -= 1.0 / c.tilt_lag_s
    total = term = np.eye(SIZE + 2)
    for n in range(1, _TERMS):
        term = term @ rates * (STEP_S / n)
        total = total + term
    density = np.zeros(SIZE)
    density[TARGET_A] = 2.0 * c.target_agility_m_s2**2 / c.target_agility_s
    density[TILT] = density[LAGGED] = c.tilt_doubt_m_s2**2
    density[OFFSET] = c.offset_drift_m_s2**2
    density[WIND] = c.wind_drift_m_s2**2
    density[DOUBT] = 2.0 * c.velocity_doubt_m_s**2 / c.velocity_doubt_s
    return Answer(
        total[:SIZE, :SIZE],
        total[:SIZE, _REQUEST],
        total[:SIZE, _SLANT],
        np.diag(density * STEP_S),
        command[:SIZE],
        float(command[_REQUEST]),
    )
