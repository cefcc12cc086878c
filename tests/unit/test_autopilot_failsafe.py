"""Failsafes of the autopilot's mode machine: causes, delay, takeover, and what is flown when nothing better can be."""

from __future__ import annotations

from typing import Any

import pytest

from simulation.autopilot.flight_modes import Mode, Situation, Verdict
from simulation.autopilot.modes import ModeMachine
from simulation.autopilot.parameters import Parameters
from tests.unit.autopilot_rig import Rig

STEP_S = 0.1


class Flight:
    """A machine that is armed and in the air since 10 s, with a situation that the test changes."""

    def __init__(self, mode: Mode = Mode.HOLD, parameters: dict[str, float] | None = None, **at_arming: Any):
        self.modes = ModeMachine(Parameters(parameters or {}))
        self.now = Situation(9.0, True, True, 0.0, **at_arming)
        assert self.modes.arm(self.now) is Verdict.ACCEPTED
        self.now = self.now._replace(landed=False)
        self.modes.update(self.now)
        assert self.modes.command(mode, self.now) is Verdict.ACCEPTED
        self.run(1.0)

    def run(self, duration_s: float, **changes: Any) -> tuple[Mode, bool]:
        """Let time pass with a changed situation; the mode and whether it is a failsafe."""
        self.now = self.now._replace(**changes)
        for _ in range(round(duration_s / STEP_S)):
            self.now = self.now._replace(t_s=self.now.t_s + STEP_S)
            self.modes.update(self.now)
        return self.modes.mode, self.modes.failsafe


@pytest.mark.parametrize(("action", "mode"), [(1, Mode.HOLD), (2, Mode.RETURN), (3, Mode.LAND)])
def test_lost_sticks_hold_first_and_then_do_what_nav_rcl_act_says(action: int, mode: Mode) -> None:
    flight = Flight(Mode.POSITION, {"NAV_RCL_ACT": action}, sticks_lost=False, throttle=-1.0)
    assert flight.run(4.8, sticks_lost=True) == (Mode.HOLD, True)
    assert flight.run(0.5) == (mode, True)


def test_sticks_that_were_never_there_are_not_missed() -> None:
    flight = Flight(Mode.HOLD)
    assert flight.run(20.0) == (Mode.HOLD, False)
    assert flight.run(1.0, sticks_lost=False) == (Mode.HOLD, False)
    assert flight.run(6.0, sticks_lost=True) == (Mode.RETURN, True), "once seen, they are missed"


@pytest.mark.parametrize(("mask", "failsafe"), [(0, True), (2, False), (4, True)])
def test_exceptions_let_a_mode_do_without_sticks(mask: int, failsafe: bool) -> None:
    flight = Flight(Mode.HOLD, {"COM_RCL_EXCEPT": mask}, sticks_lost=False, throttle=-1.0)
    assert flight.run(6.0, sticks_lost=True)[1] is failsafe


def test_a_return_for_lost_sticks_goes_on_when_they_come_back_until_a_mode_is_commanded() -> None:
    flight = Flight(Mode.POSITION, sticks_lost=False, throttle=-1.0)
    assert flight.run(6.0, sticks_lost=True) == (Mode.RETURN, True)
    assert flight.run(3.0, sticks_lost=False) == (Mode.RETURN, True)
    assert flight.modes.command(Mode.POSITION, flight.now) is Verdict.ACCEPTED
    assert flight.run(3.0) == (Mode.POSITION, False)


def test_moving_the_sticks_takes_over_from_a_failsafe_and_from_automatic_modes() -> None:
    flight = Flight(Mode.HOLD, sticks_lost=False, throttle=-1.0)
    assert flight.run(0.2, sticks_moved=True) == (Mode.POSITION, False)
    assert "Pilot took over using sticks" in [text for _, text in flight.modes.notices]


@pytest.mark.parametrize(("mask", "mode"), [(1, Mode.OFFBOARD), (2, Mode.POSITION), (3, Mode.POSITION)])
def test_in_offboard_com_rc_override_decides_whether_sticks_take_over(mask: int, mode: Mode) -> None:
    flight = Flight(Mode.OFFBOARD, {"COM_RC_OVERRIDE": mask}, sticks_lost=False, throttle=-1.0)
    assert flight.run(0.3, sticks_moved=True)[0] is mode


@pytest.mark.parametrize(("action", "mode"), [(0, Mode.POSITION), (1, Mode.ALTITUDE), (2, Mode.STABILIZED)])
def test_with_sticks_a_lost_stream_gives_the_vehicle_to_the_pilot(action: int, mode: Mode) -> None:
    flight = Flight(Mode.OFFBOARD, {"COM_OBL_RC_ACT": action}, sticks_lost=False, throttle=-1.0)
    assert flight.run(0.2, stream_age_s=1.5) == (mode, True)


