"""Helm's state machine as data: (state, event) -> state. What is not in the table does not happen.

The diagram in `docs/helm.md` is written from this table (`python -m onboard.helm.diagram`).
"""

from __future__ import annotations

from enum import StrEnum


class State(StrEnum):
    """Where helm stands."""

    DISCONNECTED = "disconnected"
    """No autopilot."""
    STANDBY = "standby"
    """On the ground, autopilot present."""
    TAKING_OFF = "taking_off"
    """The autopilot's takeoff is under way and watched."""
    ENGAGING = "engaging"
    """Hover setpoints go out, the mode in which they fly the vehicle is asked for."""
    HOLD = "hold"
    """Hovering at an anchor."""
    PURSUIT = "pursuit"
    """Obeying the chase."""
    FOLLOW = "follow"
    """Obeying the vehicle's own follower of a target."""
    APPROACH = "approach"
    """Obeying the approach to a person or an obstacle."""
    SEARCH = "search"
    """Obeying the search over an area."""
    OPERATOR = "operator"
    """Obeying the operator's stick."""
    RETURNING = "returning"
    """Flying home under the limiter."""
    LANDING = "landing"
    """The autopilot lands here."""
    YIELDED = "yielded"
    """In the air, but not helm's: no setpoints until `engage`."""
    FAILSAFE = "failsafe"
    """Telemetry stopped in flight: no setpoints, the autopilot's own failsafe acts."""


class Event(StrEnum):
    """What moves the machine."""

    FOUND_ON_GROUND = "autopilot found on the ground"
    FOUND_IN_AIR = "autopilot found in the air"
    RESUME = "found in the air, resume_after_restart"
    AUTOPILOT_LOST = "autopilot lost"
    TELEMETRY_STALE = "telemetry stale"
    TELEMETRY_BACK = "telemetry back"
    TAKEOFF = "takeoff"
    CLIMBED = "height reached"
    TAKEOFF_FAILED = "takeoff failed"
    ENGAGE = "engage"
    ENGAGED = "control confirmed"
    ENGAGE_FAILED = "control refused"
    HOLD = "hold"
    CHASE = "chase"
    FOLLOW = "follow"
    APPROACH = "approach"
    SEARCH = "search"
    STICK = "operator moves the stick"
    STICK_RELEASED = "operator lets go"
    RETURN = "return"
    HOME_REACHED = "home reached"
    LAND = "land"
    LAND_FAILED = "landing refused"
    LANDED = "landed"
    MODE_TAKEN = "mode changed by others"
    HUNG = "helm's stream was interrupted"
    TARGET_AWAY = "too long without target"
    LINK_LOST_RETURN = "link lost, action return"
    LINK_LOST_LAND = "link lost, action land"
    LINK_LOST_HOVER = "link lost, action hover"
    TAKEN_OVER = "link lost, the follower takes over"
    HANDED_BACK = "link back, handed back to the chase"


_S, _E = State, Event

_IN_CONTROL = (_S.HOLD, _S.PURSUIT, _S.FOLLOW, _S.APPROACH, _S.SEARCH, _S.OPERATOR, _S.RETURNING)
"""States in which helm's setpoints fly the vehicle."""


