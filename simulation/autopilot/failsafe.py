"""What the autopilot does by itself when something fails: causes, actions and the pilot's right to take over.

As PX4's commander: each cause asks for an action, the worst one is flown; most of them hold first for COM_FAIL_ACT_T so
that a pilot can react; a mode commanded during a failsafe takes over; what cannot be flown falls through to what can.
The loss of the OFFBOARD stream and of the position is a fallback without that delay.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple

from simulation.autopilot.battery import WARNING_CRITICAL, WARNING_EMERGENCY, WARNING_NONE
from simulation.autopilot.flight_modes import Mode, Situation
from simulation.autopilot.parameters import Parameters


class Action(IntEnum):
    """What a failsafe does, from harmless to final; the worst of those that are asked for is flown."""

    NONE = 0
    WARN = 1
    POSITION = 2
    ALTITUDE = 3
    STABILIZED = 4
    HOLD = 5
    RETURN = 6
    LAND = 7
    DESCEND = 8
    DISARM = 9
    TERMINATE = 10


class Takeover(IntEnum):
    """Who may take over from an action."""

    ALWAYS = 0
    MODE_SWITCH = 1
    NEVER = 2


class Option(NamedTuple):
    """What a cause asks for."""

    action: Action
    """The action."""
    keeps: bool = False
    """It goes on, although its cause has ended, until a mode is commanded or the motors stop."""
    waits: bool = True
    """The vehicle holds for COM_FAIL_ACT_T first."""
    takeover: Takeover = Takeover.ALWAYS
    """Who may take over."""


_LINK = {
    1: Option(Action.HOLD, keeps=True),
    2: Option(Action.RETURN, keeps=True),
    3: Option(Action.LAND, keeps=True),
    5: Option(Action.TERMINATE, keeps=True, takeover=Takeover.NEVER),
    6: Option(Action.DISARM, takeover=Takeover.NEVER),
}
_FENCE = {
    1: Option(Action.WARN),
    2: Option(Action.HOLD, keeps=True, waits=False, takeover=Takeover.MODE_SWITCH),
    3: Option(Action.RETURN, keeps=True),
    4: Option(Action.TERMINATE, keeps=True, takeover=Takeover.NEVER),
    5: Option(Action.LAND, keeps=True),
}
_STREAM = {
    0: Action.POSITION,
    1: Action.ALTITUDE,
    2: Action.STABILIZED,
    3: Action.RETURN,
    4: Action.LAND,
    5: Action.HOLD,
    6: Action.TERMINATE,
    7: Action.DISARM,
}
_CRITICAL = {1: Action.RETURN, 2: Action.LAND, 3: Action.RETURN}  # COM_LOW_BAT_ACT at the critical level
_EMERGENCY = {1: Action.RETURN, 2: Action.LAND, 3: Action.LAND}
_MODES = {
    Action.POSITION: Mode.POSITION,
    Action.ALTITUDE: Mode.ALTITUDE,
    Action.STABILIZED: Mode.STABILIZED,
    Action.HOLD: Mode.HOLD,
    Action.RETURN: Mode.RETURN,
    Action.LAND: Mode.LAND,
    Action.DESCEND: Mode.DESCEND,
}
_STICKS_IGNORED = 4  # COM_RC_IN_MODE
_AUTOMATIC_EXCEPTED, _OFFBOARD_EXCEPTED = 2, 4  # bits of COM_RCL_EXCEPT and COM_DLL_EXCEPT


class Failsafes:
    """The causes that are active and the action that follows; no clock, no I/O.

    Args:
        parameters: read at each use.
    """

    def __init__(self, parameters: Parameters):
        self._parameters = parameters
        self.action = Action.NONE
        """The action in force."""
        self.cause = ""
        """What asked for it."""
        self._active: dict[str, Option] = {}
        self._failing: set[str] = set()
        self._until_s = -math.inf
        self._taken_over = False
        self._without_sticks = True
        self._warning_at_arming = WARNING_NONE

    def arm(self, now: Situation) -> None:
        """The motors start: what is missing now was accepted, and its absence is no failure later."""
        self.reset()
        self._without_sticks = now.sticks_lost
        self._warning_at_arming = now.battery_warning

    def reset(self) -> None:
        """The motors have stopped: every action ends."""
        self._active.clear()
        self._failing.clear()
        self._until_s, self._taken_over = -math.inf, False
        self.action, self.cause = Action.NONE, ""

    def mode_commanded(self) -> None:
        """Somebody commanded a mode: actions that end with that end, of the others it takes over."""
        self._active = {
            cause: option
            for cause, option in self._active.items()
            if cause in self._failing or option.takeover is Takeover.NEVER
        }
        self._taken_over = self.action >= Action.HOLD
        self._until_s = -math.inf

    def sticks_may_take_over(self) -> bool:
        """Whether moving the sticks ends the action in force."""
        return all(option.takeover is Takeover.ALWAYS for option in self._active.values())

    def update(self, now: Situation, intended: Mode, stream_lost: bool) -> Action:
        """Action in this situation, of an armed vehicle.

        Args:
            now: the situation.
            intended: the mode that was commanded.
            stream_lost: OFFBOARD has no setpoints that can be flown.
        """
        if not now.sticks_lost:
            self._without_sticks = False
        wanted = self._wanted(now, intended, stream_lost)
        if not wanted and not self._active:
            self.action, self._taken_over = Action.NONE, False
            return self.action
        self._merge(now, wanted)
        self.action, self.cause = self._select(now, intended, stream_lost)
        return self.action

    def _merge(self, now: Situation, wanted: dict[str, Option]) -> None:
        """Take in what the causes ask for, and drop what has ended."""
        for cause, option in wanted.items():
            if cause not in self._active:
                delay_s = float(self._parameters["COM_FAIL_ACT_T"])
                if option.waits and option.action > Action.WARN and self.action <= Action.HOLD and delay_s > 0.1:
                    self._until_s = max(self._until_s, now.t_s + delay_s)
                if option.action >= Action.HOLD:
                    self._taken_over = False
            self._active[cause] = option
        self._failing = set(wanted)
        for cause in [c for c, option in self._active.items() if c not in wanted and not option.keeps]:
            del self._active[cause]

    def _select(self, now: Situation, intended: Mode, stream_lost: bool) -> tuple[Action, str]:
        """The worst action, after delay, takeover and what can be flown; with its cause."""
        cause, option = max(self._active.items(), key=lambda item: item[1].action, default=("", Option(Action.NONE)))
        action = option.action
        strictest = max((o.takeover for o in self._active.values()), default=Takeover.ALWAYS)
        if action in (Action.RETURN, Action.LAND) and now.t_s < self._until_s and not self._taken_over:
            action = Action.HOLD
        if self._taken_over and strictest is not Takeover.NEVER and Action.HOLD <= action <= Action.DESCEND:
            action = max(Action.WARN, self._fallback(now, intended, stream_lost))
        while action in _MODES and not _can_run(_MODES[action], now, stream_lost):
            action = Action(action + 1)
        if intended is Mode.LAND and action is Action.RETURN:
            action = Action.WARN  # already on the way down
        return action, cause

    def _wanted(self, now: Situation, intended: Mode, stream_lost: bool) -> dict[str, Option]:
        """What each cause asks for now."""
        p = self._parameters
        wanted: dict[str, Option] = {}
        sticks_matter = not self._without_sticks and p["COM_RC_IN_MODE"] != _STICKS_IGNORED
        sticks_matter = sticks_matter and not _excepted(intended, int(p["COM_RCL_EXCEPT"]))
        if now.sticks_lost and sticks_matter and p["NAV_RCL_ACT"] in _LINK:
            wanted["manual control lost"] = _LINK[int(p["NAV_RCL_ACT"])]
        link_matters = intended is not Mode.LAND and not _excepted(intended, int(p["COM_DLL_EXCEPT"]))
        if now.link_lost and link_matters and p["NAV_DLL_ACT"] in _LINK:
            wanted["ground station lost"] = _LINK[int(p["NAV_DLL_ACT"])]
        if now.fence_breached and p["GF_ACTION"] in _FENCE:
            wanted["geofence"] = _FENCE[int(p["GF_ACTION"])]
        if now.battery_warning > self._warning_at_arming:
            table = {WARNING_CRITICAL: _CRITICAL, WARNING_EMERGENCY: _EMERGENCY}.get(now.battery_warning, {})
            action = table.get(int(p["COM_LOW_BAT_ACT"]), Action.WARN)
            wanted[f"battery level {now.battery_warning}"] = Option(action)
        fallback = self._fallback(now, intended, stream_lost)
        if fallback is not Action.NONE:
            wanted["no offboard signal" if stream_lost else "no position"] = Option(fallback, waits=False)
        return wanted

    def _fallback(self, now: Situation, intended: Mode, stream_lost: bool) -> Action:
        """What replaces a mode that cannot be flown."""
        action = Action.NONE
        if intended is Mode.OFFBOARD and stream_lost:
            action = _STREAM.get(int(self._parameters["COM_OBL_RC_ACT"]), Action.POSITION)
            if action is Action.DISARM:
                return action
            intended = _MODES.get(action, Mode.STABILIZED)
        if intended is Mode.POSITION and not _can_run(intended, now, stream_lost):
            action, intended = Action.ALTITUDE, Mode.ALTITUDE
        if intended is Mode.ALTITUDE and not _can_run(intended, now, stream_lost):
            action, intended = Action.STABILIZED, Mode.STABILIZED
        if now.sticks_lost and Action.POSITION <= action <= Action.STABILIZED:
            action, intended = Action.RETURN, Mode.RETURN
        return action if _can_run(intended, now, stream_lost) else max(action, Action.RETURN)


def mode_of(action: Action, intended: Mode) -> Mode:
    """The mode that an action flies; the intended one where it changes nothing."""
    return _MODES.get(action, intended)


def _can_run(mode: Mode, now: Situation, stream_lost: bool) -> bool:
    if mode is Mode.OFFBOARD:
        return not stream_lost
    return (now.position_ok or not mode.needs_position) and (now.height_ok or not mode.needs_height)


def _excepted(intended: Mode, mask: int) -> bool:
    """Whether the loss of a link does not matter in this mode."""
    if intended is Mode.OFFBOARD:
        return bool(mask & _OFFBOARD_EXCEPTED)
    return intended.automatic and bool(mask & _AUTOMATIC_EXCEPTED)