@pytest.mark.parametrize("action", [6, 7])
def test_terminate_and_disarm_stop_the_motors(action: int) -> None:
    flight = Flight(Mode.OFFBOARD, {"COM_OBL_RC_ACT": action})
    flight.run(0.2, stream_age_s=1.5)
    assert not flight.modes.armed
    assert flight.modes.terminated is (action == 6)
    again = flight.modes.arm(flight.now._replace(stream_age_s=0.0, landed=True), force=True)
    assert again is (Verdict.TEMPORARILY_REJECTED if action == 6 else Verdict.ACCEPTED)


@pytest.mark.parametrize(
    ("action", "first", "then"),
    [
        (0, (Mode.HOLD, False), (Mode.HOLD, False)),
        (1, (Mode.HOLD, False), (Mode.HOLD, False)),
        (3, (Mode.HOLD, True), (Mode.RETURN, True)),
        (5, (Mode.HOLD, True), (Mode.LAND, True)),
    ],
)
def test_a_breached_fence_does_what_gf_action_says(
    action: int, first: tuple[Mode, bool], then: tuple[Mode, bool]
) -> None:
    flight = Flight(Mode.HOLD, {"GF_ACTION": action})
    assert flight.run(0.5, fence_breached=True) == first
    assert flight.run(5.0) == then


def test_a_fence_hold_wins_over_the_stream_at_once_and_lets_a_commanded_mode_escape() -> None:
    flight = Flight(Mode.OFFBOARD, {"GF_ACTION": 2}, sticks_lost=False, throttle=-1.0)
    assert flight.run(0.2, fence_breached=True) == (Mode.HOLD, True)
    assert flight.run(1.0, sticks_moved=True) == (Mode.HOLD, True), "sticks alone do not escape"
    assert flight.modes.command(Mode.POSITION, flight.now) is Verdict.ACCEPTED
    assert flight.run(5.0) == (Mode.POSITION, False)


@pytest.mark.parametrize(
    ("action", "critical", "emergency"),
    [
        (0, (Mode.HOLD, False), (Mode.HOLD, False)),
        (2, (Mode.LAND, True), (Mode.LAND, True)),
        (3, (Mode.RETURN, True), (Mode.LAND, True)),
    ],
)
def test_the_battery_warns_then_acts(action: int, critical: tuple[Mode, bool], emergency: tuple[Mode, bool]) -> None:
    flight = Flight(Mode.HOLD, {"COM_LOW_BAT_ACT": action})
    assert flight.run(1.0, battery_warning=1) == (Mode.HOLD, False)
    assert next(text for _, text in flight.modes.notices if "battery" in text) == "Low battery level, return advised"
    assert flight.run(6.0, battery_warning=2) == critical
    assert flight.run(6.0, battery_warning=3) == emergency


def test_a_commanded_mode_takes_over_from_the_battery_failsafe_until_it_gets_worse() -> None:
    flight = Flight(Mode.OFFBOARD, {"COM_LOW_BAT_ACT": 3})
    assert flight.run(1.0, battery_warning=2) == (Mode.HOLD, True)
    assert flight.run(5.0) == (Mode.RETURN, True)
    flight.modes.command(Mode.OFFBOARD, flight.now)
    assert flight.run(5.0) == (Mode.OFFBOARD, False)
    assert flight.run(6.0, battery_warning=3) == (Mode.LAND, True)


def test_arming_is_denied_with_a_low_battery() -> None:
    modes = ModeMachine(Parameters({}))
    low = Situation(9.0, True, True, 0.0, battery_warning=1)
    assert modes.arm(low) is Verdict.TEMPORARILY_REJECTED
    assert modes.arm(low._replace(battery_warning=0)) is Verdict.ACCEPTED


def test_a_lost_ground_station_matters_where_nav_dll_act_says_so_and_not_while_landing() -> None:
    flight = Flight(Mode.OFFBOARD, {"NAV_DLL_ACT": 2})
    assert flight.run(1.0, link_lost=True) == (Mode.HOLD, True)
    assert flight.run(5.0) == (Mode.RETURN, True)
    landing = Flight(Mode.LAND, {"NAV_DLL_ACT": 2})
    assert landing.run(10.0, link_lost=True) == (Mode.LAND, False)


