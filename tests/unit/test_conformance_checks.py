"""Every check fails on an autopilot that deviates, and all pass on ours, with both drags; in simulated time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import pytest

from simulation.conformance.judge import Judge
from simulation.conformance.registry import CHECKS
from simulation.conformance.suite import run_checks
from simulation.conformance.vehicle import CannotFly, decode, encode
from tests.unit.conformance_rig import Change, ConformanceRig


@pytest.fixture(scope="module")
def shared() -> Iterator[ConformanceRig]:
    """One autopilot for all deviations: brought back to where a check begins each time."""
    rig = ConformanceRig(start_yaw_rad=0.6)
    yield rig
    rig.close()


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.parametrize("drag_n_s_m", [0.1, 1.0])
def test_all_checks_pass_on_the_simulated_autopilot(drag_n_s_m: float) -> None:
    rig = ConformanceRig(drag_n_s_m=drag_n_s_m)
    try:
        results = run_checks(rig.vehicle, list(CHECKS.values()), may_fly=True)
        wrong = {r.check.name: [r.reason, *(line for line in r.lines if not line.ok)] for r in results if r.failed}
        assert not wrong
        assert len(results) == len(CHECKS)
        vehicle = rig.wire.autopilot.vehicle
        assert vehicle.landed and not vehicle.modes.armed
        step = next(r for r in results if r.check.name == "step")
        named = next(line.got for line in step.lines if line.what == "drag that fits")
        assert f"({drag_n_s_m:g} N per m/s)" in named
    finally:
        rig.close()


def lose(kind: str, when: Callable[[Any], bool] = lambda m: True) -> Change:
    """Loses the messages of a kind."""
    return lambda m: None if m.get_type() == kind and when(m) else m


def put(kind: str, when: Callable[[Any], bool] = lambda m: True, **fields: Any) -> Change:
    """Overwrites fields of the messages of a kind."""

    def change(message: Any) -> Any:
        if message.get_type() == kind and when(message):
            for name, value in fields.items():
                setattr(message, name, value)
        return message

    return change


def scale(share: float, *names: str) -> Change:
    """Scales fields of the setpoints."""

    def change(message: Any) -> Any:
        if message.get_type() == "SET_POSITION_TARGET_LOCAL_NED":
            for name in names:
                setattr(message, name, getattr(message, name) * share)
        return message

    return change


def other_action(wrong: int, right: int) -> tuple[Change, Change]:
    """COM_OBL_RC_ACT mapped wrong: what is written as one action acts as another, and reads as written."""

    def up(message: Any) -> Any:
        if message.get_type() == "PARAM_SET" and message.param_id == "COM_OBL_RC_ACT":
            message.param_value = encode(wrong, 6)
        return message

    def down(message: Any) -> Any:
        if message.get_type() == "PARAM_VALUE" and message.param_id == "COM_OBL_RC_ACT" and decode(message) == wrong:
            message.param_value = encode(right, 6)
        return message

    return up, down


def swap_hold(message: Any) -> Any:
    """A ground station's HOLD becomes OFFBOARD."""
    if message.get_type() == "COMMAND_LONG" and message.command == 176 and message.get_srcSystem() == 255:
        message.param2, message.param3 = 6.0, 0.0
    return message


def is_param(name: str) -> Callable[[Any], bool]:
    return lambda m: m.param_id == name


def is_command(command: int) -> Callable[[Any], bool]:
    return lambda m: m.command == command


@dataclass(frozen=True)
class Deviation:
    """How the autopilot is made to deviate while a check runs."""

    check: str
    said: str
    """Part of what the failing comparison is called."""
    up: Change | None = None
    down: Change | None = None
    skip: int = 0


_TO_SIGNED = lose("PARAM_REQUEST_READ", lambda m: bool(m.get_msgbuf()[2] & 1))
_NOT_ACCEPTED = put("COMMAND_ACK", is_command(176), result=0)

ON_THE_GROUND = [
    Deviation("connect", "base_mode", down=put("HEARTBEAT", base_mode=81)),
    Deviation("connect", "custom_mode", down=put("HEARTBEAT", custom_mode=5)),
    Deviation("connect", "heartbeat", down=lose("HEARTBEAT")),
    Deviation("rates", "ATTITUDE", skip=2),
    Deviation("rates", "HOME_POSITION", down=lose("HOME_POSITION")),
    Deviation("health", "ready", down=put("SYS_STATUS", onboard_control_sensors_health=0)),
    Deviation("home", "home above", down=put("HOME_POSITION", altitude=0)),
    Deviation("home", "acknowledgement", up=lose("COMMAND_LONG", is_command(512))),
    Deviation("parameters", "type", down=put("PARAM_VALUE", param_type=9)),
    Deviation("parameters", "MIS_TAKEOFF_ALT written", up=lose("PARAM_SET")),
    Deviation("parameters", "listed", down=lose("PARAM_VALUE", lambda m: m.param_id.startswith("CAL_"))),
    Deviation("return-altitude", "RTL_RETURN_ALT", up=lose("PARAM_SET", is_param("RTL_RETURN_ALT"))),
    Deviation("signing", "signed request", up=_TO_SIGNED),
    Deviation("offboard-refused", "acknowledgements", down=_NOT_ACCEPTED),
    Deviation("arming", "arm", down=put("COMMAND_ACK", is_command(400), result=2)),
    Deviation("refusal-texts", "text with a ground station", down=lose("STATUSTEXT")),
    Deviation("reboot", "acknowledgement", up=lose("COMMAND_LONG", is_command(246))),
    Deviation(
        "reboot",
        "clock",
        up=put("COMMAND_LONG", is_command(246), command=520),  # acknowledged, and nothing follows
        down=put("COMMAND_ACK", is_command(520), command=246),
    ),
]

