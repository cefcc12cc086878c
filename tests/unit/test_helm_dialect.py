"""Every dialect in the registry: the contract that the rest of helm rests on, and what is particular to each."""

from __future__ import annotations

import math

import pytest

from common.config import ConfigError, build
from onboard.helm.config import HelmConfig
from onboard.helm.dialect.ardupilot import ARDUPILOT
from onboard.helm.dialect.base import UNKNOWN, Dialect, Kind, Role
from onboard.helm.dialect.px4 import PX4
from onboard.helm.dialect.registry import AUTO, DIALECTS, UnfitAutopilot, recognise
from onboard.helm.setpoint import AccelerationSetpoint, LocalSetpoint
from tests.unit.helm_double import Desk, VehicleDouble

_QUADROTOR = 2
_BITS = ("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "force", "yaw", "yaw_rate")
every_dialect = pytest.mark.parametrize("dialect", DIALECTS.values(), ids=lambda d: d.name)


# ------------------------------------------------------------ the contract


@every_dialect
def test_it_is_found_by_its_heartbeat_and_by_its_name(dialect: Dialect):
    assert recognise(dialect.autopilot, _QUADROTOR) is dialect
    assert recognise(0, _QUADROTOR, dialect.name) is dialect
    assert build(HelmConfig, {"dialect": dialect.name}, "t").dialect == dialect.name


@every_dialect
def test_it_has_a_mode_for_what_helm_needs(dialect: Dialect):
    needed = {Role.CONTROL, Role.TAKEOFF, Role.LAND, Role.HOLD}
    assert needed <= {role for roles in dialect.mode_roles.values() for role in roles}
    assert [mode for mode, roles in dialect.mode_roles.items() if Role.CONTROL in roles] == [dialect.control_mode]
    assert not dialect.roles("") and not dialect.roles("no such mode")


@every_dialect
def test_it_words_every_action(dialect: Dialect):
    for kind in Kind:
        if kind is not Kind.PARAMETERS:
            commands = dialect.commands(kind, "", 4.0)
            assert commands and all(len(c.params) <= 7 for c in commands)
    with pytest.raises(ValueError, match="got the action parameters"):
        dialect.commands(Kind.PARAMETERS, "", 4.0)


@every_dialect
def test_no_action_forces_an_arming_or_a_disarming(dialect: Dialect):
    for kind in (Kind.ARM, Kind.DISARM):
        arming = [c for c in dialect.commands(kind, "", math.nan) if c.number == 400]
        assert [c.params for c in arming] == [(1.0 if kind is Kind.ARM else 0.0,)]


@every_dialect
def test_its_setpoint_uses_exactly_what_its_mask_says(dialect: Dialect):
    fields = dialect.setpoint(LocalSetpoint(1.0, -2.0, -4.0, 0.5, 0.1))
    used = {name for bit, name in enumerate(_BITS) if not fields["type_mask"] >> bit & 1} - {"force"}
    assert {"vx", "vy", "yaw_rate"} < used
    assert (fields["vx"], fields["vy"], fields["yaw_rate"], fields["coordinate_frame"]) == (1.0, -2.0, 0.1, 1)
    assert all(fields[name] == 0.0 for name in set(_BITS) - used - {"force"})
    assert [fields[name] for name in used & {"z", "vz"}] in ([-4.0], [0.5])


@every_dialect
def test_an_acceleration_is_worded_as_one_or_as_the_velocity_that_it_leads_to(dialect: Dialect):
    fields = dialect.setpoint(AccelerationSetpoint(1.0, -2.0, -4.0, 0.5, 0.1, 0.7, -0.9))
    used = {name for bit, name in enumerate(_BITS) if not fields["type_mask"] >> bit & 1} - {"force"}
    horizontal = [(fields[a], fields[b]) for a, b in (("afx", "afy"), ("vx", "vy")) if {a, b} <= used]
    assert horizontal in ([(0.7, -0.9)], [(1.0, -2.0)]), "one of the two, never a mix"
    assert "yaw_rate" in used and fields["yaw_rate"] == 0.1
    assert [fields[name] for name in used & {"z", "vz"}] in ([-4.0], [0.5])


@every_dialect
def test_its_silence_is_bounded_and_insisted_on(dialect: Dialect):
    config = HelmConfig()
    assert dialect.silence_parameter in config.parameters_of(dialect)
    assert config.parameters_of(dialect) == dict(dialect.parameters)
    assert 0.3 <= config.silence_s(dialect) <= 3.0
    assert dialect.on_silence


@every_dialect
def test_it_asks_for_what_helm_reads(dialect: Dialect):
    assert {"ATTITUDE_QUATERNION", "LOCAL_POSITION_NED", "HEARTBEAT", "EXTENDED_SYS_STATE"} <= set(dialect.messages)
    assert {31, 32, 245} <= {message for message, _ in dialect.rates_hz}


def test_ardupilot_is_asked_for_the_accelerometers_which_px4_streams_unasked():
    assert "HIGHRES_IMU" in DIALECTS["ardupilot"].messages
    assert dict(DIALECTS["ardupilot"].rates_hz)[105] >= 25.0


@every_dialect
def test_a_flight_in_it(dialect: Dialect):
    """The gate, takeoff, hover, chase, a stop without requests, a foreign mode, engage and landing, on a point mass."""
    desk = Desk(VehicleDouble(dialect=dialect)).fly(4.0)
    assert desk.vehicle.mode == dialect.control_mode
    assert {k: desk.vehicle.parameters[k] for k in dialect.parameters if k != dialect.takeoff_parameter} == {
        k: v for k, v in dialect.parameters.items() if k != dialect.takeoff_parameter
    }
    assert desk.vehicle.height_m == pytest.approx(4.0, abs=0.2)
    desk.chase((1.5, 0.0, -0.5)).go(3.0)
    assert desk.vehicle.v[0] == pytest.approx(1.5, abs=0.1)
    assert desk.vehicle.height_m == pytest.approx(5.1, abs=0.6)
    desk.pursuit = desk.tracking = None
    height_m = desk.vehicle.height_m
    desk.go(4.0)
    assert math.hypot(*desk.vehicle.v) < 0.1 and desk.vehicle.height_m == pytest.approx(height_m, abs=1.0)
    desk.vehicle.mode = desk.vehicle.mode_for(Role.LAND)
    desk.step()
    sent = len(desk.vehicle.sent)
    assert desk.state == "yielded"
    desk.vehicle.mode = desk.vehicle.mode_for(Role.HOLD)
    desk.go(1.0)
    assert len(desk.vehicle.sent) == sent
    desk.call("engage")
    assert desk.go(3.0, until="hold")
    landing = desk.call("land")
    assert desk.go(20.0, until="standby")
    assert landing.answer and landing.answer.outcome == "done"


@every_dialect
def test_a_hang_ends_yielded_and_says_what_the_vehicle_does(dialect: Dialect):
    desk = Desk(VehicleDouble(dialect=dialect)).fly().chase()
    desk.go(1.0)
    sent = len(desk.vehicle.sent)
    desk.t_ns += 2_500_000_000
    desk.go(3.0)
    assert desk.state == "yielded" and len(desk.vehicle.sent) == sent
    assert dialect.on_silence in desk.node.flight.machine.reason
    assert math.hypot(*desk.vehicle.v) < 0.1


@every_dialect
def test_a_restart_finds_the_control_mode_and_waits(dialect: Dialect):
    desk = Desk(VehicleDouble(p=[0.0, 0.0, -4.0], mode=dialect.control_mode, armed=True, dialect=dialect))
    desk.go(3.0)
    assert (desk.state, desk.vehicle.sent) == ("yielded", [])
    assert dialect.control_mode in desk.node.flight.machine.reason
    desk.call("engage")
    assert desk.go(3.0, until="hold")


@every_dialect
def test_a_landing_that_others_command_while_engaging_is_not_overridden_unless_it_may_be_the_failsafe(dialect: Dialect):
    """PX4 may still enter LAND for want of setpoints from before; an autopilot that never does so meant it."""
    desk = Desk(VehicleDouble(p=[0.0, 0.0, -4.0], mode=dialect.control_mode, armed=True, dialect=dialect))
    desk.go(1.0)
    desk.call("engage")
    desk.go(0.1)
    desk.vehicle.mode, desk.vehicle.ignores = desk.vehicle.mode_for(Role.LAND), (Kind.CONTROL,)
    desk.step()
    assert desk.state == ("engaging" if Role.LAND in dialect.after_silence else "yielded")


# ------------------------------------------------------------ refusals


def test_an_unknown_autopilot_is_refused_in_one_line():
    with pytest.raises(UnfitAutopilot, match=r"MAV_AUTOPILOT 4, expected one of PX4 \(12\), ArduPilot \(3\); .*helm"):
        recognise(4, _QUADROTOR)


@pytest.mark.parametrize("wanted", [AUTO, "ardupilot"])
def test_a_vehicle_that_is_no_multicopter_is_refused(wanted: str):
    """ArduPilot's plane calls itself ArduPilot too, and its mode numbers mean other things."""
    with pytest.raises(UnfitAutopilot, match="MAV_TYPE 1, expected a multicopter"):
        recognise(ARDUPILOT.autopilot, 1, wanted)


def test_a_wrong_name_lists_the_right_ones():
    with pytest.raises(ConfigError, match="dialect: got 'ardu', expected auto, px4 or ardupilot"):
        build(HelmConfig, {"dialect": "ardu"}, "t")


def test_before_an_autopilot_is_known_no_mode_is_ours():
    assert not UNKNOWN.roles(UNKNOWN.control_mode)
    with pytest.raises(ValueError, match="no known autopilot"):
        UNKNOWN.setpoint(LocalSetpoint(0.0, 0.0, 0.0, 0.0, 0.0))


# ------------------------------------------------------------ each one


@pytest.mark.parametrize(
    ("custom_mode", "name"),
    [
        (0x03040000, "HOLD"),
        (0x00060000, "OFFBOARD"),
        (0x02040000, "TAKEOFF"),
        (0x05040000, "RETURN"),
        (0x06040000, "LAND"),
        (0x00030000, "POSCTL"),
        (0x63040000, "AUTO99"),
        (0, "MODE0"),
    ],
)
def test_mode_names_of_px4(custom_mode: int, name: str):
    assert PX4.mode_name(custom_mode) == name


@pytest.mark.parametrize(
    ("custom_mode", "name"),
    [
        (0, "STABILIZE"),
        (2, "ALT_HOLD"),
        (3, "AUTO"),
        (4, "GUIDED"),
        (5, "LOITER"),
        (6, "RTL"),
        (9, "LAND"),
        (16, "POSHOLD"),
        (17, "BRAKE"),
        (21, "SMART_RTL"),
        (99, "MODE99"),
    ],
)
def test_mode_names_of_ardupilot(custom_mode: int, name: str):
    assert ARDUPILOT.mode_name(custom_mode) == name


def test_px4_holds_the_altitude_itself():
    assert PX4.setpoint(LocalSetpoint(1.0, 0.0, -4.0, 0.5, 0.0))["type_mask"] == 0x5E3
    assert PX4.takeoff_parameters(6) == {"MIS_TAKEOFF_ALT": 6.0}


def test_px4_is_armed_out_of_a_mission_by_way_of_hold():
    assert [c.params[:3] for c in PX4.commands(Kind.ARM, "RETURN", 0.0)] == [(1.0, 4, 3.0), (1.0,)]


def test_px4_takes_off_and_lands_where_it_is():
    """Latitude and longitude of 0 would be a place in the Gulf of Guinea."""
    for kind in (Kind.TAKEOFF, Kind.LAND):
        (command,) = PX4.commands(kind, "HOLD", 4.0)
        assert math.isnan(command.params[4]) and math.isnan(command.params[5])


def test_ardupilot_takes_off_in_guided_with_the_height_in_the_command():
    mode, takeoff = ARDUPILOT.commands(Kind.TAKEOFF, "LOITER", 6.0)
    assert (mode.number, mode.params) == (176, (1.0, 4.0))
    assert (takeoff.number, takeoff.params[6]) == (22, 6.0)
    assert ARDUPILOT.takeoff_parameters(6.0) == {}


def test_ardupilot_gets_a_velocity_in_all_three_axes():
    fields = ARDUPILOT.setpoint(LocalSetpoint(1.0, 2.0, -4.0, 0.25, 0.1))
    assert (fields["type_mask"], fields["vz"], fields["z"]) == (0x5C7, 0.25, 0.0)


def test_ardupilot_is_ready_only_with_its_attitude_reference():
    assert not ARDUPILOT.ready({"onboard_control_sensors_health": 1 << 28})
    assert ARDUPILOT.ready({"onboard_control_sensors_health": 1 << 28 | 1 << 21})


def test_each_dialect_has_parameters_of_its_own():
    table = {"parameters": {"COM_OF_LOSS_T": 0.5}, "ardupilot_parameters": {"GUID_TIMEOUT": 0.8, "RTL_ALT": 800}}
    config = build(HelmConfig, table, "t")
    assert (config.silence_s(PX4), config.silence_s(ARDUPILOT)) == (0.5, 0.8)
    assert isinstance(config.parameters_of(ARDUPILOT)["RTL_ALT"], int)
    with pytest.raises(ConfigError, match=r"ardupilot_parameters.GUID_TIMEOUT: got 5.0, expected 0.3 to 3.0"):
        build(HelmConfig, {"ardupilot_parameters": {"GUID_TIMEOUT": 5.0}}, "t")
