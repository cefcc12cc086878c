"""What differs between autopilots, behind one interface: all that helm has to know of the one that it flies.

A dialect is data and pure functions: it names modes, makes commands and setpoints, and says what the autopilot does by
itself. Nothing outside this folder knows which autopilot is there. A new one is a file here, a line in the registry and
its parameters in `HelmConfig`; the contract tests fly it at once.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType
from typing import Any

from common.messages import Vec3
from onboard.helm.setpoint import LocalSetpoint, position_target

_PREARM_CHECK = 1 << 28  # MAV_SYS_STATUS_PREARM_CHECK


class Kind(StrEnum):
    """Blocking actions, done one after another by the link's worker."""

    ARM = "arm"
    DISARM = "disarm"
    TAKEOFF = "takeoff"
    LAND = "land"
    HOLD = "hold"
    CONTROL = "control"
    """Enter the mode in which helm's setpoints fly the vehicle."""
    PARAMETERS = "parameters"


class Role(StrEnum):
    """What a flight mode means to helm. A mode may have several, where the takeoff happens in control."""

    CONTROL = "control"
    """Helm's setpoints fly the vehicle."""
    TAKEOFF = "takeoff"
    """The autopilot's takeoff runs in it."""
    LAND = "land"
    """The autopilot lands here."""
    HOLD = "hold"
    """The autopilot stands still."""
    RETURN = "return"
    """The autopilot flies home."""


@dataclass(frozen=True)
class Command:
    """One COMMAND_LONG."""

    number: int
    """MAV_CMD."""
    params: tuple[float, ...] = ()
    """param1 onwards; NaN means not given, what is left out is 0."""


class Dialect:
    """One autopilot. This class itself is the one that is not known yet: no mode means anything to it."""

    name = "unknown"
    """As in `helm.dialect`."""
    title = "no known autopilot"
    """As people call it."""
    autopilot = -1
    """MAV_AUTOPILOT in its HEARTBEAT."""
    control_mode = ""
    """Name of the mode in which setpoints fly it."""
    mode_roles: Mapping[str, frozenset[Role]] = MappingProxyType({})
    """Roles of the modes that have any."""
    after_takeoff: frozenset[Role] = frozenset()
    """Modes that it enters by itself at the end of its takeoff."""
    after_silence: frozenset[Role] = frozenset()
    """Modes that it enters by itself when setpoints stay away."""
    on_silence = ""
    """What it does when setpoints stay away, as a clause."""
    silence_parameter = ""
    """Parameter that says for how long they may stay away, s."""
    takeoff_parameter = ""
    """Parameter that holds the height of a takeoff, m; empty where the command carries it."""
    parameters: Mapping[str, float | int] = MappingProxyType({})
    """What helm's safety rests on, by default. Whole numbers are integer parameters, others float."""
    parameter_titles: Mapping[str, str] = MappingProxyType({})
    """Names for the gate of parameters that deserve one."""
    height_gain_1_s = 1.0
    """Climb per metre of height error: what the autopilot's own altitude loop does, or what helm sends, 1/s."""
    messages: tuple[str, ...] = (
        "ATTITUDE_QUATERNION",
        "HIGHRES_IMU",
        "LOCAL_POSITION_NED",
        "HEARTBEAT",
        "CURRENT_MODE",
        "EXTENDED_SYS_STATE",
        "SYS_STATUS",
        "BATTERY_STATUS",
        "HOME_POSITION",
    )
    """Messages to listen to."""
    rates_hz: tuple[tuple[int, float], ...] = ()
    """Message id and rate to ask for, Hz."""

    def mode_name(self, custom_mode: int) -> str:
        """Name of a flight mode from HEARTBEAT.custom_mode."""
        return f"MODE{custom_mode}"

    def roles(self, mode: str) -> frozenset[Role]:
        """What a mode means to helm; nothing for one that is not helm's business."""
        return self.mode_roles.get(mode, frozenset())

    def commands(self, kind: Kind, mode: str, height_m: float) -> tuple[Command, ...]:
        """Commands that do an action, in order; each has to be accepted before the next is sent.

        Args:
            kind: which; `PARAMETERS` is no command.
            mode: the mode now.
            height_m: `TAKEOFF`: height above home, m.

        Raises:
            ValueError: the dialect has no commands for it.
        """
        raise ValueError(f"{self.title}: got the action {kind}, expected one that its dialect can do")

    def setpoint(self, setpoint: LocalSetpoint) -> dict[str, Any]:
        """Fields of SET_POSITION_TARGET_LOCAL_NED, but for addressee and time.

        Each kind of setpoint is a class of its own; a second kind is a second case here.

        Raises:
            ValueError: the dialect cannot express it.
        """
        raise ValueError(f"{self.title}: got a {type(setpoint).__name__}, expected a setpoint that its dialect has")

    def takeoff_parameters(self, height_m: float) -> dict[str, float | int]:
        """Parameters to write before a takeoff to a height above home, m."""
        return {self.takeoff_parameter: float(height_m)} if self.takeoff_parameter else {}

    def ready(self, sys_status: Mapping[str, Any]) -> bool:
        """Whether its own pre-arm checks pass, from SYS_STATUS."""
        return bool(int(sys_status["onboard_control_sensors_health"]) & _PREARM_CHECK)

    def home_local_m(self, home: Mapping[str, Any], origin: Mapping[str, Any] | None) -> Vec3 | None:
        """Home in the local frame, NED, m; None while it cannot be known.

        Args:
            home: HOME_POSITION.
            origin: GPS_GLOBAL_ORIGIN, where one has come.

        Raises:
            ValueError: it is not finite.
        """
        x, y, z = (math.nan if home[name] is None else float(home[name]) for name in ("x", "y", "z"))
        if not math.isfinite(x + y + z):
            raise ValueError(f"home is not finite: {home}")
        return (x, y, z)


UNKNOWN = Dialect()
"""No autopilot has been heard yet."""


def velocity_target(type_mask: int, setpoint: LocalSetpoint, **used: float) -> dict[str, Any]:
    """Fields for a velocity setpoint with a heading rate: horizontal velocity, and the dialect's own `z` or `vz`."""
    return position_target(
        type_mask, vx=setpoint.north_m_s, vy=setpoint.east_m_s, yaw_rate=setpoint.yaw_rate_rad_s, **used
    )
