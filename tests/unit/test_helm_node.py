"""The helm node flown on a point-mass vehicle: commands, arbitration, and every safety event injected."""

from __future__ import annotations

import math

import pytest

from common.messages import Request, VehicleState
from onboard.helm.actions import Kind
from onboard.helm.commands import COMMANDS
from onboard.helm.states import State
from tests.unit.helm_double import Desk, VehicleDouble


def _speed(desk: Desk) -> float:
    return math.hypot(desk.vehicle.v[0], desk.vehicle.v[1])


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


def test_the_chase_is_obeyed_and_a_stale_request_hovers():
    desk = Desk().fly().chase((1.5, 0.0, 0.0))
    desk.go(3.0)
    assert desk.setpoints[-1].source == "pursuit"
    assert desk.vehicle.v[0] == pytest.approx(1.5, abs=0.1)
    desk.pursuit = None
    desk.go(0.4)
    assert desk.setpoints[-1].source == "helm"
    desk.go(3.0)
    assert _speed(desk) < 0.1
    assert desk.state == "pursuit"
    assert desk.counters["pursuit: stale"] > 10
    desk.chase((1.5, 0.0, 0.0)).go(2.0)
    assert desk.setpoints[-1].source == "pursuit"


def test_a_request_is_answered_in_the_same_step_and_never_above_50_hz():
    desk = Desk().fly().chase()
    desk.go(2.0)
    gaps = [b - a for a, b in zip(desk.vehicle.sent_ns[-60:-1], desk.vehicle.sent_ns[-59:], strict=True)]
    assert min(gaps) >= 20_000_000 and max(gaps) <= 20_000_000


def test_chase_without_a_target_is_refused():
    call = Desk().fly().call("chase")
    assert call.answer and "select one first" in call.answer.reason


@pytest.mark.parametrize(("action", "state"), [("return", "returning"), ("land", "landing"), ("hover", "hold")])
def test_a_lost_link_ends_in_the_configured_action(action: str, state: str):
    desk = Desk(link_loss_action=action, link_loss_after_s=3.0).fly().chase()
    desk.go(8.0)
    desk.pursuit = desk.tracking = None
    desk.go(2.5)
    assert desk.state == "pursuit"
    assert desk.go(3.0, until=state)


def test_the_way_home_ends_on_the_ground_at_home():
    desk = Desk().fly().chase((1.5, 1.0, 0.0))
    desk.go(10.0)
    call = desk.call("return")
    assert call.answer and call.answer.outcome == "done"
    assert desk.go(60.0, until="landing")
    assert math.hypot(*desk.vehicle.p[:2]) < 1.0
    assert desk.go(30.0, until="standby")
    assert not desk.vehicle.armed


def test_too_long_without_a_target_holds():
    desk = Desk(containment={"chase_without_target_s": 4.0}).fly().chase((0.5, 0.0, 0.0))
    desk.go(2.0)
    desk.tracking, desk.pursuit = "lost", None
    assert desk.go(5.0, until="hold")
    assert "no target" in desk.node.flight.machine.reason


def test_the_operator_takes_over_and_lets_go_into_hold():
    desk = Desk().fly().chase((1.0, 0.0, 0.0))
    desk.go(1.0)
    desk.operator = Request(frame="heading", vector=(0.0, 0.8, 0.0))
    desk.go(2.0)
    assert (desk.state, desk.setpoints[-1].source) == ("operator", "operator")
    assert desk.vehicle.v[1] == pytest.approx(0.8, abs=0.1)
    desk.operator = None
    desk.go(0.5)
    assert desk.state == "hold"


def test_the_way_home_is_flown_nose_first():
    desk = Desk().fly().chase((2.0, 0.0, 0.0))
    desk.go(8.0)
    assert desk.vehicle.p[0] > 10.0
    desk.call("return")
    fast = []
    while desk.vehicle.p[0] > 3.2:
        desk.step()
        if desk.vehicle.v[0] < -1.5:
            fast.append(abs(math.remainder(desk.vehicle.yaw - math.pi, math.tau)))
    assert len(fast) > 100
    assert max(fast) < 0.75, "fast only where it looks"


