"""Measuring a step response: shares, crossings, PX4's ranges, and the loop that was fitted to PX4."""

from __future__ import annotations

import math

import pytest

from simulation.autopilot.plant import PlantState
from simulation.autopilot.response import CASES, DT_S, Band, crossing_s, fitted_loop, measured, shares

BY_NAME = {case.name: case for case in CASES}


def test_a_band_measures_to_its_nearer_end() -> None:
    assert Band(1.2, 1.5).deviation(1.3) == 0.0
    assert Band(1.2, 1.5).deviation(1.08) == pytest.approx(-0.1)
    assert Band(1.2, 1.5).deviation(1.8) == pytest.approx(0.2)
    assert Band(8.0, math.inf).deviation(math.inf) == 0.0
    assert Band(8.0, math.inf).nominal == 8.0


def test_a_crossing_lies_between_two_cycles() -> None:
    response = [0.0, 0.0, 0.4, 0.8]

    assert crossing_s(response, 0.1) == pytest.approx(1.25 * DT_S)
    assert crossing_s(response, 0.8) == pytest.approx(3.0 * DT_S)
    assert crossing_s(response, 0.9) == math.inf
    assert crossing_s([0.5], 0.5) == 0.0


def test_the_fitted_loop_is_near_px4_by_its_own_figures() -> None:
    """A mistake in its equations would show here: it fits PX4 within 2 to 4 % RMS, worse at the ends."""
    for name in ("start_default", "stop_default", "start_low", "stop_low"):
        case = BY_NAME[name]
        speeds = fitted_loop(case)
        size = 2.0 if case.before is None else -speeds[0]
        response = [(v - speeds[0]) / size for v in speeds]
        assert len(response) == round(case.duration_s / DT_S) + 1
        for figure, share in {"t50_s": 0.5, "t63_s": 0.63, "t90_s": 0.9}.items():
            if figure in case.px4:
                assert abs(case.px4[figure].deviation(crossing_s(response, share))) < 0.20, (name, figure)


def test_a_stop_is_measured_by_the_speed_that_was_there() -> None:
    case = BY_NAME["stop_default"]
    states = [PlantState(ned_v_m_s=(1.6 - 0.4 * i, 0.0, 0.0), ned_p_m=(0.1 * i, 0.0, 0.0)) for i in range(5)]

    assert shares(case, states) == pytest.approx([0.0, 0.25, 0.5, 0.75, 1.0])
    found = measured(case, states)
    assert found["t50_s"] == pytest.approx(2.0 * DT_S)
    assert found["stop_distance_m"] == pytest.approx(0.4)
