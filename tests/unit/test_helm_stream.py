"""When the helm node holds the stick, flown on a point-mass vehicle: foreign modes, hangs, restarts, silence."""

from __future__ import annotations

import pytest

from common.messages import VehicleState
from onboard.helm.actions import Kind
from tests.unit.helm_double import Desk, VehicleDouble


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
