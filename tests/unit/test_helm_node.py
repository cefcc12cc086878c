"""The helm node flown on a point-mass vehicle: whose request it obeys, and what it does when that is gone."""

from __future__ import annotations

import math

import pytest

from common.messages import Request
from tests.unit.helm_double import Desk


def _speed(desk: Desk) -> float:
    return math.hypot(desk.vehicle.v[0], desk.vehicle.v[1])


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
    assert refused.answer and "`outrider do search-start`" in refused.answer.reason
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
