"""Flight modes, answers to commands, and what the modes need to know of the vehicle."""

from __future__ import annotations

import math
from enum import Enum, IntEnum
from typing import NamedTuple


class Mode(Enum):
    """Flight modes; the value begins with PX4's pair of main and sub mode."""

    MANUAL = (1, 0)
    ALTITUDE = (2, 0)
    POSITION = (3, 0)
    TAKEOFF = (4, 2)
    HOLD = (4, 3)
    RETURN = (4, 5)
    LAND = (4, 6)
    DESCEND = (4, 6, 1)  # PX4's blind landing: no client can command it, and it reads as LAND
    ACRO = (5, 0)
    OFFBOARD = (6, 0)
    STABILIZED = (7, 0)

    @property
    def custom_mode(self) -> int:
        """HEARTBEAT.custom_mode of this mode."""
        return self.value[0] << 16 | self.value[1] << 24

    @property
    def automatic(self) -> bool:
        """Whether the autopilot itself decides where to fly."""
        return self.value[0] == 4

    @property
    def manual(self) -> bool:
        """Whether a pilot's sticks steer."""
        return self.value[0] in (1, 2, 3, 5, 7)

    @property
    def needs_position(self) -> bool:
        """Whether the mode cannot be flown without a valid horizontal position."""
        return self in _POSITION_MODES

    @property
    def needs_height(self) -> bool:
        """Whether the mode cannot be flown without a valid height."""
        return self in _POSITION_MODES or self is Mode.ALTITUDE


_POSITION_MODES = (Mode.POSITION, Mode.TAKEOFF, Mode.HOLD, Mode.RETURN, Mode.LAND)


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
    position_ok: bool = True
    """The horizontal position is valid."""
    height_ok: bool = True
    """The height is valid."""
    sticks_lost: bool = True
    """No pilot's sticks are heard."""
    sticks_moved: bool = False
    """The pilot moves the sticks: more than a hand that rests on them."""
    throttle: float = math.nan
    """The pilot's throttle, −1 to 1; NaN without sticks."""
    link_lost: bool = False
    """No ground station is heard, and NAV_DLL_ACT cares."""
    battery_warning: int = 0
    """Level of the battery's warning, 0 to 3."""
    fence_breached: bool = False
    """Outside the geofence."""
    stream_needs_position: bool = True
    """The OFFBOARD setpoints are of motion, not of attitude."""
