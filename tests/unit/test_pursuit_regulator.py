"""The vehicle's answer against a fine integration, and the regulator's gains in closed loop, also where it is wrong."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from ground.pursuit.answer import (
    DOUBT,
    ERROR,
    LAGGED,
    OFFSET,
    OWN_V,
    SIZE,
    STEP_S,
    TARGET_A,
    TARGET_V,
    TILT,
    WIND,
    Answer,
    Form,
    make_answer,
)
from ground.pursuit.config import PursuitConfig
from ground.pursuit.regulator import make_gains

CONFIG, PERIOD_S = PursuitConfig(), 0.05
FORMS: tuple[Form, ...] = ("velocity", "orientation")


def integrated(x: np.ndarray, request: float, slant: float, form: Form, duration_s: float) -> np.ndarray:
    """State (9,) after a time, by Euler steps of 20 microseconds."""
    c, x, h = CONFIG, x.copy(), 2e-5
    for _ in range(round(duration_s / h)):
        error = request - x[OWN_V] - x[DOUBT]
        change = x[TILT] + x[WIND]
        command, drift = request, 0.0
        if form == "velocity":
            command, drift = c.autopilot_p_1_s * error - c.autopilot_d * change, c.autopilot_i_1_s2 * error
        rates = np.zeros(SIZE)
        rates[ERROR], rates[OWN_V] = x[TARGET_V] - x[OWN_V], change
        rates[TARGET_V], rates[TARGET_A] = x[TARGET_A], -x[TARGET_A] / c.target_agility_s
        rates[TILT] = (x[LAGGED] - x[TILT]) / c.tilt_lag_s
        rates[LAGGED] = (command + x[OFFSET] - slant - x[LAGGED]) / c.tilt_lag_s
        rates[WIND] = -c.drag_1_s * change
        rates[OFFSET], rates[DOUBT] = drift, -x[DOUBT] / c.velocity_doubt_s
        x = x + rates * h
    return x


@pytest.mark.parametrize("form", FORMS)
def test_the_answer_is_what_a_fine_integration_gives(form: Form) -> None:
    answer, request, slant = make_answer(CONFIG, form), 0.7, -0.2
    start = np.array([0.5, 0.8, 1.1, -0.4, 0.3, -0.6, 0.2, -0.3, 0.05])
    x = start
    for _ in range(round(0.1 / STEP_S)):
        x = answer.transition @ x + answer.request * request + answer.slant * slant
    assert x == pytest.approx(integrated(start, request, slant, form, 0.1), abs=1e-3)


def closed_loop(answer: Answer, gains: np.ndarray) -> np.ndarray:
    """Transition (10, 10) of state and request over a period, the request changed by the gains at its beginning."""
    step, change = np.eye(SIZE + 1), np.eye(SIZE + 1)
    step[:SIZE, :SIZE], step[:SIZE, SIZE] = answer.transition, answer.request
    change[SIZE] -= gains
    return np.linalg.matrix_power(step, round(PERIOD_S / STEP_S)) @ change


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("effort", [1e-4, 1e-3, 1e-2])
@pytest.mark.parametrize("factor", [0.7, 1.0, 1.4])
def test_the_distance_dies_away_also_with_a_vehicle_that_is_slower_or_faster(
    form: Form, effort: float, factor: float
) -> None:
    gains = make_gains(make_answer(CONFIG, form), PERIOD_S, effort)
    real = msgspec.structs.replace(CONFIG, tilt_lag_s=CONFIG.tilt_lag_s * factor)
    loop = closed_loop(make_answer(real, form), gains)
    start = np.array([0.5, 0.0, 1.0, 0.3, 0.0, 0.0, 0.1, -0.3, 0.0, 0.0])  # a steady target and a steady wind
    late = np.linalg.matrix_power(loop, round(20.0 / PERIOD_S)) @ start
    assert abs(late[ERROR]) < 1e-3
    assert abs(late[OWN_V] - late[TARGET_V]) < 1e-3


def test_less_effort_is_a_stiffer_loop() -> None:
    answer = make_answer(CONFIG, "orientation")
    assert make_gains(answer, PERIOD_S, 1e-4)[ERROR] < make_gains(answer, PERIOD_S, 1e-2)[ERROR] < 0.0


def test_an_effort_or_a_period_of_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="expected more"):
        make_gains(make_answer(CONFIG, "velocity"), PERIOD_S, 0.0)
