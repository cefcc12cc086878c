"""The autopilot's modes: what may be armed, which mode flies, what follows a lost stream. No clock, no I/O.

It behaves as PX4 did in the loop: OFFBOARD needs a stream of setpoints; when the stream is lost a failsafe mode flies,
and OFFBOARD is re-entered by itself when it resumes, unless another mode was commanded meanwhile.
"""

from __future__ import annotations

from collections import deque
from enum import Enum, IntEnum
from typing import NamedTuple

from simulation.autopilot.parameters import Parameters

STREAM_SETTLED_S = 0.5
"""How long a resumed stream must last before OFFBOARD is re-entered, s (PX4: within 0.8 s)."""


class Mode(Enum):
    """Flight modes; the value is PX4's pair of main and sub mode."""

    TAKEOFF = (4, 2)
    HOLD = (4, 3)
    RETURN = (4, 5)
    LAND = (4, 6)
    OFFBOARD = (6, 0)

    @property
    def custom_mode(self) -> int:
        """HEARTBEAT.custom_mode of this mode."""
        return self.value[0] << 16 | self.value[1] << 24

    @property
    def automatic(self) -> bool:
        """Whether the autopilot itself decides where to fly."""
        return self.value[0] == 4


class Verdict(IntEnum):
    """Answer to a command (MAV_RESULT)."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4


class Situation(NamedTuple):
    """What the modes need to know of the vehicle at one instant."""

    t_s: float
    """Autopilot time, s."""
    ready: bool
    """Sensors and estimate good enough to fly."""
    landed: bool
    """On the ground."""
    stream_age_s: float
    """Time since the newest OFFBOARD setpoint, s; infinite when there was none."""
    takeoff_done: bool = False
    """The takeoff height is reached."""


_FAILSAFE = {0: Mode.RETURN, 3: Mode.RETURN, 4: Mode.LAND, 5: Mode.HOLD}
_NO_ARMING = (Mode.LAND, Mode.RETURN)


class ModeMachine:
    """State of arming and modes; every method takes the situation, so a test needs no clock.

    Args:
        parameters: COM_OF_LOSS_T, COM_OBL_RC_ACT, COM_DISARM_LAND, COM_DISARM_PRFLT are read from it at each use.
    """

    def __init__(self, parameters: Parameters):
        self._parameters = parameters
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
        self.entries = 0
        """Grows each time a mode begins, also when it is the same one."""
        self.notices: deque[tuple[int, str]] = deque(maxlen=32)
        """What to tell the operator, oldest first: (MAV_SEVERITY, text). The reader takes from it."""
        self._flown = False
        self._landed_at_s: float | None = None
        self._stream_since_s: float | None = None

    def stream_alive(self, now: Situation) -> bool:
        """Whether setpoints arrive often enough for OFFBOARD."""
        return now.stream_age_s < self._parameters["COM_OF_LOSS_T"]

    def arm(self, now: Situation, force: bool = False) -> Verdict:
        """Arm the motors; `force` skips the checks."""
        if self.armed:
            return Verdict.ACCEPTED
        reason = "" if force else self._arming_refused(now)
        if reason:
            self.notices.append((2, f"Arming denied: {reason}"))
            return Verdict.TEMPORARILY_REJECTED
        self.armed, self.armed_at_s = True, now.t_s
        self._flown, self._landed_at_s = False, None
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
        """Change to a mode; OFFBOARD without a stream is refused."""
        if mode is Mode.OFFBOARD and not self.stream_alive(now):
            self.notices.append((2, "Switching to Offboard is currently not available: no offboard signal"))
            return Verdict.TEMPORARILY_REJECTED
        self.failsafe = False
        self._enter(mode)
        self.intended = mode
        return Verdict.ACCEPTED

    def update(self, now: Situation) -> None:
        """Follow the situation: loss and return of the stream, end of the takeoff, automatic disarming."""
        if self.intended is Mode.OFFBOARD:
            self._watch_stream(now)
        if self.mode is Mode.TAKEOFF and self.armed and now.takeoff_done:
            self._enter(Mode.HOLD)
            self.intended = Mode.HOLD
        if self.armed:
            self._disarm_when_idle(now)

    def _arming_refused(self, now: Situation) -> str:
        """Why the motors must not be armed, empty when they may."""
        if not now.ready:
            return "system not ready"
        if self.mode in _NO_ARMING:
            return f"mode {self.mode.name} does not allow arming, change to HOLD"
        if self.mode is Mode.OFFBOARD and not self.stream_alive(now):
            return "no offboard signal"
        return ""

    def _enter(self, mode: Mode) -> None:
        self.mode = mode
        self.entries += 1

    def _stop(self, notice: str) -> None:
        """Disarm. A failsafe ends with it: nothing re-enters OFFBOARD on the ground."""
        self.armed = False
        if self.failsafe:
            self.failsafe, self.intended = False, self.mode
        self.notices.append((6, notice))

    def _watch_stream(self, now: Situation) -> None:
        if not self.stream_alive(now):
            self._stream_since_s = None
            if self.mode is Mode.OFFBOARD:
                self._lose_stream()
            return
        if self._stream_since_s is None:
            self._stream_since_s = now.t_s
        if self.failsafe and now.t_s - self._stream_since_s >= STREAM_SETTLED_S:
            self.failsafe = False
            self._enter(Mode.OFFBOARD)
            self.notices.append((4, "Offboard signal regained"))

    def _lose_stream(self) -> None:
        if not self.armed:
            self._enter(Mode.HOLD)
            self.intended = Mode.HOLD
            return
        self.failsafe = True
        self._enter(_FAILSAFE.get(int(self._parameters["COM_OBL_RC_ACT"]), Mode.RETURN))
        self.notices.append((2, f"Failsafe: no offboard signal, {self.mode.name}"))

    def _disarm_when_idle(self, now: Situation) -> None:
        if not now.landed:
            self._flown, self._landed_at_s = True, None
            return
        if self._landed_at_s is None:
            self._landed_at_s = now.t_s
        wait_s = self._parameters["COM_DISARM_LAND" if self._flown else "COM_DISARM_PRFLT"]
        if wait_s > 0 and now.t_s - self._landed_at_s >= wait_s:
            self._stop("Disarmed by landing" if self._flown else "Disarmed by auto preflight disarming")
