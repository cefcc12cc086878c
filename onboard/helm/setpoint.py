"""The one kind of setpoint that helm sends: horizontal velocity with held altitude and heading rate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from common.messages import Vec3

VELOCITY_WITH_ALTITUDE = 0x5E3
"""Type mask: use z, vx, vy and the heading rate; ignore x, y, vz, accelerations and heading. PX4 held the altitude
within 0.25 m with it, against 0.5 m of drift and more with a velocity in all three axes."""
_LOCAL_NED = 1


@dataclass(frozen=True)
class LocalSetpoint:
    """A setpoint in the autopilot's local frame."""

    north_m_s: float
    """Velocity north, m/s."""
    east_m_s: float
    """Velocity east, m/s."""
    local_z_m: float
    """Held altitude: z of the local frame, down, m."""
    yaw_rate_rad_s: float
    """Heading rate, clockwise, rad/s."""

    def fields(self, system: int, component: int, boot_ms: int = 0) -> dict[str, Any]:
        """Fields of SET_POSITION_TARGET_LOCAL_NED for a target system and component."""
        return {
            "time_boot_ms": boot_ms & 0xFFFFFFFF,
            "target_system": system,
            "target_component": component,
            "coordinate_frame": _LOCAL_NED,
            "type_mask": VELOCITY_WITH_ALTITUDE,
            "x": 0.0,
            "y": 0.0,
            "z": self.local_z_m,
            "vx": self.north_m_s,
            "vy": self.east_m_s,
            "vz": 0.0,
            "afx": 0.0,
            "afy": 0.0,
            "afz": 0.0,
            "yaw": 0.0,
            "yaw_rate": self.yaw_rate_rad_s,
        }


def hover_velocity(anchor_m: tuple[float, float], ned_p_m: Vec3, gain_1_s: float, speed_m_s: float) -> Vec3:
    """Velocity towards an anchor (north, east) from home: gain · error, at most `speed_m_s`; NED, m/s."""
    north, east = gain_1_s * (anchor_m[0] - ned_p_m[0]), gain_1_s * (anchor_m[1] - ned_p_m[1])
    speed = (north * north + east * east) ** 0.5
    scale = min(1.0, speed_m_s / speed) if speed > 0.0 else 0.0
    return (north * scale, east * scale, 0.0)