def _table() -> dict[tuple[State, Event], State]:
    table = {
        (_S.DISCONNECTED, _E.FOUND_ON_GROUND): _S.STANDBY,
        (_S.DISCONNECTED, _E.FOUND_IN_AIR): _S.YIELDED,
        (_S.DISCONNECTED, _E.RESUME): _S.ENGAGING,
        (_S.STANDBY, _E.TAKEOFF): _S.TAKING_OFF,
        (_S.STANDBY, _E.FOUND_IN_AIR): _S.YIELDED,
        (_S.TAKING_OFF, _E.CLIMBED): _S.ENGAGING,
        (_S.TAKING_OFF, _E.TAKEOFF_FAILED): _S.STANDBY,
        (_S.TAKING_OFF, _E.HOLD): _S.ENGAGING,
        (_S.ENGAGING, _E.ENGAGED): _S.HOLD,
        (_S.ENGAGING, _E.ENGAGE_FAILED): _S.YIELDED,
        (_S.HOLD, _E.CHASE): _S.PURSUIT,
        (_S.HOLD, _E.FOLLOW): _S.FOLLOW,
        (_S.HOLD, _E.APPROACH): _S.APPROACH,
        (_S.HOLD, _E.SEARCH): _S.SEARCH,
        (_S.HOLD, _E.STICK): _S.OPERATOR,
        (_S.PURSUIT, _E.STICK): _S.OPERATOR,
        (_S.PURSUIT, _E.FOLLOW): _S.FOLLOW,
        (_S.PURSUIT, _E.TAKEN_OVER): _S.FOLLOW,
        (_S.FOLLOW, _E.STICK): _S.OPERATOR,
        (_S.FOLLOW, _E.CHASE): _S.PURSUIT,
        (_S.FOLLOW, _E.HANDED_BACK): _S.PURSUIT,
        (_S.APPROACH, _E.STICK): _S.OPERATOR,
        (_S.APPROACH, _E.TARGET_AWAY): _S.HOLD,
        (_S.APPROACH, _E.SEARCH): _S.SEARCH,
        (_S.SEARCH, _E.STICK): _S.OPERATOR,
        (_S.SEARCH, _E.TARGET_AWAY): _S.HOLD,
        (_S.SEARCH, _E.APPROACH): _S.APPROACH,
        (_S.PURSUIT, _E.TARGET_AWAY): _S.HOLD,
        (_S.FOLLOW, _E.TARGET_AWAY): _S.HOLD,
        (_S.OPERATOR, _E.STICK_RELEASED): _S.HOLD,
        (_S.OPERATOR, _E.CHASE): _S.PURSUIT,
        (_S.OPERATOR, _E.FOLLOW): _S.FOLLOW,
        (_S.OPERATOR, _E.APPROACH): _S.APPROACH,
        (_S.OPERATOR, _E.SEARCH): _S.SEARCH,
        (_S.RETURNING, _E.HOME_REACHED): _S.LANDING,
        (_S.RETURNING, _E.STICK): _S.OPERATOR,
        (_S.LANDING, _E.HOLD): _S.ENGAGING,
        (_S.LANDING, _E.LAND_FAILED): _S.ENGAGING,
        (_S.YIELDED, _E.ENGAGE): _S.ENGAGING,
        (_S.FAILSAFE, _E.TELEMETRY_BACK): _S.YIELDED,
    }
    for state in (_S.PURSUIT, _S.FOLLOW):
        table[state, _E.LINK_LOST_RETURN] = _S.RETURNING
        table[state, _E.LINK_LOST_LAND] = _S.LANDING
        table[state, _E.LINK_LOST_HOVER] = _S.HOLD
    for state in _IN_CONTROL:
        table[state, _E.HOLD] = _S.HOLD
        table[state, _E.LAND] = _S.LANDING
        table[state, _E.RETURN] = _S.RETURNING
        table[state, _E.ENGAGE] = _S.HOLD
    airborne = (*_IN_CONTROL, _S.ENGAGING, _S.TAKING_OFF, _S.LANDING)
    for state in airborne:
        table[state, _E.MODE_TAKEN] = _S.YIELDED
        table[state, _E.TELEMETRY_STALE] = _S.FAILSAFE
    for state in (*_IN_CONTROL, _S.ENGAGING):
        table[state, _E.HUNG] = _S.YIELDED
    for state in (*_IN_CONTROL, _S.ENGAGING, _S.LANDING, _S.YIELDED, _S.FAILSAFE):
        table[state, _E.LANDED] = _S.STANDBY
    for state in State:
        if state is not _S.DISCONNECTED:
            table[state, _E.AUTOPILOT_LOST] = _S.DISCONNECTED
    return table


TRANSITIONS: dict[tuple[State, Event], State] = _table()


def next_state(state: State, event: Event) -> State | None:
    """State after an event, or None when the event means nothing in this state (a command is then refused)."""
    return TRANSITIONS.get((state, event))


def in_control(state: State) -> bool:
    """Whether helm's setpoints fly the vehicle in this state."""
    return state in _IN_CONTROL


def accepts(event: Event) -> tuple[State, ...]:
    """States in which an event means something, for the text of a refusal."""
    return tuple(state for state in State if (state, event) in TRANSITIONS)