IN_THE_AIR = [
    Deviation("velocity", "speed along", up=scale(0.5, "vx")),
    Deviation("velocity", "height", up=scale(1.1, "z")),
    Deviation("body-velocity", "speed across", up=put("SET_POSITION_TARGET_LOCAL_NED", coordinate_frame=1)),
    Deviation("acceleration", "tilt", up=scale(0.5, "afx")),
    Deviation("yaw-rate", "heading rate", up=scale(0.5, "yaw_rate")),
    Deviation("position", "reached", up=scale(0.9, "z")),
    Deviation("step", "t63 up", up=scale(0.6, "vx")),
    Deviation("climb-step", "t90", up=scale(0.5, "vz")),
    Deviation("yaw-step", "t90", up=scale(0.0, "yaw")),
    Deviation("loss-0", "mode after", *other_action(5, 0)),
    Deviation("loss-3", "mode after", *other_action(4, 3)),
    Deviation("loss-4", "mode after", *other_action(3, 4)),
    Deviation("loss-5", "mode after", *other_action(4, 5)),
    Deviation("yielding", "entered", up=swap_hold),
    Deviation("mode-latency", "mode seen", down=lambda m: None if m.get_type() in ("HEARTBEAT", "CURRENT_MODE") else m),
    Deviation("attitude", "roll in OFFBOARD", up=put("SET_ATTITUDE_TARGET", q=(1.0, 0.0, 0.0, 0.0))),
    Deviation("thrust", "sink", up=put("SET_ATTITUDE_TARGET", thrust=0.495)),
    Deviation("fence", "mode", up=put("PARAM_SET", is_param("GF_MAX_HOR_DIST"), param_value=0.0)),
    Deviation("position-sticks", "speed ahead", up=put("MANUAL_CONTROL", x=0)),
    Deviation("altitude-sticks", "pitch", up=put("MANUAL_CONTROL", x=0)),
    Deviation("land", "motors stop", down=put("PARAM_VALUE", is_param("COM_DISARM_LAND"), param_value=9.0)),
]


def _name(deviation: Deviation) -> str:
    return f"{deviation.check}: {deviation.said}"


def judged(rig: ConformanceRig, deviation: Deviation) -> Judge:
    """What a check finds while the autopilot deviates."""
    judge, wire = Judge(), rig.wire
    wire.up, wire.down, wire.skip = deviation.up, deviation.down, deviation.skip
    try:
        CHECKS[deviation.check].run(rig.vehicle, judge)
    except CannotFly as error:
        judge.truth("flight", False, error, "flies")
    finally:
        wire.up, wire.down, wire.skip = None, None, 0
        rig.vehicle.after_check()
    return judge


@pytest.mark.parametrize("deviation", ON_THE_GROUND, ids=_name)
def test_a_deviation_on_the_ground_is_found(shared: ConformanceRig, deviation: Deviation) -> None:
    shared.client.run(12.0, lambda: shared.vehicle.ready)
    judge = judged(shared, deviation)
    if shared.vehicle.armed:
        shared.client.command(400, 0.0)
    shared.vehicle.clean_up()
    assert any(deviation.said in line.what for line in judge.lines if not line.ok), judge.lines


@pytest.mark.slow
@pytest.mark.parametrize("deviation", IN_THE_AIR, ids=_name)
def test_a_deviation_in_the_air_is_found(shared: ConformanceRig, deviation: Deviation) -> None:
    shared.vehicle.hover()
    judge = judged(shared, deviation)
    assert any(deviation.said in line.what for line in judge.lines if not line.ok), judge.lines


@pytest.mark.slow
@pytest.mark.parametrize(("check", "loss_s"), [("stream-1.1", 0.7), ("stream-0.9", 1.6)])
def test_another_patience_with_the_stream_is_found(shared: ConformanceRig, check: str, loss_s: float) -> None:
    shared.vehicle.hover()
    assert shared.vehicle.set_param("COM_OF_LOSS_T", loss_s)
    assert not judged(shared, Deviation(check, "")).ok


def test_a_takeoff_that_does_not_climb_is_tried_again_and_told() -> None:
    rig = ConformanceRig(takeoff_failure_probability=1.0)
    try:
        (result,) = run_checks(rig.vehicle, [CHECKS["takeoff"]], may_fly=True)
        assert result.outcome == "not run" and "two takeoffs" in result.reason
        assert rig.vehicle.takeoffs_failed == 2
        assert not rig.vehicle.armed
    finally:
        rig.close()


def test_every_check_has_its_deviation() -> None:
    deviating = {d.check for d in (*ON_THE_GROUND, *IN_THE_AIR)} | {"takeoff", "stream-1.1", "stream-0.9"}
    assert deviating == set(CHECKS)