@pytest.mark.parametrize("action", [0, 3, 4, 5])
def test_offboard_without_a_position_descends_blindly_whatever_com_obl_rc_act_says(action: int) -> None:
    flight = Flight(Mode.OFFBOARD, {"COM_OBL_RC_ACT": action})
    assert flight.run(0.2, position_ok=False) == (Mode.DESCEND, True)
    assert flight.modes.mode.custom_mode == Mode.LAND.custom_mode
    assert flight.modes.command(Mode.HOLD, flight.now) is Verdict.TEMPORARILY_REJECTED
    assert flight.run(1.0, position_ok=True) == (Mode.OFFBOARD, False)


def test_an_attitude_stream_needs_no_position() -> None:
    flight = Flight(Mode.OFFBOARD, stream_needs_position=False)
    assert flight.run(5.0, position_ok=False) == (Mode.OFFBOARD, False)


def test_without_a_position_a_pilot_gets_altitude_mode_and_without_a_height_stabilized() -> None:
    flight = Flight(Mode.POSITION, sticks_lost=False, throttle=-1.0)
    assert flight.run(0.2, position_ok=False) == (Mode.ALTITUDE, True)
    assert flight.run(0.2, height_ok=False) == (Mode.STABILIZED, True)
    assert flight.run(0.2, position_ok=True, height_ok=True) == (Mode.POSITION, False)


def test_manual_modes_are_refused_without_sticks_and_arming_wants_a_low_throttle() -> None:
    modes = ModeMachine(Parameters({}))
    ground = Situation(9.0, True, True, 9.0)
    for mode in (Mode.MANUAL, Mode.STABILIZED, Mode.ACRO, Mode.ALTITUDE, Mode.POSITION):
        assert modes.command(mode, ground) is Verdict.TEMPORARILY_REJECTED
    held = ground._replace(sticks_lost=False, throttle=0.0)
    assert modes.command(Mode.STABILIZED, held) is Verdict.ACCEPTED
    assert modes.arm(held) is Verdict.TEMPORARILY_REJECTED
    assert modes.command(Mode.POSITION, held) is Verdict.ACCEPTED
    assert modes.arm(held._replace(throttle=0.5)) is Verdict.TEMPORARILY_REJECTED
    assert modes.arm(held) is Verdict.ACCEPTED


def test_a_low_battery_shows_in_telemetry_and_denies_arming() -> None:
    rig = Rig(battery_start=0.06)
    try:
        rig.station.heartbeat()
        rig.run(5.0)
        assert rig.companion.got("BATTERY_STATUS")[-1].charge_state == 3
        status = rig.companion.got("SYS_STATUS")[-1]
        assert status.battery_remaining == 6
        assert not status.onboard_control_sensors_health & (33554432 | 1 << 28)
        assert "Critical battery level, land now" in [m.text for m in rig.station.got("STATUSTEXT")]
        rig.companion.command(400, 1.0)
        rig.run(0.1)
        assert rig.companion.acks(400) == [1]
    finally:
        rig.close()


def test_a_fence_holds_the_vehicle_at_its_distance() -> None:
    rig = Rig(parameters={"GF_MAX_HOR_DIST": 5.0, "GF_ACTION": 2})
    try:
        rig.take_off()
        for index in range(160):
            rig.companion.setpoint(0x5E3, vx=2.0, z=-3.0)
            if index == 2:
                rig.companion.command(176, 1.0, 6.0)
            rig.run(0.05)
        assert rig.vehicle.modes.mode.name == "HOLD" and rig.vehicle.modes.failsafe
        assert 5.0 < rig.vehicle.truth.ned_p_m[0] < 8.0
    finally:
        rig.close()


def test_a_ground_station_that_falls_silent_is_missed_where_nav_dll_act_says_so() -> None:
    rig = Rig(parameters={"NAV_DLL_ACT": 3, "COM_DL_LOSS_T": 2.0, "MIS_TAKEOFF_ALT": 2.5})
    try:
        rig.run(4.0)
        rig.companion.command(400, 1.0)
        rig.run(0.7)
        assert rig.companion.acks(400) == [1], "without a ground station it does not arm"
        for _ in range(9):
            rig.station.heartbeat()
            rig.run(1.0)
            rig.companion.command(400, 1.0)
            rig.companion.command(22)
        assert rig.vehicle.modes.mode.name in ("TAKEOFF", "HOLD") and not rig.vehicle.modes.failsafe
        rig.run(2.2)
        assert rig.vehicle.modes.mode.name == "HOLD" and rig.vehicle.modes.failsafe
        rig.run(5.0)
        assert rig.vehicle.modes.mode.name == "LAND"
    finally:
        rig.close()
