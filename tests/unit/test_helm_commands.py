"""Commands to the helm node, flown on a point-mass vehicle: take-off, landing, arming, and every answer."""

from __future__ import annotations

import pytest

from onboard.helm.actions import Kind
from onboard.helm.commands import COMMANDS
from onboard.helm.states import State
from tests.unit.helm_double import Desk, VehicleDouble


def test_takeoff_is_done_when_it_hovers_at_its_height():
    desk = Desk()
    desk.go(1.0)
    call = desk.call("takeoff", height_m=5.0)
    assert call.answer is None
    desk.go(15.0, until="hold")
    assert call.answer and call.answer.outcome == "done"
    desk.go(3.0)
    assert desk.vehicle.height_m == pytest.approx(5.0, abs=0.1)
    assert [a.kind for a in desk.vehicle.actions][-3:] == [Kind.ARM, Kind.TAKEOFF, Kind.CONTROL]


def test_the_parameters_are_written_on_the_ground():
    desk = Desk()
    desk.go(0.5)
    assert desk.vehicle.parameters["COM_OBL_RC_ACT"] == 5
    assert desk.status and all(item.ok for item in desk.status.preflight)


@pytest.mark.parametrize(
    ("vehicle", "camera", "text"),
    [
        (VehicleDouble(battery=0.1), True, "battery: got 10%"),
        (VehicleDouble(home=None), True, "home: not set"),
        (VehicleDouble(), False, "calibration: camera/down/info has not come"),
        (VehicleDouble(ignores=(Kind.PARAMETERS,)), True, "COM_OBL_RC_ACT: not read yet, expected 5"),
    ],
)
def test_the_gate_refuses_with_the_reason(vehicle: VehicleDouble, camera: bool, text: str):
    desk = Desk(vehicle, camera=camera)
    desk.go(1.0)
    for name in ("takeoff", "arm"):
        call = desk.call(name)
        assert call.answer and call.answer.outcome == "refused"
        assert text in call.answer.reason
    assert not desk.vehicle.armed


def test_a_takeoff_that_does_not_climb_is_retried_once():
    desk = Desk(VehicleDouble(takeoffs_that_fail=1))
    desk.fly()
    assert desk.counters["takeoff retries"] == 1


def test_a_takeoff_that_never_climbs_fails_and_disarms():
    desk = Desk(VehicleDouble(takeoffs_that_fail=2))
    desk.go(1.0)
    call = desk.call("takeoff")
    desk.go(12.0)
    assert call.answer and call.answer.outcome == "failed"
    assert "did not climb" in call.answer.reason
    assert (desk.state, desk.vehicle.armed) == ("standby", False)


def test_a_refused_arming_fails_the_takeoff():
    desk = Desk(VehicleDouble(refuses=(Kind.ARM,)))
    desk.go(1.0)
    call = desk.call("takeoff")
    desk.go(1.0)
    assert call.answer and call.answer.outcome == "failed" and "DENIED" in call.answer.reason


@pytest.mark.parametrize("height", [0.2, 100.0])
def test_a_senseless_height_is_refused(height: float):
    desk = Desk()
    desk.go(1.0)
    call = desk.call("takeoff", height_m=height)
    assert call.answer and "expected 1.5 to 15" in call.answer.reason


def test_land_streams_until_the_autopilot_has_taken_over():
    desk = Desk().fly()
    call = desk.call("land")
    desk.step()
    desk.step()
    assert call.answer and call.answer.outcome == "done"
    sent = len(desk.vehicle.sent)
    assert desk.go(20.0, until="standby")
    assert len(desk.vehicle.sent) == sent


def test_a_refused_landing_is_reported_and_hovers():
    desk = Desk(VehicleDouble(refuses=(Kind.LAND,))).fly()
    call = desk.call("land")
    desk.go(1.5)
    assert call.answer and call.answer.outcome == "failed"
    assert desk.go(2.0, until="hold")


def test_hold_ends_a_takeoff_on_the_ground_and_in_the_air():
    desk = Desk(VehicleDouble(takeoffs_that_fail=2))
    desk.go(1.0)
    desk.call("takeoff")
    desk.go(0.5)
    call = desk.call("hold")
    assert call.answer and call.answer.outcome == "done"
    desk.go(0.1)
    assert (desk.state, desk.vehicle.armed) == ("standby", False)
    desk = Desk()
    desk.go(1.0)
    takeoff = desk.call("takeoff", height_m=10.0)
    desk.go(5.0)
    desk.call("hold")
    assert takeoff.answer and takeoff.answer.outcome == "failed"
    assert desk.go(3.0, until="hold")
    assert desk.vehicle.height_m < 8.0


def test_disarm_in_the_air_is_refused():
    call = Desk().fly().call("disarm")
    assert call.answer and call.answer.outcome == "refused"


def test_arm_and_disarm_on_the_ground():
    desk = Desk()
    desk.go(1.0)
    armed, _ = desk.call("arm"), desk.go(0.1)
    assert armed.answer and armed.answer.reason == "armed"
    disarmed, _ = desk.call("disarm"), desk.go(0.1)
    assert disarmed.answer and disarmed.answer.reason == "disarmed"


@pytest.mark.parametrize("state", list(State))
def test_every_command_is_answered_in_every_state(state: State):
    for name in COMMANDS:
        desk = Desk(VehicleDouble(silent=True))
        desk.step()
        desk.node.flight.machine.state = state
        call = desk.call(name.removeprefix("helm/do/"))
        desk.go(46.0 if name == "helm/do/takeoff" else 10.0)
        assert call.answer is not None, f"{name} in {state}"
        assert call.answer.reason
