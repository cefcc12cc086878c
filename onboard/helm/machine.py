"""The running state machine: present state, why, since when, and which flight modes it expects."""

from __future__ import annotations

import logging
from collections import Counter

from onboard.helm.dialect.base import Role
from onboard.helm.states import Event, State, in_control, next_state
from onboard.helm.telemetry import LINK_AGED_S, LINK_LOST_S, Telemetry

log = logging.getLogger(__name__)

_TAKEOFF_NEAR_M = 1.0
_ENGAGE_STREAM = 12
_REPORT_AFTER_NS = 20_000_000
_ENTERED = {State.TAKING_OFF: Role.TAKEOFF, State.ENGAGING: Role.CONTROL, State.LANDING: Role.LAND}


class Machine:
    """State, reason and the modes that fit the state.

    Args:
        reason: why there is no autopilot yet, and what to do.
    """

    def __init__(self, reason: str) -> None:
        self.state = State.DISCONNECTED
        self.reason = reason
        self.since_ns = 0
        self.counters: Counter[str] = Counter()
        self._entry_mode = ""
        self._entry_roles: frozenset[Role] = frozenset()
        self._confirmed = False
        self._from = State.DISCONNECTED

    def fire(self, event: Event, reason: str, telemetry: Telemetry, t_ns: int) -> bool:
        """Take the transition of an event, if the table has one; returns whether it did."""
        target = next_state(self.state, event)
        if target is None:
            return False
        log.info("%s -> %s (%s): %s", self.state, target, event.value, reason)
        self.reason = reason
        if target is not self.state:
            self._from = self.state
            self.state, self.since_ns = target, t_ns
            self._entry_mode, self._entry_roles, self._confirmed = telemetry.mode, telemetry.roles, False
        return True

    def in_state_s(self, t_ns: int) -> float:
        """Time since the state was entered, s."""
        return (t_ns - self.since_ns) / 1e9

    def foreign_mode(self, telemetry: Telemetry, takeoff_height_m: float) -> str | None:
        """The flight mode, when helm did not command it in this state; else None.

        On entry the mode before is tolerated until the state's own mode is reported for the first time (reports come
        late: 0.5 to 1 Hz); from then on any other mode is someone else's.
        """
        mode, roles, dialect = telemetry.mode, telemetry.roles, telemetry.dialect
        if in_control(self.state):  # entered with the control mode confirmed
            return None if Role.CONTROL in roles else mode
        wanted = _ENTERED.get(self.state)
        if wanted is None or telemetry.mode_ns < self.since_ns:
            return None
        if wanted in roles:
            self._confirmed = True
            return None
        on_ground = telemetry.landed_known and not telemetry.in_air
        if self.state is State.LANDING and on_ground:
            return None  # it may leave the landing by itself once it is down
        engaging = self.state is State.ENGAGING
        by_itself: set[Role] = set()
        near_top = telemetry.height_m > takeoff_height_m - _TAKEOFF_NEAR_M
        if (self.state is State.TAKING_OFF and (near_top or on_ground)) or (
            engaging and self._from is State.TAKING_OFF
        ):
            by_itself |= dialect.after_takeoff
        if engaging and Role.CONTROL in self._entry_roles:
            by_itself |= dialect.after_silence  # a loss failsafe that was due before the stream began
        as_before = mode == self._entry_mode and (not self._confirmed or on_ground or engaging)
        return None if as_before or by_itself & roles else mode


def presence(state: State, telemetry: Telemetry, t_ns: int, resume: bool, url: str) -> tuple[Event, str] | None:
    """The event that the autopilot's presence, silence or flight calls for in this state, with the reason."""
    age_s = telemetry.age_s(t_ns)
    if state is State.DISCONNECTED:
        return _found(telemetry, resume) if age_s < LINK_AGED_S else None
    if age_s > LINK_LOST_S:
        return Event.AUTOPILOT_LOST, (
            f"no word from the autopilot at {url} for {LINK_LOST_S:g} s; check its power and the cable or the port"
        )
    flying = next_state(state, Event.TELEMETRY_STALE) is not None
    if flying and max(age_s, telemetry.estimate_age_s(t_ns)) > LINK_AGED_S:
        return Event.TELEMETRY_STALE, (
            f"telemetry is older than {LINK_AGED_S:g} s: no more setpoints, the autopilot's own failsafe acts"
        )
    if state is State.FAILSAFE and max(age_s, telemetry.estimate_age_s(t_ns)) < LINK_AGED_S / 2:
        return Event.TELEMETRY_BACK, f"telemetry is back, mode {telemetry.mode}; `engage` takes the stick again"
    if telemetry.landed_known and telemetry.armed_known and not (telemetry.in_air or telemetry.armed):
        return Event.LANDED, "on the ground, disarmed"
    if state is State.STANDBY and telemetry.in_air and telemetry.armed:
        return Event.FOUND_IN_AIR, (
            f"the vehicle took off without helm, mode {telemetry.mode}; `engage` takes the stick"
        )
    return None


def _found(telemetry: Telemetry, resume: bool) -> tuple[Event, str] | None:
    """What a new link shows, once mode, arming and landed state are known."""
    known = telemetry.mode and telemetry.armed_known and telemetry.landed_known
    if not (known and telemetry.attitude and telemetry.position):
        return None
    if not telemetry.in_air:
        return Event.FOUND_ON_GROUND, f"autopilot found on the ground, mode {telemetry.mode}"
    what = f"found the vehicle in the air, mode {telemetry.mode}"
    if resume:
        return Event.RESUME, f"{what}; taking the stick as resume_after_restart says"
    return Event.FOUND_IN_AIR, f"{what}; no setpoints until `engage`"


class Engagement:
    """The way into the control mode: a dozen setpoints, then the mode, then its confirmation; one retry.

    Args:
        t_ns: now, ns.
    """

    def __init__(self, t_ns: int):
        self._sent = 0
        self._asked_ns: int | None = None
        self._accepted_ns: int | None = None
        self._attempts = 0
        self._start_ns = t_ns

    def sent(self) -> None:
        """Count a setpoint that went out."""
        self._sent += 1

    def accepted(self, t_ns: int) -> None:
        """Note that the autopilot accepted the mode."""
        self._accepted_ns = t_ns

    def confirmed(self, telemetry: Telemetry) -> bool:
        """Whether the control mode was reported after it was accepted. A report from before proves nothing: the
        autopilot may be about to leave it for want of setpoints."""
        return (
            Role.CONTROL in telemetry.roles
            and self._accepted_ns is not None
            and telemetry.mode_ns > self._accepted_ns + _REPORT_AFTER_NS
        )

    def due(self, t_ns: int) -> bool:
        """Whether to ask for the control mode now; true once per attempt."""
        if self._sent < _ENGAGE_STREAM or self._attempts >= 2:
            return False
        if self._asked_ns is not None and (t_ns - self._asked_ns) / 1e9 < 1.6:
            return False
        self._asked_ns = t_ns
        self._attempts += 1
        return True

    def failed(self, t_ns: int) -> bool:
        """Whether the mode stayed away for too long."""
        return (t_ns - self._start_ns) / 1e9 > 4.0