def test_the_operator_takes_over_on_the_way_home():
    desk = Desk().fly().chase((1.5, 0.0, 0.0))
    desk.go(6.0)
    desk.call("return")
    desk.operator = Request(frame="heading", vector=(0.0, 0.0, 0.0))
    desk.go(1.0)
    assert desk.state == "returning", "a stick at rest lets it fly home"
    desk.operator = Request(frame="heading", vector=(0.0, 0.8, 0.0))
    desk.go(2.0)
    assert (desk.state, desk.setpoints[-1].source) == ("operator", "operator")
    desk.operator = None
    desk.go(0.5)
    assert desk.state == "hold"


def test_an_approach_is_obeyed_until_its_target_is_away_for_long():
    desk = Desk(containment={"chase_without_target_s": 4.0}).fly()
    refused = desk.call("approach")
    assert refused.answer and "choose one first" in refused.answer.reason
    desk.approach = Request(frame="ned", vector=(0.8, 0.0, 0.0), yaw_rate_rad_s=0.2)
    desk.go(1.0)
    assert desk.state == "hold", "what nobody commanded is not obeyed"
    done = desk.call("approach")
    assert done.answer and done.answer.outcome == "done"
    desk.go(2.0)
    assert (desk.state, desk.setpoints[-1].source) == ("approach", "approach")
    assert desk.vehicle.v[0] == pytest.approx(0.8, abs=0.1)
    desk.approach = None
    desk.go(0.5)
    assert (desk.state, desk.setpoints[-1].source) == ("approach", "helm"), "without a request: hover"
    assert "no fresh request from the approach" in desk.node.flight.machine.reason
    assert desk.go(5.0, until="hold")
    assert "nothing from the approach for 4 s: hold" in desk.node.flight.machine.reason


def test_a_search_is_obeyed_and_gives_way_to_an_approach():
    desk = Desk(containment={"chase_without_target_s": 4.0}).fly()
    refused = desk.call("search")
    assert refused.answer and "begin one first with search/do/start" in refused.answer.reason
    desk.search = Request(frame="ned", vector=(0.0, 0.8, 0.0))
    desk.approach = Request(frame="ned", vector=(0.8, 0.0, 0.0))
    desk.go(0.2)
    done = desk.call("search")
    assert done.answer and done.answer.outcome == "done"
    desk.go(1.0)
    assert (desk.state, desk.setpoints[-1].source) == ("search", "search")
    desk.call("approach")
    desk.go(1.0)
    assert (desk.state, desk.setpoints[-1].source) == ("approach", "approach")
    desk.call("search")
    desk.go(0.5)
    assert desk.state == "search"
    desk.search = None
    assert desk.go(5.0, until="hold")
    assert "nothing from the search for 4 s: hold" in desk.node.flight.machine.reason


def test_the_stick_ends_an_approach_and_only_its_command_resumes_it():
    desk = Desk().fly()
    desk.approach = Request(frame="ned", vector=(0.8, 0.0, 0.0))
    desk.step()
    desk.call("approach")
    desk.go(1.0)
    desk.operator = Request(frame="heading", vector=(0.0, 0.5, 0.0))
    desk.go(1.0)
    assert (desk.state, desk.setpoints[-1].source) == ("operator", "operator")
    desk.operator = None
    desk.go(2.0)
    assert desk.state == "hold"
    assert _speed(desk) < 0.1
    desk.call("approach")
    desk.go(0.5)
    assert desk.state == "approach"


def test_a_stick_at_rest_does_not_end_a_chase():
    desk = Desk().fly().chase()
    desk.operator = Request(frame="heading", vector=(0.0, 0.0, 0.0))
    desk.go(1.0)
    assert desk.state == "pursuit"


@pytest.mark.parametrize("mode", ["HOLD", "POSCTL", "RETURN", "LAND"])
def test_a_foreign_mode_stops_the_stream_at_once_and_for_good(mode: str):
    desk = Desk().fly().chase()
    desk.go(1.0)
    desk.vehicle.mode = mode
    desk.step()
    sent = len(desk.vehicle.sent)
    assert desk.state == "yielded"
    desk.go(5.0)
    assert len(desk.vehicle.sent) == sent
    for name in ("hold", "chase", "land", "return"):
        call = desk.call(name)
        assert call.answer and call.answer.outcome == "refused" and "engage" in call.answer.reason
    call = desk.call("engage")
    if mode != "LAND":
        assert desk.go(3.0, until="hold")
        assert call.answer and call.answer.outcome == "done"


