"""The benchmark of step responses: every figure of PX4 is measured, noise is the seed's, the plot is drawn."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from benchmarks import autopilot
from benchmarks.base import Settings, as_json
from simulation.autopilot.response import CASES

FLIGHTS = 2


def test_it_measures_what_px4_has(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(autopilot, "_QUICK_NOISY_FLIGHTS", FLIGHTS)
    settings = Settings(seed=3, quick=True, plots=tmp_path)

    outcome = autopilot.run(settings)

    assert set(outcome.paper) <= set(outcome.results)
    assert len(outcome.paper) == sum(len(case.px4) for case in CASES)
    assert all(math.isfinite(value) for value in outcome.results.values())
    for name in ("start_default", "stop_default", "start_low", "stop_low"):
        assert 0.0 < outcome.results[f"rms_percent_{name}"] < 4.0
    assert outcome.results["noise_std_t63_s_start_low"] > 0.0
    assert sum("rms_percent" in line for line in outcome.table) == 4
    assert (tmp_path / "autopilot.png").stat().st_size > 20_000
    assert json.loads(as_json(autopilot.BENCHMARK, settings, outcome))["baseline"]["ratio"] == pytest.approx(1, abs=0.1)
