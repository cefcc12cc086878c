"""What each `helm/do/…` command does: checked against the state, started, answered now or when it is done."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from common.messages import Reply
from onboard.helm.actions import Action, Kind
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
    text = refusal(gate(seen.telemetry, flight.parameters, seen.camera, flight.config, t_ns))
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
        wanted = flight.wanted(seen.telemetry) | seen.telemetry.dialect.takeoff_parameters(height_m)
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


def _chase(call: Call, flight: Flight, seen: Seen, t_ns: int) -> None:
    fresh = seen.pursuit is not None and (t_ns - seen.pursuit.received_ns) / 1e9 < flight.config.freshness_s
    tracked = seen.track is not None and seen.track.tracking and seen.track.age_s < flight.config.freshness_s
    if flight.state is State.PURSUIT:
        _done(call, "already chasing")
    elif not (fresh or tracked):
        _refuse(call, "the pursuit has no target; select one first")
    elif flight.fire(Event.CHASE, "chase commanded", seen.telemetry, t_ns):
        _done(call, "obeying the pursuit")
    else:
        _wrong_state(call, flight, Event.CHASE)


def _follow(call: Call, flight: Flight, seen: Seen, t_ns: int) -> None:
    fresh = seen.follow is not None and (t_ns - seen.follow.received_ns) / 1e9 < flight.config.freshness_s
    if flight.state is State.FOLLOW:
        _done(call, "already following")
    elif not fresh:
        _refuse(call, "the follower has no target that it sees; choose one first with follow/do/select")
    elif flight.fire(Event.FOLLOW, "follow commanded", seen.telemetry, t_ns):
        _done(call, "obeying the follower")
    else:
        _wrong_state(call, flight, Event.FOLLOW)


def _approach(call: Call, flight: Flight, seen: Seen, t_ns: int) -> None:
    fresh = seen.approach is not None and (t_ns - seen.approach.received_ns) / 1e9 < flight.config.freshness_s
    if flight.state is State.APPROACH:
        _done(call, "already approaching")
    elif not fresh:
        _refuse(call, "the approach has no target; choose one first with approach/do/select")
    elif flight.fire(Event.APPROACH, "approach commanded", seen.telemetry, t_ns):
        _done(call, "obeying the approach")
    else:
        _wrong_state(call, flight, Event.APPROACH)


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


def _search(call: Call, flight: Flight, seen: Seen, t_ns: int) -> None:
    fresh = seen.search is not None and (t_ns - seen.search.received_ns) / 1e9 < flight.config.freshness_s
    if flight.state is State.SEARCH:
        _done(call, "already searching")
    elif not fresh:
        _refuse(call, "there is no search under way; begin one first with search/do/start")
    elif flight.fire(Event.SEARCH, "search commanded", seen.telemetry, t_ns):
        _done(call, "obeying the search")
    else:
        _wrong_state(call, flight, Event.SEARCH)


_HANDLERS: Mapping[str, Callable[[Call, Flight, Seen, int], None]] = MappingProxyType(
    {
        "helm/do/arm": _arm,
        "helm/do/disarm": _disarm,
        "helm/do/takeoff": _takeoff,
        "helm/do/hold": _hold,
        "helm/do/land": _land,
        "helm/do/return": _return,
        "helm/do/engage": _engage,
        "helm/do/chase": _chase,
        "helm/do/follow": _follow,
        "helm/do/approach": _approach,
        "helm/do/push-back": _push_back,
        "helm/do/search": _search,
    }
)
COMMANDS: tuple[str, ...] = tuple(_HANDLERS)
"""Commands that helm answers."""