def test_the_autopilots_own_failsafe_is_named():
    desk = Desk().fly()
    desk.vehicle.mode, desk.vehicle.critical = "RETURN", True
    desk.step()
    assert "failsafe" in desk.node.flight.machine.reason


def test_a_hang_ends_yielded_without_a_single_setpoint():
    desk = Desk().fly().chase()
    desk.go(1.0)
    sent = len(desk.vehicle.sent)
    desk.t_ns += 2_500_000_000
    desk.go(3.0)
    assert desk.state == "yielded"
    assert desk.counters["helm's stream was interrupted"] == 1
    assert len(desk.vehicle.sent) == sent


def test_a_short_stall_flies_on():
    desk = Desk().fly().chase()
    desk.t_ns += 600_000_000
    desk.go(1.0)
    assert desk.state == "pursuit"


def _airborne(mode: str) -> VehicleDouble:
    return VehicleDouble(p=[2.0, 0.0, -4.0], mode=mode, armed=True)


@pytest.mark.parametrize("mode", ["OFFBOARD", "HOLD"])
def test_a_restart_in_the_air_says_what_it_found_and_waits(mode: str):
    desk = Desk(_airborne(mode))
    desk.go(3.0)
    assert desk.state == "yielded"
    assert f"in the air, mode {mode}" in desk.node.flight.machine.reason
    assert not desk.vehicle.sent
    assert all(not a.write for a in desk.vehicle.actions)
    desk.call("engage")
    assert desk.go(3.0, until="hold")


def test_a_restart_resumes_where_the_configuration_says_so():
    desk = Desk(_airborne("HOLD"), resume_after_restart=True)
    assert desk.go(3.0, until="hold")


def test_a_dozen_setpoints_go_out_before_the_mode_is_asked_for():
    desk = Desk(_airborne("HOLD"))
    desk.go(1.0)
    desk.call("engage")
    while not any(a.kind is Kind.CONTROL for a in desk.vehicle.actions):
        desk.step()
    assert len(desk.vehicle.sent) == 12


def test_a_control_mode_that_stays_away_is_given_up():
    vehicle = _airborne("HOLD")
    vehicle.ignores = (Kind.CONTROL,)
    desk = Desk(vehicle)
    desk.go(1.0)
    call = desk.call("engage")
    desk.go(5.0)
    assert desk.state == "yielded"
    assert call.answer and call.answer.outcome == "failed" and "OFFBOARD" in call.answer.reason
    assert sum(a.kind is Kind.CONTROL for a in vehicle.actions) == 2


def test_stale_telemetry_silences_helm_and_a_lost_autopilot_is_found_again():
    desk = Desk().fly().chase()
    desk.go(1.0)
    desk.vehicle.silent = True
    desk.go(1.2)
    sent = len(desk.vehicle.sent)
    assert desk.state == "failsafe"
    desk.go(3.0)
    assert desk.state == "disconnected"
    assert len(desk.vehicle.sent) == sent
    desk.vehicle.silent = False
    desk.go(1.0)
    assert desk.state == "yielded"


def test_an_estimate_that_stands_still_silences_helm():
    desk = Desk().fly()
    desk.vehicle.frozen_estimate = True
    assert desk.go(2.0, until="failsafe")
    desk.vehicle.frozen_estimate = False
    assert desk.go(1.0, until="yielded")


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


def test_each_attitude_becomes_one_state():
    desk = Desk().fly()
    states = [o for o in desk.step() if isinstance(o.message, VehicleState)]
    assert len(states) == 1
    assert states[0].capture_ns == desk.t_ns - 5_000_000


def test_an_absent_autopilot_is_named_with_its_cure():
    desk = Desk(VehicleDouble(silent=True))
    desk.go(1.0)
    assert desk.status and desk.state == "disconnected"
    assert "udpin://127.0.0.1:14540" in desk.status.reason and "start it" in desk.status.reason


def test_stopping_helm_in_flight_hands_over_to_hold():
    desk = Desk().fly()
    desk.node.close()
    assert desk.vehicle._closed_with_hold is True


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
