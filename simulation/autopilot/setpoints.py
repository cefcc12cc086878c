"""SET_POSITION_TARGET_LOCAL_NED as a motion setpoint, by its type mask."""

from __future__ import annotations

import math
from typing import Any

from simulation.autopilot.control import NAN, MotionSetpoint
from simulation.autopilot.plant import Vec3

FRAME_LOCAL_NED = 1
FRAME_BODY_NED = 8  # x along the heading, y to its right, z down
_FORCE = 512
_IGNORE_YAW = 1024
_IGNORE_YAW_RATE = 2048


class SetpointRefused(ValueError):
    """A setpoint that is not flown; the text is the name under which it is counted."""


def decode(message: Any, yaw_rad: float) -> MotionSetpoint:
    """Motion setpoint of a SET_POSITION_TARGET_LOCAL_NED message.

    A masked component is left free, whatever it holds, and so is one that is NaN, as in PX4.

    Args:
        message: the pymavlink message.
        yaw_rad: present heading, rad, which turns body-frame vectors.

    Raises:
        SetpointRefused: `frame` (neither LOCAL_NED nor BODY_NED, or a position in the body frame), `force`, `infinite`
            (a component in use), `incomplete` (an axis with neither position, velocity nor acceleration, or a
            body-frame vector with one horizontal component).
    """
    mask = message.type_mask
    if message.coordinate_frame not in (FRAME_LOCAL_NED, FRAME_BODY_NED):
        raise SetpointRefused("frame")
    if mask & _FORCE:
        raise SetpointRefused("force")
    position = _masked(mask, 0, message.x, message.y, message.z)
    velocity = _masked(mask, 3, message.vx, message.vy, message.vz)
    acceleration = _masked(mask, 6, message.afx, message.afy, message.afz)
    yaw = NAN if mask & _IGNORE_YAW else message.yaw
    yaw_rate = NAN if mask & _IGNORE_YAW_RATE else message.yaw_rate
    if any(math.isinf(value) for value in (*position, *velocity, *acceleration, yaw, yaw_rate)):
        raise SetpointRefused("infinite")
    if message.coordinate_frame == FRAME_BODY_NED:
        if not math.isnan(position[0]) or not math.isnan(position[1]):
            raise SetpointRefused("frame")
        velocity, acceleration = _turn(velocity, yaw_rad), _turn(acceleration, yaw_rad)
    for axis in range(3):
        if all(math.isnan(vector[axis]) for vector in (position, velocity, acceleration)):
            raise SetpointRefused("incomplete")
    return MotionSetpoint(position, velocity, acceleration, yaw, yaw_rate)


def _masked(mask: int, shift: int, x: float, y: float, z: float) -> Vec3:
    bits = mask >> shift
    return NAN if bits & 1 else x, NAN if bits & 2 else y, NAN if bits & 4 else z


def _turn(vector: Vec3, yaw_rad: float) -> Vec3:
    """A vector of the heading frame in NED; a horizontal component without the other frees both."""
    x, y, z = vector
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    return x * cos - y * sin, x * sin + y * cos, z
