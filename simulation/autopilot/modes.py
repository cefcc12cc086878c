"""The autopilot's modes: what may be armed, which mode flies, what follows a lost stream. No clock, no I/O.

It behaves as PX4 did in the loop: OFFBOARD needs a stream of setpoints; when the stream is lost a failsafe mode flies,
and OFFBOARD is re-entered by itself when it resumes, unless another mode was commanded meanwhile.
"""

from __future__ import annotations

from collections import deque

from simulation.autopilot.battery import WARNING_NONE
from simulation.autopilot.failsafe import Action, Failsafes, mode_of
from simulation.autopilot.flight_modes import Mode, Situation, Verdict
from simulation.autopilot.parameters import Parameters

STREAM_SETTLED_S = 0.5
"""How long a resumed stream must last before OFFBOARD is re-entered, s (PX4: within 0.8 s)."""
_NO_ARMING = (Mode.LAND, Mode.RETURN, Mode.DESCEND)
_AUTOMATIC_OVERRIDE, _OFFBOARD_OVERRIDE = 1, 2  # bits of COM_RC_OVERRIDE
_THROTTLE_LOW = -0.8  # of −1 to 1
_THROTTLE_CENTRE = 0.1


class ModeMachine:
    """State of arming and modes; every method takes the situation, so a test needs no clock.

    Args:
        parameters: COM_*, NAV_* and GF_* are read from it at each use.
    """

    def __init__(self, parameters: Parameters):
        self._parameters = parameters
        self._failsafes = Failsafes(parameters)
        self.mode = Mode.HOLD
        """The mode that flies."""
        self.intended = Mode.HOLD
        """The mode that was commanded last; differs from `mode` in a failsafe."""
        self.armed = False
        """Motors armed."""
        self.armed_at_s = 0.0
        """When they were armed, autopilot time, s."""
        self.failsafe = False
        """A failsafe decides the mode."""
        self.terminated = False
        """A failsafe ended the flight; only a reboot helps."""
        self.entries = 0
        """Grows each time a mode begins, also when it is the same one."""
        self.notices: deque[tuple[int, str]] = deque(maxlen=32)
        """What to tell the operator, oldest first: (MAV_SEVERITY, text). The reader takes from it."""
        self._flown = False
        self._landed_at_s: float | None = None
        self._stream_since_s: float | None = None
        self._stream_lost = False
        self._warning = WARNING_NONE

    def stream_alive(self, now: Situation) -> bool:
        """Whether setpoints arrive often enough for OFFBOARD, and can be flown."""
        flyable = now.position_ok or not now.stream_needs_position
        return flyable and now.stream_age_s < self._parameters["COM_OF_LOSS_T"]

    def arm(self, now: Situation, force: bool = False) -> Verdict:
        """Arm the motors; `force` skips the checks."""
        if self.armed:
            return Verdict.ACCEPTED
        reason = "" if force and not self.terminated else self._arming_refused(now)
        if reason:
            self.notices.append((2, f"Arming denied: {reason}"))
            return Verdict.TEMPORARILY_REJECTED
        self.armed, self.armed_at_s = True, now.t_s
        self._flown, self._landed_at_s = False, None
        self._failsafes.arm(now)
        self.notices.append((6, "Armed by external command"))
        return Verdict.ACCEPTED

    def disarm(self, now: Situation, force: bool = False) -> Verdict:
        """Stop the motors; refused in the air unless `force`."""
        if self.armed and not now.landed and not force:
            self.notices.append((2, "Disarming denied: not landed"))
            return Verdict.TEMPORARILY_REJECTED
        if self.armed:
            self._stop("Disarmed by external command")
        return Verdict.ACCEPTED

    def command(self, mode: Mode, now: Situation) -> Verdict:
        """Change to a mode; OFFBOARD without a stream and modes that cannot be flown now are refused."""
        reason = self._mode_refused(mode, now)
        if reason and mode is Mode.POSITION and not self._mode_refused(Mode.ALTITUDE, now):
            mode, reason = Mode.ALTITUDE, ""  # PX4 gives the pilot the next best
        if reason:
            self.notices.append((2, f"Switching to {mode.name.title()} is currently not available: {reason}"))
            return Verdict.TEMPORARILY_REJECTED
        self._failsafes.mode_commanded()
        self.failsafe = self._stream_lost = False
        self._stream_since_s = None
        self._enter(mode)
        self.intended = mode
        return Verdict.ACCEPTED

    def update(self, now: Situation) -> None:
        """Follow the situation: the stream, the pilot's sticks, failsafes, the end of a takeoff, idle motors."""
        self._warn_of_battery(now)
        if self.intended is Mode.OFFBOARD:
            self._watch_stream(now)
        if self.armed:
            if now.sticks_moved:
                self._let_the_pilot_take_over(now)
            self._follow_failsafes(now)
        if self.mode is Mode.TAKEOFF and self.armed and now.takeoff_done:
            self._enter(Mode.HOLD)
            self.intended = Mode.HOLD
        if self.armed:
            self._disarm_when_idle(now)

    def _mode_refused(self, mode: Mode, now: Situation) -> str:
        """Why a mode cannot be flown now, empty when it can."""
        if mode is Mode.OFFBOARD and not self.stream_alive(now):
            return "no offboard signal"
        if mode.manual and now.sticks_lost:
            return "no manual control"
        if self.armed and mode.needs_position and not now.position_ok:
            return "no valid position"
        if self.armed and mode.needs_height and not now.height_ok:
            return "no valid height"
        return ""

    def _arming_refused(self, now: Situation) -> str:
        """Why the motors must not be armed, empty when they may."""
        if self.terminated:
            return "flight was terminated, reboot"
        if not now.ready:
            return "system not ready"
        if self.mode in _NO_ARMING:
            return f"mode {self.mode.name} does not allow arming, change to HOLD"
        if self.mode.needs_position and not now.position_ok:
            return "no valid position"
        if self.mode is Mode.OFFBOARD and not self.stream_alive(now):
            return "no offboard signal"
        if now.battery_warning > WARNING_NONE:
            return "low battery"
        if now.link_lost:
            return "no connection to the ground station"
        if self.mode.manual:
            if now.sticks_lost:
                return "no manual control"
            holds_height = self.mode in (Mode.POSITION, Mode.ALTITUDE)
            if now.throttle > (_THROTTLE_CENTRE if holds_height else _THROTTLE_LOW):
                return "throttle above centre" if holds_height else "high throttle"
        return ""

    def _enter(self, mode: Mode) -> None:
        self.mode = mode
        self.entries += 1

    def _stop(self, notice: str) -> None:
        """Disarm. A failsafe ends with it: nothing re-enters OFFBOARD on the ground."""
        self.armed = False
        self._failsafes.reset()
        if self.failsafe:
            self.failsafe, self.intended = False, self.mode
        self.notices.append((6, notice))

    def _watch_stream(self, now: Situation) -> None:
        if not self.stream_alive(now):
            self._stream_since_s = None
            self._stream_lost = True
            if not self.armed:
                self._stream_lost = False
                self._enter(Mode.HOLD)
                self.intended = Mode.HOLD
            return
        if self._stream_since_s is None:
            self._stream_since_s = now.t_s
        if self._stream_lost and now.t_s - self._stream_since_s >= STREAM_SETTLED_S:
            self._stream_lost = False
            self.notices.append((4, "Offboard signal regained"))

    def _let_the_pilot_take_over(self, now: Situation) -> None:
        """The sticks were moved: Position mode, where COM_RC_OVERRIDE lets them."""
        bit = _OFFBOARD_OVERRIDE if self.mode is Mode.OFFBOARD else _AUTOMATIC_OVERRIDE
        if self.mode.manual or not int(self._parameters["COM_RC_OVERRIDE"]) & bit:
            return
        if self._failsafes.sticks_may_take_over() and self.command(Mode.POSITION, now) is Verdict.ACCEPTED:
            self.notices.append((6, "Pilot took over using sticks"))

    def _follow_failsafes(self, now: Situation) -> None:
        before = self._failsafes.action
        action = self._failsafes.update(now, self.intended, self._stream_lost)
        self.failsafe = action > Action.WARN
        if action >= Action.DISARM:
            self.terminated = action is Action.TERMINATE
            self._stop(f"Failsafe: {self._failsafes.cause}, motors stopped")
            return
        mode = mode_of(action, self.intended)
        if mode is not self.mode:
            self._enter(mode)
        if action > Action.WARN and action is not before:
            self.notices.append((2, f"Failsafe: {self._failsafes.cause}, {mode.name}"))
        elif action is Action.WARN and before is Action.NONE:
            self.notices.append((4, f"Warning: {self._failsafes.cause}"))

    def _warn_of_battery(self, now: Situation) -> None:
        if now.battery_warning > self._warning:
            severity, text = ((4, "Low battery level"), (2, "Critical battery level"), (0, "Emergency battery level"))[
                now.battery_warning - 1
            ]
            self.notices.append((severity, f"{text}, return advised" if severity == 4 else f"{text}, land now"))
        self._warning = max(self._warning, now.battery_warning)

    def _disarm_when_idle(self, now: Situation) -> None:
        if not now.landed:
            self._flown, self._landed_at_s = True, None
            return
        if self._landed_at_s is None:
            self._landed_at_s = now.t_s
        wait_s = self._parameters["COM_DISARM_LAND" if self._flown else "COM_DISARM_PRFLT"]
        if wait_s > 0 and now.t_s - self._landed_at_s >= wait_s:
            self._stop("Disarmed by landing" if self._flown else "Disarmed by auto preflight disarming")
