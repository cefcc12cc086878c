"""A takeoff that trusts nothing: acknowledged is not climbed. (One in 34 was, and stayed down.)"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from onboard.helm.actions import Action, ActionResult, Kind
from onboard.helm.telemetry import Telemetry

_CLIMB_M = 0.5
_CLIMB_WITHIN_S = 4.5
_STEP_WITHIN_S = 8.0
_NEAR_M = 0.3
_STALLED_S = 4.0
_ATTEMPTS = 2


class Phase(StrEnum):
    """Where a takeoff stands."""

    PARAMETER = "writing the parameters"
    ARMING = "arming"
    COMMAND = "commanding takeoff"
    CLIMB = "waiting for the climb"
    RISING = "rising"


@dataclass(frozen=True)
class Outcome:
    """How a takeoff ended."""

    climbed: bool
    """Whether the height was reached."""
    in_air: bool
    """Whether the vehicle flies (a takeoff that stalled in the air leaves it flying)."""
    reason: str
    """One sentence."""


class Takeoff:
    """One takeoff: parameters, arming, command, climb verified, one retry.

    Args:
        height_m: height above home, m.
        parameters: what the autopilot must have, the takeoff's own among it; verified once more.
        telemetry: the vehicle now, on the ground.
        t_ns: now, ns.
    """

    def __init__(self, height_m: float, parameters: Mapping[str, float | int], telemetry: Telemetry, t_ns: int):
        self.height_m = height_m
        self.phase = Phase.PARAMETER
        self._writing = Action(Kind.PARAMETERS, dict(parameters), write=True)
        self.retries = 0
        self._ground_m = telemetry.height_m
        self._since_ns = t_ns
        self._asked = False
        self._accepted = False
        self._highest_m = -math.inf
        self._highest_ns = t_ns
        self._refusal = ""

    def step(self, telemetry: Telemetry, results: list[ActionResult], t_ns: int) -> tuple[list[Action], Outcome | None]:
        """Actions to submit now, and the outcome once there is one."""
        for result in results:
            outcome = self._hear(result, t_ns)
            if outcome is not None:
                return [], outcome
        if self.phase in (Phase.PARAMETER, Phase.ARMING, Phase.COMMAND):
            return self._prepare(telemetry, t_ns)
        if self.phase is Phase.CLIMB:
            return self._watch_climb(telemetry, t_ns)
        return [], self._rise(telemetry, t_ns)

    def _go(self, phase: Phase, t_ns: int) -> None:
        self.phase, self._since_ns, self._asked, self._accepted = phase, t_ns, False, False

    def _hear(self, result: ActionResult, t_ns: int) -> Outcome | None:
        expected = {Phase.PARAMETER: Kind.PARAMETERS, Phase.ARMING: Kind.ARM, Phase.COMMAND: Kind.TAKEOFF}
        if result.action.kind is not expected.get(self.phase):
            return None
        if self.phase is Phase.PARAMETER and result.action is not self._writing:
            return None  # a routine check that was queued before
        if not result.ok:
            return Outcome(False, False, f"the autopilot refused while {self.phase.value}: {result.text}")
        if self.phase is Phase.PARAMETER:
            self._go(Phase.ARMING, t_ns)
        elif self.phase is Phase.ARMING:
            self._accepted = True
        else:
            self._go(Phase.CLIMB, t_ns)
        return None

    def _prepare(self, telemetry: Telemetry, t_ns: int) -> tuple[list[Action], Outcome | None]:
        if self.phase is Phase.ARMING and telemetry.armed:
            self._go(Phase.COMMAND, t_ns)
        if (t_ns - self._since_ns) / 1e9 > _STEP_WITHIN_S:
            return [], Outcome(
                False,
                False,
                f"no progress for {_STEP_WITHIN_S:g} s while {self.phase.value}; look at the autopilot's messages",
            )
        if self._asked:
            return [], None
        self._asked = True
        if self.phase is Phase.PARAMETER:
            return [self._writing], None
        if self.phase is Phase.ARMING:
            return [Action(Kind.ARM)], None
        return [Action(Kind.TAKEOFF, height_m=self.height_m)], None

    def _watch_climb(self, telemetry: Telemetry, t_ns: int) -> tuple[list[Action], Outcome | None]:
        gained_m = telemetry.height_m - self._ground_m
        if gained_m > _CLIMB_M:
            self._highest_m, self._highest_ns = telemetry.height_m, t_ns
            self._go(Phase.RISING, t_ns)
            return [], None
        if (t_ns - self._since_ns) / 1e9 < _CLIMB_WITHIN_S:
            return [], None
        if self.retries + 1 >= _ATTEMPTS:
            return [], Outcome(
                False,
                telemetry.in_air,
                f"takeoff was acknowledged {_ATTEMPTS} times and the vehicle "
                f"did not climb ({gained_m:.1f} m); check motors and load",
            )
        self.retries += 1
        self._go(Phase.COMMAND if telemetry.armed else Phase.ARMING, t_ns)
        return [], None

    def _rise(self, telemetry: Telemetry, t_ns: int) -> Outcome | None:
        height_m = telemetry.height_m
        if height_m >= self.height_m - _NEAR_M:
            return Outcome(True, True, f"at {height_m:.1f} m")
        if height_m > self._highest_m + 0.05:
            self._highest_m, self._highest_ns = height_m, t_ns
        if not telemetry.armed:
            return Outcome(False, False, f"the autopilot disarmed at {height_m:.1f} m")
        if (t_ns - self._highest_ns) / 1e9 > _STALLED_S:
            return Outcome(False, True, f"the climb stopped at {height_m:.1f} m of {self.height_m:.1f} m")
        return None
