"""What each `helm/do/…` command does: checked against the state, started, answered now or when it is done."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from common.messages import Reply
from onboard.helm.actions import Action, Kind
from onboard.helm.arbiter import Candidate
from onboard.helm.flight import Flight
from onboard.helm.orders import Call
from onboard.helm.preflight import gate, refusal
from onboard.helm.seen import Seen
from onboard.helm.states import Event, State, accepts, in_control
from onboard.helm.takeoff import Takeoff

_ENGAGE_S = 4.8
_TAKEOFF_S = 44.0
_ARM_S = 9.0
_DISARM_S = 4.5
_ESTIMATE_AGE_S = 0.5


def obey(call: Call, flight: Flight, seen: Seen, t_ns: int) -> None:
    """Start what a command asks for; its reply comes now or in a later cycle."""
    handler = _HANDLERS.get(call.name)
    if handler is None:
        _refuse(call, f"helm has no command {call.name!r}; expected one of {', '.join(_HANDLERS)}")
        return
    flight.machine.counters[call.name] += 1
    handler(call, flight, seen, t_ns)


def _refuse(call: Call, reason: str) -> None:
    call.reply(Reply(outcome="refused", reason=reason))


def _done(call: Call, reason: str) -> None:
    call.reply(Reply(outcome="done", reason=reason))


def _wrong_state(call: Call, flight: Flight, event: Event) -> None:
    """Refuse for the state, saying where the command is accepted and how to get there."""
    cure = "; `engage` takes the stick first" if flight.state is State.YIELDED else ""
    _refuse(
        call,
        f"helm is {flight.state} ({flight.machine.reason}); {event.value} is accepted in "
        f"{', '.join(accepts(event))}{cure}",
    )


def _after(flight: Flight, seconds: float, t_ns: int) -> int:
    return t_ns + int(seconds * 1e9)


def _gate_closed(call: Call, flight: Flight, seen: Seen, t_ns: int) -> bool:
    text = refusal(gate(seen.telemetry, flight.parameters.values, seen.camera, flight.config, t_ns))
    if text:
        _refuse(call, f"preflight gate closed: {text}")
    return bool(text)


def _arm(call: Call, flight: Flight, seen: Seen, t_ns: int) -> None:
    if flight.state is not State.STANDBY:
        _wrong_state(call, flight, Event.TAKEOFF)
    elif not _gate_closed(call, flight, seen, t_ns):
        flight.orders.wait("arm", call, _after(flight, _ARM_S, t_ns))
        flight.do(Action(Kind.ARM))


def _disarm(call: Call, flight: Flight, seen: Seen, t_ns: int) -> None:
    if seen.telemetry.in_air or not seen.telemetry.landed_known:
        _refuse(call, "the vehicle is in the air, or does not say that it is not; land first")
    elif flight.state is State.DISCONNECTED:
        _refuse(call, f"helm is {flight.state} ({flight.machine.reason})")
    else:
        flight.orders.wait("disarm", call, _after(flight, _DISARM_S, t_ns))
        flight.do(Action(Kind.DISARM))


def _takeoff(call: Call, flight: Flight, seen: Seen, t_ns: int) -> None:
    config = flight.config
    height_m = config.takeoff_height_m if call.command.height_m is None else call.command.height_m
    low = config.containment.height_min_m
    if flight.state is not State.STANDBY:
        _wrong_state(call, flight, Event.TAKEOFF)
    elif not low <= height_m <= config.takeoff_height_max_m:
        _refuse(call, f"height_m: got {height_m:g}, expected {low:g} to {config.takeoff_height_max_m:g} m")
    elif not _gate_closed(call, flight, seen, t_ns):
        flight.orders.wait("takeoff", call, _after(flight, _TAKEOFF_S, t_ns))
        flight.fire(Event.TAKEOFF, f"taking off to {height_m:g} m", seen.telemetry, t_ns)
        wanted = flight.parameters.wanted(seen.telemetry.dialect) | seen.telemetry.dialect.takeoff_parameters(height_m)
        flight.takeoff = Takeoff(height_m, wanted, seen.telemetry, t_ns)


def _hold(call: Call, flight: Flight, seen: Seen, t_ns: int) -> None:
    if flight.state is State.TAKING_OFF and not seen.telemetry.in_air:
        flight.do(Action(Kind.DISARM))
        flight.fire(Event.TAKEOFF_FAILED, "takeoff ended by hold before it left the ground", seen.telemetry, t_ns)
        _done(call, "takeoff ended on the ground, disarming")
    elif in_control(flight.state):
        flight.fire(Event.HOLD, "hold commanded", seen.telemetry, t_ns)
        _done(call, "hovering")
    elif flight.state is State.ENGAGING or flight.state in (State.TAKING_OFF, State.LANDING):
        flight.orders.settle("takeoff", "failed", "ended by hold")
        flight.fire(Event.HOLD, "hold commanded", seen.telemetry, t_ns)
        flight.orders.wait("engaged", call, _after(flight, _ENGAGE_S, t_ns))
    else:
        _wrong_state(call, flight, Event.HOLD)


def _land(call: Call, flight: Flight, seen: Seen, t_ns: int) -> None:
    if flight.state is State.LANDING:
        _done(call, "already landing")
    elif flight.fire(Event.LAND, "land commanded", seen.telemetry, t_ns):
        flight.orders.wait("landing", call, _after(flight, _ENGAGE_S, t_ns))
    else:
        _wrong_state(call, flight, Event.LAND)


def _return(call: Call, flight: Flight, seen: Seen, t_ns: int) -> None:
    if seen.telemetry.home_local_m is None:
        _refuse(call, "home is not known; land instead")
    elif flight.fire(Event.RETURN, "flying home", seen.telemetry, t_ns):
        _done(call, "flying home under the limiter, landing there")
    else:
        _wrong_state(call, flight, Event.RETURN)


def _engage(call: Call, flight: Flight, seen: Seen, t_ns: int) -> None:
    telemetry = seen.telemetry
    if in_control(flight.state):
        flight.fire(Event.ENGAGE, "engage commanded", telemetry, t_ns)
        _done(call, "helm has the stick already; hovering")
    elif flight.state is State.YIELDED and not (telemetry.armed and telemetry.in_air):
        _refuse(call, "the vehicle is not flying; use takeoff once it is in standby")
    elif flight.state is State.YIELDED and telemetry.estimate_age_s(t_ns) > _ESTIMATE_AGE_S:
        _refuse(call, "position and attitude are not fresh; wait for telemetry")
    elif flight.fire(Event.ENGAGE, "engage commanded", telemetry, t_ns):
        flight.orders.wait("engaged", call, _after(flight, _ENGAGE_S, t_ns))
    else:
        _wrong_state(call, flight, Event.ENGAGE)


@dataclass(frozen=True)
class _Source:
    """Whose requests a command lets helm obey."""

    name: str
    """In the replies."""
    newest: Callable[[Seen], Candidate | None]
    """Its newest request."""
    state: State
    event: Event
    missing: str
    """Why not, when it asks for nothing."""

    def __call__(self, call: Call, flight: Flight, seen: Seen, t_ns: int) -> None:
        newest = self.newest(seen)
        fresh_s = flight.config.freshness_s
        asks = newest is not None and (t_ns - newest.received_ns) / 1e9 < fresh_s
        if self.state is State.PURSUIT and seen.track is not None:  # it tracks before it may ask
            asks = asks or (seen.track.tracking and seen.track.age_s < fresh_s)
        if flight.state is self.state:
            _done(call, f"already obeying the {self.name}")
        elif not asks:
            _refuse(call, self.missing)
        elif flight.fire(self.event, f"{self.event.value} commanded", seen.telemetry, t_ns):
            _done(call, f"obeying the {self.name}")
        else:
            _wrong_state(call, flight, self.event)


_CHASE = _Source(
    "pursuit",
    lambda seen: seen.pursuit,
    State.PURSUIT,
    Event.CHASE,
    "the pursuit has no target; select one first",
)
_FOLLOW = _Source(
    "follower",
    lambda seen: seen.follow,
    State.FOLLOW,
    Event.FOLLOW,
    "the follower has no target that it sees; choose one first: a box on the console, or `outrider do follow-select`",
)
_APPROACH = _Source(
    "approach",
    lambda seen: seen.approach,
    State.APPROACH,
    Event.APPROACH,
    "the approach has no target; choose one first: on the console, or by `outrider do approach-select`",
)
_SEARCH = _Source(
    "search",
    lambda seen: seen.search,
    State.SEARCH,
    Event.SEARCH,
    "there is no search under way; begin one first: on the console, or by `outrider do search-start`",
)


def _push_back(call: Call, flight: Flight, seen: Seen, t_ns: int) -> None:
    """In every state: it changes what the limiter does, not what helm does."""
    on = call.command.on
    if on is None:
        _refuse(call, "got neither on nor off; say which")
        return
    flight.pilot.push_back(on)
    fastest_m_s = flight.pilot.limiter.push_back_m_s
    if on and fastest_m_s == 0.0:
        _refuse(call, "limiter.push_back_m_s is 0 in the vehicle file: expected a speed; set one and restart helm")
    else:
        _done(call, f"backing away at up to {fastest_m_s:g} m/s" if on else "the limiter backs away from nothing")


_HANDLERS: Mapping[str, Callable[[Call, Flight, Seen, int], None]] = MappingProxyType(
    {
        "helm/do/arm": _arm,
        "helm/do/disarm": _disarm,
        "helm/do/takeoff": _takeoff,
        "helm/do/hold": _hold,
        "helm/do/land": _land,
        "helm/do/return": _return,
        "helm/do/engage": _engage,
        "helm/do/chase": _CHASE,
        "helm/do/follow": _FOLLOW,
        "helm/do/approach": _APPROACH,
        "helm/do/push-back": _push_back,
        "helm/do/search": _SEARCH,
    }
)
COMMANDS: tuple[str, ...] = tuple(_HANDLERS)
"""Commands that helm answers."""
