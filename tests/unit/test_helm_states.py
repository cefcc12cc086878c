"""The table of transitions: closed, reachable, safe; and its diagram in the documentation."""

from __future__ import annotations

from pathlib import Path

import pytest

from onboard.helm.diagram import rewrite
from onboard.helm.states import TRANSITIONS, Event, State, accepts, in_control, next_state

_FLYING = (State.HOLD, State.PURSUIT, State.OPERATOR, State.RETURNING, State.ENGAGING)


def test_every_state_is_reached_from_the_start():
    reached, frontier = {State.DISCONNECTED}, [State.DISCONNECTED]
    while frontier:
        state = frontier.pop()
        for (source, _), target in TRANSITIONS.items():
            if source is state and target not in reached:
                reached.add(target)
                frontier.append(target)
    assert reached == set(State)


@pytest.mark.parametrize("event", list(Event))
def test_every_event_means_something_somewhere(event: Event):
    assert accepts(event)


@pytest.mark.parametrize("state", _FLYING)
def test_whoever_flies_yields_to_others_and_to_silence(state: State):
    assert next_state(state, Event.MODE_TAKEN) is State.YIELDED
    assert next_state(state, Event.HUNG) is State.YIELDED
    assert next_state(state, Event.TELEMETRY_STALE) is State.FAILSAFE
    assert next_state(state, Event.AUTOPILOT_LOST) is State.DISCONNECTED


def test_yielded_is_left_into_flight_by_engage_alone():
    ways = {
        event
        for (state, event), target in TRANSITIONS.items()
        if state is State.YIELDED and target not in (State.STANDBY, State.DISCONNECTED)
    }
    assert ways == {Event.ENGAGE}


def test_nothing_but_a_confirmed_offboard_leads_into_control():
    entries = {(s, e) for (s, e), target in TRANSITIONS.items() if in_control(target) and not in_control(s)}
    assert entries == {(State.ENGAGING, Event.ENGAGED)}


def test_the_diagram_in_the_documentation_is_current():
    page = (Path(__file__).parents[2] / "docs" / "helm.md").read_text(encoding="utf-8")
    assert rewrite(page) == page, "run `python -m onboard.helm.diagram`"


def test_a_page_without_marks_is_refused():
    with pytest.raises(ValueError, match="put them where"):
        rewrite("# a page")
