"""A pilot flies the simulated autopilot by MANUAL_CONTROL."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest

from simulation.autopilot.motion import heading
from simulation.autopilot.plant import down_axis
from tests.unit.autopilot_rig import Rig

MANUAL, ALTITUDE, POSITION, ACRO, STABILIZED = 1.0, 2.0, 3.0, 5.0, 7.0
PERIOD_S = 0.04  # 25 Hz, as a ground station sends its joystick


@pytest.fixture
def rig() -> Iterator[Rig]:
    rig = Rig(drag_n_s_m=0.1, parameters={"MIS_TAKEOFF_ALT": 8.0})
    yield rig
    rig.close()


def hold(rig: Rig, duration_s: float, **sticks: float) -> None:
    """The pilot holds the sticks there."""
    for _ in range(round(duration_s / PERIOD_S)):
        rig.station.sticks(**sticks)
        rig.run(PERIOD_S)


def airborne_in(rig: Rig, main: float) -> None:
    rig.take_off()
    rig.run(2.0)
    hold(rig, 0.4)
    rig.station.command(176, 1.0, main)
    hold(rig, 0.4)
    assert rig.station.acks(176) == [0]


def last_beat(rig: Rig) -> tuple[int, int]:
    beat = rig.companion.got("HEARTBEAT")[-1]
    return beat.base_mode, beat.custom_mode >> 16


@pytest.mark.parametrize("main", [MANUAL, ALTITUDE, POSITION, ACRO, STABILIZED])
def test_manual_modes_need_sticks_and_show_px4_numbers(rig: Rig, main: float) -> None:
    rig.run(4.6)
    rig.station.command(176, 1.0, main)
    rig.run(0.1)
    assert rig.station.acks(176) == [1]
    hold(rig, 0.2, throttle=-1.0)
    rig.station.command(176, 1.0, main)
    hold(rig, 1.2, throttle=-1.0)
    assert rig.station.acks(176) == [1, 0]
    assert last_beat(rig) == (65 if main == ACRO else 81, int(main))
    rig.station.command(400, 1.0)
    hold(rig, 1.2, throttle=-1.0)
    assert rig.station.acks(400) == [0]
    assert last_beat(rig)[0] == (193 if main == ACRO else 209)


@pytest.mark.parametrize("mode", [0, 4])
def test_com_rc_in_mode_can_shut_the_joystick_out(rig: Rig, mode: int) -> None:
    rig.vehicle.parameters.set("COM_RC_IN_MODE", mode)
    rig.run(4.6)
    hold(rig, 0.4)
    rig.station.command(176, 1.0, POSITION)
    rig.run(0.1)
    assert rig.station.acks(176) == [1]


def test_position_mode_flies_with_the_sticks_and_stays_where_they_are_let_go(rig: Rig) -> None:
    airborne_in(rig, POSITION)
    hold(rig, 6.0, pitch=0.5)
    shaped = 0.4 * (0.4 / 0.9) + 0.6 * (0.4 / 0.9) ** 3  # dead zone and expo
    assert rig.vehicle.truth.ned_v_m_s[0] == pytest.approx(10.0 * shaped, rel=0.15)
    assert abs(rig.vehicle.truth.ned_v_m_s[1]) < 0.3
    hold(rig, 5.0)
    place = rig.vehicle.truth.ned_p_m
    hold(rig, 5.0, roll=0.05)  # within the dead zone
    assert math.dist(place, rig.vehicle.truth.ned_p_m) < 0.5
    hold(rig, 3.0, throttle=1.0)
    assert rig.vehicle.truth.ned_v_m_s[2] == pytest.approx(-3.0, abs=0.4)
    hold(rig, 2.0, yaw=0.5)
    assert rig.vehicle.truth.body_rates_rad_s[2] == pytest.approx(math.radians(150.0) * shaped, rel=0.1)


def test_altitude_mode_tilts_with_the_sticks_and_keeps_the_height(rig: Rig) -> None:
    airborne_in(rig, ALTITUDE)
    hold(rig, 3.0, roll=0.5)
    tilt = math.degrees(math.acos(down_axis(rig.vehicle.truth.ned_q_body)[2]))
    assert tilt == pytest.approx(17.5, abs=1.5)
    assert rig.vehicle.truth.ned_v_m_s[1] > 5.0
    hold(rig, 3.0)
    assert rig.vehicle.truth.ned_v_m_s[1] > 3.0, "nobody brakes"
    assert -rig.vehicle.truth.ned_p_m[2] == pytest.approx(8.0, abs=1.0)


def test_stabilized_keeps_the_attitude_and_leaves_the_height_to_the_pilot(rig: Rig) -> None:
    airborne_in(rig, STABILIZED)
    hold(rig, 2.0, throttle=0.0)
    level = -rig.vehicle.truth.ned_v_m_s[2]
    assert abs(level) < 0.5
    hold(rig, 1.0, throttle=0.3)
    assert -rig.vehicle.truth.ned_v_m_s[2] > level + 1.0
    hold(rig, 1.0, pitch=1.0)
    tilt = math.degrees(math.acos(down_axis(rig.vehicle.truth.ned_q_body)[2]))
    assert tilt == pytest.approx(35.0, abs=2.0)


def test_acro_turns_at_the_rate_of_the_sticks_and_does_not_level(rig: Rig) -> None:
    airborne_in(rig, ACRO)
    hold(rig, 1.2, yaw=0.5)
    assert rig.vehicle.truth.body_rates_rad_s[2] == pytest.approx(math.radians(50.0), rel=0.1)
    hold(rig, 0.4, roll=0.3)
    hold(rig, 0.6)
    tilt = math.degrees(math.acos(down_axis(rig.vehicle.truth.ned_q_body)[2]))
    assert tilt > 6.0


def test_a_pilot_takes_off_and_lands_in_position_mode(rig: Rig) -> None:
    rig.run(4.6)
    hold(rig, 0.4, throttle=-1.0)
    rig.station.command(176, 1.0, POSITION)
    rig.station.command(400, 1.0)
    hold(rig, 2.0, throttle=-1.0)
    assert rig.vehicle.truth.on_ground and rig.vehicle.modes.armed
    hold(rig, 4.0, throttle=0.8)
    assert -rig.vehicle.truth.ned_p_m[2] > 2.0
    hold(rig, 12.0, throttle=-1.0)
    assert rig.vehicle.truth.on_ground and not rig.vehicle.modes.armed


def test_a_resting_hand_takes_nothing_over_and_a_moving_one_takes_the_vehicle_from_hold(rig: Rig) -> None:
    rig.take_off()
    rig.run(2.0)
    hold(rig, 2.0, pitch=0.02)
    assert rig.vehicle.modes.mode.name == "HOLD"
    for index in range(20):
        rig.station.sticks(pitch=min(0.1 * index, 1.0))
        rig.run(PERIOD_S)
    assert rig.vehicle.modes.mode.name == "POSITION"
    yaw = heading(rig.vehicle.truth.ned_q_body)
    hold(rig, 2.0, pitch=1.0)
    n, e, _ = rig.vehicle.truth.ned_v_m_s
    assert n * math.cos(yaw) + e * math.sin(yaw) > 3.0


def test_sticks_that_fall_silent_hold_and_then_return(rig: Rig) -> None:
    airborne_in(rig, POSITION)
    hold(rig, 2.0, pitch=0.5)
    rig.run(0.45)
    assert rig.vehicle.modes.mode.name == "POSITION"
    rig.run(0.2)
    assert rig.vehicle.modes.mode.name == "HOLD" and rig.vehicle.modes.failsafe
    rig.run(5.0)
    assert rig.vehicle.modes.mode.name == "RETURN"
