"""The kinds of setpoint that helm sends, before a dialect words them: horizontal velocity or acceleration, with held
altitude and heading rate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from common.messages import Vec3

_LOCAL_NED = 1
_FIELDS = ("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate")


@dataclass(frozen=True)
class LocalSetpoint:
    """A setpoint in the autopilot's local frame."""

    north_m_s: float
    """Velocity north, m/s."""
    east_m_s: float
    """Velocity east, m/s."""
    local_z_m: float
    """Held altitude: z of the local frame, down, m."""
    down_m_s: float
    """Velocity down that closes the height error, limited like the rest, m/s: for an autopilot that holds no altitude
    beside a horizontal velocity."""
    yaw_rate_rad_s: float
    """Heading rate, clockwise, rad/s."""


@dataclass(frozen=True)
class AccelerationSetpoint(LocalSetpoint):
    """A horizontal acceleration; its velocity is the one that it leads to, for an autopilot that takes no acceleration
    beside a held altitude."""

    north_m_s2: float
    """Acceleration north, m/s²."""
    east_m_s2: float
    """Acceleration east, m/s²."""


def position_target(type_mask: int, **used: float) -> dict[str, Any]:
    """Fields of SET_POSITION_TARGET_LOCAL_NED in the local NED frame, but for addressee and time.

    Args:
        type_mask: POSITION_TARGET_TYPEMASK, which says what is ignored.
        used: the fields that count, m, m/s, m/s², rad, rad/s; the others are 0.
    """
    return {"coordinate_frame": _LOCAL_NED, "type_mask": type_mask} | dict.fromkeys(_FIELDS, 0.0) | used


def hover_velocity(anchor_m: tuple[float, float], ned_p_m: Vec3, gain_1_s: float, speed_m_s: float) -> Vec3:
    """Velocity towards an anchor (north, east) from home: gain · error, at most `speed_m_s`; NED, m/s."""
    north, east = gain_1_s * (anchor_m[0] - ned_p_m[0]), gain_1_s * (anchor_m[1] - ned_p_m[1])
    speed = (north * north + east * east) ** 0.5
    scale = min(1.0, speed_m_s / speed) if speed > 0.0 else 0.0
    return (north * scale, east * scale, 0.0)
