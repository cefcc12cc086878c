"""Accelerations against wind and drag: what only holds the speed does not lead beyond the largest one."""

from __future__ import annotations

import pytest

from onboard.helm.arbiter import Verdict
from onboard.helm.config import HelmConfig
from onboard.helm.containment import Resistance
from onboard.helm.pilot import Pilot
from onboard.helm.setpoint import AccelerationSetpoint
from onboard.helm.telemetry import AttitudeSample, PositionSample, Telemetry
from onboard.limiter.config import LimiterConfig
from onboard.limiter.map import NOTHING_KNOWN

_DT_S, _LEAN_S, _DRAG_1_S = 0.04, 0.3, 1.0


def _flown(wanted_m_s: float, wind_m_s: float, calm_from_s: float = 1e9) -> list[float]:
    """Ground speeds of a vehicle with the drag of PX4's own quadrotor, a chase holding a speed by accelerations."""
    pilot, t_ns, north_m, v, lean, total = Pilot(HelmConfig(), LimiterConfig()), 1_000_000_000, -50.0, 0.0, 0.0, 0.0
    speeds: list[float] = []
    for k in range(500):
        t_ns += 40_000_000
        telemetry = Telemetry(
            found=True,
            attitude=AttitudeSample(t_ns, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
            position=PositionSample(t_ns, (north_m, 0.0, -5.0), (v, 0.0, 0.0)),
            home_local_m=(0.0, 0.0, 0.0),
        )
        total += 0.8 * (wanted_m_s - v) * _DT_S
        asked = 1.8 * (wanted_m_s - v) + total
        verdict = Verdict("pursuit", (0.0, 0.0, 0.0), 0.0, 0.0, ned_a_m_s2=(asked, 0.0))
        flown = pilot.fly(verdict, telemetry, NOTHING_KNOWN, t_ns)
        assert flown is not None and isinstance(flown.local, AccelerationSetpoint)
        assert flown.local.north_m_s <= HelmConfig().containment.speed_m_s + 1e-9, "for an autopilot that takes only it"
        lean += (flown.local.north_m_s2 - lean) * _DT_S / _LEAN_S
        v += (lean - _DRAG_1_S * (v - (wind_m_s if k * _DT_S < calm_from_s else 0.0))) * _DT_S
        north_m += v * _DT_S
        speeds.append(v)
    return speeds


def test_an_acceleration_that_holds_the_speed_against_the_wind_is_flown():
    """2 m/s with 1.5 m/s of head wind take 3.5 m/s²: within half a second that would lead to 3.75 m/s, and does not."""
    speeds = _flown(2.0, -1.5)
    assert speeds[-1] == pytest.approx(2.0, abs=0.1)
    assert max(speeds) < 2.3


def test_the_largest_speed_holds_against_the_wind_and_when_it_drops():
    """With this drag it is not reached: all of what holds the vehicle back may end at once."""
    assert 2.5 < _flown(5.0, -0.5)[-1] < 2.7
    assert max(_flown(5.0, -0.5, calm_from_s=10.0)) < 2.8
    assert max(_flown(5.0, -1.5, calm_from_s=10.0)) < 2.8


def test_what_pushes_on_is_no_reason_to_ask_for_more():
    resistance = Resistance()
    for k in range(100):
        resistance.learn((0.04 * k, 0.0, 0.0), (0.0, 0.0), 0.04)  # 1 m/s² north, without being asked for
    still = (0.0, 0.0)
    assert resistance.against((2.0, 0.0), still, 3.0) == (0.0, 0.0)
    assert resistance.against((-2.0, 0.0), still, 3.0) == pytest.approx((-1.0, 0.0), abs=0.05)
    assert resistance.against((-0.5, 0.0), still, 3.0) == (-0.5, 0.0), "never more than was asked for"
    assert resistance.against((0.0, 2.0), still, 3.0) == (0.0, 0.0)
    resistance.reset()
    assert resistance.against((-2.0, 0.0), still, 3.0) == (0.0, 0.0)


def test_what_ends_at_once_is_forgotten_sooner_than_it_was_learnt_and_does_not_lead_beyond_the_largest_speed():
    resistance = Resistance()
    for _ in range(100):
        resistance.learn((2.0, 0.0, 0.0), (3.0, 0.0), 0.04)  # 3 m/s² hold 2 m/s
    assert resistance.against((3.0, 0.0), (2.0, 0.0), 3.0) == pytest.approx((3.0, 0.0), abs=0.01)
    granted, _ = resistance.against((3.0, 0.0), (2.9, 0.0), 3.0)
    assert granted == pytest.approx(0.5), "0.1 m/s in the 0.2 s until the end of it is noticed"
    assert resistance.against((3.0, 0.0), (3.1, 0.0), 3.0) == (0.0, 0.0)
    assert resistance.against((0.0, 3.0), (2.0, 0.0), 3.0) == pytest.approx((0.0, 0.0), abs=1e-9)
    for k in range(8):
        resistance.learn((2.0 + 0.12 * k, 0.0, 0.0), (3.0, 0.0), 0.04)  # all of it makes the vehicle faster
    assert resistance.against((3.0, 0.0), (2.0, 0.0), 3.0)[0] < 0.75
