"""Failing sensors: what the estimate does, what telemetry says, where the vehicle goes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import pytest

from common.config import ConfigError, build
from simulation.autopilot.config import AutopilotSimConfig
from simulation.autopilot.motion import heading
from tests.unit.autopilot_rig import Rig

INJECT = 420
MAG, BARO, GPS = 2.0, 3.0, 4.0
NONE, OFF, STUCK, WRONG = 0.0, 1.0, 2.0, 4.0


@pytest.fixture
def rig() -> Iterator[Rig]:
    rig = Rig(parameters={"SYS_FAILURE_EN": 1, "MIS_TAKEOFF_ALT": 10.0, "COM_OBL_RC_ACT": 5})
    yield rig
    rig.close()


def offboard(rig: Rig, duration_s: float, vx: float = 0.0) -> None:
    """A stream of northward velocities at 20 Hz, in OFFBOARD from its start."""
    for index in range(round(duration_s * 20)):
        rig.companion.setpoint(0x5E3, z=-10.0, vx=vx)
        if index == 2:
            rig.companion.command(176, 1.0, 6.0)
        rig.run(0.05)


def health(rig: Rig) -> int:
    return rig.companion.got("SYS_STATUS")[-1].onboard_control_sensors_health


def clear(rig: Rig) -> None:
    rig.companion.inbox.clear()


def test_failures_are_injected_only_where_the_parameter_lets_them() -> None:
    rig = Rig()
    try:
        rig.run(3.0)
        rig.companion.command(INJECT, GPS, OFF)
        rig.run(0.1)
        rig.vehicle.parameters.set("SYS_FAILURE_EN", 1)
        rig.companion.command(INJECT, GPS, OFF)
        rig.companion.command(INJECT, 104.0, OFF)
        rig.companion.command(INJECT, GPS, 99.0)
        rig.run(0.1)
        assert rig.companion.acks(INJECT) == [2, 0, 3, 3]
    finally:
        rig.close()


def test_lost_gnss_drifts_then_silences_the_position_and_offboard_descends(rig: Rig) -> None:
    rig.take_off()
    rig.run(5.0)
    offboard(rig, 3.0, vx=1.0)
    rig.companion.command(INJECT, GPS, OFF)
    offboard(rig, 4.5, vx=1.0)
    assert rig.vehicle.modes.mode.name == "OFFBOARD", "it flies on by dead reckoning"
    error_m = math.dist(rig.vehicle.truth.ned_p_m[:2], rig.vehicle.estimate.ned_p_m[:2])
    assert error_m == pytest.approx(0.5 * 0.1 * 4.5**2, abs=0.3)
    clear(rig)
    offboard(rig, 2.0, vx=1.0)
    assert rig.vehicle.modes.mode.name == "DESCEND"
    clear(rig)
    offboard(rig, 2.0, vx=1.0)
    assert not rig.companion.got("LOCAL_POSITION_NED") and not rig.companion.got("GLOBAL_POSITION_INT")
    assert not rig.companion.got("GPS_RAW_INT") and rig.companion.got("ATTITUDE")
    assert not health(rig) & 32 and not health(rig) & 1 << 28
    beat = rig.companion.got("HEARTBEAT")[-1]
    assert (beat.custom_mode, beat.system_status) == (0x06040000, 5)
    rig.run(20.0)
    assert rig.vehicle.truth.on_ground and not rig.vehicle.modes.armed


def test_position_and_offboard_come_back_with_the_receiver(rig: Rig) -> None:
    rig.take_off()
    rig.run(5.0)
    offboard(rig, 1.0)
    rig.companion.command(INJECT, GPS, STUCK)
    offboard(rig, 5.5)
    assert rig.vehicle.modes.mode.name == "DESCEND"
    fixes = {(m.lat, m.lon, m.time_usec) for m in rig.companion.got("GPS_RAW_INT")[-8:]}
    assert len(fixes) == 1, "a stuck receiver repeats itself"
    rig.companion.command(INJECT, GPS, NONE)
    for _ in range(20):
        rig.companion.setpoint(0x5E3, z=-10.0)
        rig.run(0.05)
    assert rig.vehicle.modes.mode.name == "OFFBOARD"
    assert math.dist(rig.vehicle.truth.ned_p_m[:2], rig.vehicle.estimate.ned_p_m[:2]) < 0.3


def test_a_wrong_receiver_is_believed_and_drags_a_holding_vehicle_away(rig: Rig) -> None:
    rig.take_off()
    rig.run(5.0)
    start = rig.vehicle.truth.ned_p_m
    rig.companion.command(INJECT, GPS, WRONG)
    rig.run(10.0)
    assert math.dist(start[:2], rig.vehicle.truth.ned_p_m[:2]) > 6.0
    assert health(rig) & 32 and rig.vehicle.modes.mode.name == "HOLD"


@pytest.mark.parametrize(("kind", "expected_rad"), [(OFF, 0.1), (STUCK, 0.1), (WRONG, 0.5)])
def test_without_a_compass_the_heading_is_wrong(rig: Rig, kind: float, expected_rad: float) -> None:
    rig.take_off()
    rig.run(3.0)
    rig.companion.command(INJECT, MAG, kind)
    rig.run(10.0)
    error = math.remainder(heading(rig.vehicle.estimate.ned_q_body) - heading(rig.vehicle.truth.ned_q_body), math.tau)
    assert abs(error) == pytest.approx(expected_rad, abs=0.02)
    assert bool(health(rig) & 4) is (kind != OFF)
    rig.companion.command(INJECT, MAG, NONE)
    rig.run(10.0)
    error = heading(rig.vehicle.estimate.ned_q_body) - heading(rig.vehicle.truth.ned_q_body)
    assert abs(error) < 0.02


def test_a_wrong_barometer_takes_the_height_with_it(rig: Rig) -> None:
    rig.take_off()
    rig.run(5.0)
    before = rig.vehicle.truth.ned_p_m[2]
    rig.companion.command(INJECT, BARO, WRONG)
    rig.run(10.0)
    assert before - rig.vehicle.truth.ned_p_m[2] == pytest.approx(3.0, abs=0.7)


def test_failures_come_at_their_time_from_the_configuration() -> None:
    failures: Any = [{"at_s": 20.0, "sensor": "gps"}, {"at_s": 21.0, "sensor": "gps", "kind": "none"}]
    rig = Rig(failures=failures)
    try:
        rig.run(19.9)
        assert health(rig) & 32
        rig.run(0.5)
        assert not health(rig) & 32
        rig.run(1.0)
        assert health(rig) & 32
    finally:
        rig.close()


def test_a_mistyped_failure_is_refused() -> None:
    with pytest.raises(ConfigError, match="sensor"):
        build(AutopilotSimConfig, {"failures": [{"at_s": 1.0, "sensor": "gnss"}]}, "test")
