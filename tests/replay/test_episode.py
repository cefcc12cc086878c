"""The chase in one process: it holds, it is the same for a seed, and another tracker can fly it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.camshift import CamShiftTracker
from benchmarks.chase import drawn
from benchmarks.episode import Episode
from common.processes import load_config
from simulation.world.scenario import load_scenario

CHASE_S, BEGINNING_S = 12.0, 5.0


def _flown(
    seed: int, tracker: type[CamShiftTracker] | None = None, *overrides: str, duration_s: float = CHASE_S
) -> Episode:
    episode = Episode(load_config("kite", overrides), drawn(load_scenario("chase"), seed), seed)
    if tracker is not None:
        episode.use(tracker)
    episode.fly(duration_s)
    return episode


@pytest.fixture(scope="module")
def flown() -> Episode:
    return _flown(3)


def test_the_chase_holds(flown: Episode) -> None:
    assert flown.trace.column("error_m")[-100:].max() < 1.0, "it flies to the car and stays above it"
    assert flown.recorder.summary()["lost_s"] < 1.0
    assert flown.trace.column("target_m_s").max() > 0.5, "the car has to drive"
    assert flown.trace.column("seen")[5:].mean() > 0.9
    assert np.nanmedian(flown.trace.column("off_m")) < 0.15


def test_a_seed_is_one_flight(flown: Episode) -> None:
    again = _flown(3, duration_s=BEGINNING_S).trace

    assert len(again.rows) > 95
    for name in ("error_m", "yaw_error_rad", "height_m", "distance", "off_m"):
        np.testing.assert_array_equal(again.column(name), flown.trace.column(name)[: len(again.rows)])


def test_another_tracker_flies_the_same_road(flown: Episode) -> None:
    plain = _flown(3, CamShiftTracker, duration_s=BEGINNING_S).trace

    count = len(plain.rows)
    np.testing.assert_array_equal(plain.column("target_m_s"), flown.trace.column("target_m_s")[:count])
    assert not np.array_equal(plain.column("error_m"), flown.trace.column("error_m")[:count])
    assert plain.column("seen").mean() > 0.5


def test_both_forms_keep_close_to_the_car(flown: Episode) -> None:
    leaning = _flown(3, None, "pursuit.output=orientation")

    for trace in (flown.trace, leaning.trace):
        assert np.sqrt(np.mean(trace.column("error_m")[100:] ** 2)) < 0.2
        assert trace.column("seen")[5:].mean() > 0.9
    assert not np.array_equal(leaning.trace.column("error_m"), flown.trace.column("error_m")), "two ways to fly"


def test_a_height_half_too_large_returns_to_the_wanted_one() -> None:
    scenario = drawn(load_scenario("chase"), 3)
    size_m = math.sqrt(scenario.car.length_m * scenario.car.width_m)
    settings = ("altitude=scale", "altitude_m=4.0", f"target_size_m={size_m}", "sink_m_s=0.8")
    config = load_config("kite", [f"pursuit.{setting}" for setting in settings])
    episode = Episode(config, scenario, 3, height_m=6.0 + scenario.car.height_m)
    episode.fly(7.0)

    above_m = episode.trace.column("height_m") - scenario.car.height_m
    assert above_m[0] > 5.6
    assert above_m[-20:] == pytest.approx(np.full(20, 4.0), abs=0.4)
    assert above_m.min() > 3.5
    assert episode.trace.column("seen")[5:].mean() > 0.9
