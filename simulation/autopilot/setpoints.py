"""SET_POSITION_TARGET_LOCAL_NED and SET_ATTITUDE_TARGET as setpoints, by their type masks."""

from __future__ import annotations

import math
from typing import Any

from simulation.autopilot.motion import NAN, AttitudeSetpoint, MotionSetpoint
from simulation.autopilot.plant import Vec3

FRAME_LOCAL_NED = 1
FRAME_BODY_NED = 8  # x along the heading, y to its right, z down
_FORCE = 512
_IGNORE_YAW = 1024
_IGNORE_YAW_RATE = 2048
_IGNORE_BODY_RATES = (1, 2, 4)
_IGNORE_THRUST = 64
_IGNORE_ATTITUDE = 128


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


def decode_attitude(message: Any) -> AttitudeSetpoint:
    """Attitude setpoint of a SET_ATTITUDE_TARGET message.

    As in PX4 the attitude wins where it is not masked: of the body rates only the third is then used, as the
    feed-forward of the heading. Without an attitude all three body rates must be given.

    Args:
        message: the pymavlink message.

    Raises:
        SetpointRefused: `infinite` (a component in use is not finite), `incomplete` (no thrust, or neither an attitude
            nor body rates), `no_rotation` (a quaternion without length).
    """
    mask = message.type_mask
    rates = (message.body_roll_rate, message.body_pitch_rate, message.body_yaw_rate)
    roll, pitch, yaw = (NAN if mask & bit else rate for bit, rate in zip(_IGNORE_BODY_RATES, rates, strict=True))
    if mask & _IGNORE_THRUST:
        raise SetpointRefused("incomplete")
    if mask & _IGNORE_ATTITUDE:
        if math.isnan(roll) or math.isnan(pitch) or math.isnan(yaw):
            raise SetpointRefused("incomplete")
        if not all(math.isfinite(value) for value in (roll, pitch, yaw, message.thrust)):
            raise SetpointRefused("infinite")
        return AttitudeSetpoint(None, (roll, pitch, yaw), message.thrust)
    if math.isinf(yaw) or not all(math.isfinite(value) for value in (*message.q, message.thrust)):
        raise SetpointRefused("infinite")
    w, x, y, z = message.q
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if length < 1e-3:
        raise SetpointRefused("no_rotation")
    quat = (w / length, x / length, y / length, z / length)
    return AttitudeSetpoint(quat, (NAN, NAN, yaw), message.thrust)


def _masked(mask: int, shift: int, x: float, y: float, z: float) -> Vec3:
    bits = mask >> shift
    return NAN if bits & 1 else x, NAN if bits & 2 else y, NAN if bits & 4 else z


def _turn(vector: Vec3, yaw_rad: float) -> Vec3:
    """A vector of the heading frame in NED; a horizontal component without the other frees both."""
    x, y, z = vector
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    return x * cos - y * sin, x * sin + y * cos, z
