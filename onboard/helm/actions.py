"""What helm asks of the autopilot's link, and what the link gives back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from onboard.helm.dialect.base import Kind
from onboard.helm.setpoint import LocalSetpoint
from onboard.helm.telemetry import Telemetry


@dataclass(frozen=True)
class Action:
    """One thing for the worker to do."""

    kind: Kind
    """What."""
    parameters: Mapping[str, float | int] = field(default_factory=dict)
    """`PARAMETERS`: the values wanted; whole numbers are integer parameters."""
    height_m: float = math.nan
    """`TAKEOFF`: height above home, m."""
    write: bool = False
    """`PARAMETERS`: write what differs (on the ground only), then read back."""


@dataclass(frozen=True)
class ActionResult:
    """What became of an action. Accepted is not done: the mode, the arming and the climb are verified by telemetry."""

    action: Action
    """Which."""
    ok: bool
    """Whether the autopilot accepted it."""
    text: str = ""
    """What it answered, when it did not."""
    values: Mapping[str, float] = field(default_factory=dict)
    """`PARAMETERS`: values as read back; missing when one could not be read."""


class Link(Protocol):
    """The autopilot as the control loop sees it; nothing here blocks."""

    def poll(self, t_ns: int) -> Telemetry:
        """Newest telemetry, with every attitude since the last call."""
        ...

    def send(self, setpoint: LocalSetpoint) -> bool:
        """Send one setpoint now; False when it could not be sent."""
        ...

    def tell(self, name: str, fields: Mapping[str, Any]) -> bool:
        """Send one message that needs no answer now; False when it could not be sent."""
        ...

    def submit(self, action: Action) -> None:
        """Queue an action for the worker."""
        ...

    def results(self) -> list[ActionResult]:
        """Results since the last call, oldest first."""
        ...

    def metrics(self) -> dict[str, float]:
        """Counts for the health message."""
        ...

    def close(self, hold: bool) -> None:
        """End the link; with `hold`, ask the autopilot to hold first."""
        ...
