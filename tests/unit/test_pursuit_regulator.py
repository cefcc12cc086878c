"""The regulator: its model against a fine integration, and its gains in closed loop, also where the model is wrong."""

from __future__ import annotations

import numpy as np
import pytest

from ground.pursuit.regulator import ERROR, OWN, VELOCITY, Response, make_gains, make_model

RESPONSE = Response(lag_s=0.1, delay_s=0.115, target_s=0.8)
PERIOD_S = 0.05


def integrated(response: Response, commands: list[float], start: np.ndarray) -> np.ndarray:
    """Error, relative velocity and own acceleration after each period, by steps of 0.1 ms; shape (n, 3)."""
    e, v, target, own, lagged = start
    out, h = [], 1e-4
    for k in range(len(commands)):
        for i in range(round(PERIOD_S / h)):
            index = int(np.floor((k * PERIOD_S + (i + 0.5) * h - response.delay_s) / PERIOD_S))
            u = commands[index] if index >= 0 else 0.0
            e, v = e + v * h, v + (target - own) * h
            target -= target / response.target_s * h
            own, lagged = own + (lagged - own) / response.lag_s * h, lagged + (u - lagged) / response.lag_s * h
        out.append((e, v, own))
    return np.array(out)


@pytest.mark.parametrize("delay_s", [0.0, 0.03, 0.05, 0.115])
def test_the_model_is_what_a_fine_integration_gives(delay_s: float) -> None:
    response = Response(0.1, delay_s, 0.8)
    model = make_model(response, PERIOD_S)
    start = np.array([0.5, -0.2, 0.7, 0.1, -0.3])
    commands = [1.0, -0.5, 0.3, 0.0, 2.0, 0.0, 0.0, -1.0]
    x = np.zeros(len(model.entry))
    x[:5] = start
    rows = []
    for command in commands:
        x = model.transition @ x + model.entry * command
        rows.append((x[ERROR], x[VELOCITY], x[OWN]))
    assert np.array(rows) == pytest.approx(integrated(response, commands, start), abs=2e-3)


@pytest.mark.parametrize("effort", [0.001, 0.003, 0.03])
@pytest.mark.parametrize("factor", [0.7, 1.0, 1.4])
def test_the_loop_is_stable_also_with_a_vehicle_that_is_slower_or_faster(effort: float, factor: float) -> None:
    gains = make_gains(make_model(RESPONSE, PERIOD_S), effort)
    real = make_model(Response(0.1 * factor, 0.115 * factor, 0.8), PERIOD_S)
    size = max(len(gains), len(real.entry))
    transition, entry = np.zeros((size, size)), np.zeros(size)
    transition[: len(real.entry), : len(real.entry)], entry[: len(real.entry)] = real.transition, real.entry
    for index in range(len(real.entry), size):
        transition[index, index - 1] = 1.0
    padded = np.concatenate((gains, np.zeros(size - len(gains))))
    assert np.abs(np.linalg.eigvals(transition - np.outer(entry, padded))).max() < 1.0


def test_less_effort_is_a_stiffer_loop() -> None:
    model = make_model(RESPONSE, PERIOD_S)
    assert make_gains(model, 0.003)[ERROR] < make_gains(model, 0.03)[ERROR] < 0.0


def test_a_response_without_a_lag_is_refused() -> None:
    with pytest.raises(ValueError, match="expected positive times"):
        make_model(Response(0.0, 0.1, 0.8), PERIOD_S)
