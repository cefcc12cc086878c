"""What a vehicle does and shall do: the estimate of its motion, and setpoints of motion and of attitude."""

from __future__ import annotations

import math
from typing import NamedTuple

from simulation.autopilot.plant import Quat, Vec3

NAN = math.nan
FREE: Vec3 = (NAN, NAN, NAN)


class Estimate(NamedTuple):
    """What the flight controller believes of the vehicle's motion."""

    ned_p_m: Vec3
    """Position from home, NED, m."""
    ned_v_m_s: Vec3
    """Velocity, NED, m/s."""
    ned_q_body: Quat
    """Attitude (w, x, y, z)."""
    body_rates_rad_s: Vec3
    """Angular velocity, body frame, rad/s."""


class MotionSetpoint(NamedTuple):
    """What the vehicle shall do; NaN leaves a component free. Each axis needs a position, velocity or acceleration."""

    ned_p_m: Vec3 = FREE
    """Position from home, NED, m."""
    ned_v_m_s: Vec3 = FREE
    """Velocity, NED, m/s; beside a position it is the feed-forward."""
    ned_a_m_s2: Vec3 = FREE
    """Acceleration, NED, m/s²; beside a velocity it is the feed-forward."""
    yaw_rad: float = NAN
    """Heading from north, clockwise, rad; NaN with a NaN rate holds the heading at which that began."""
    yaw_rate_rad_s: float = NAN
    """Heading rate, clockwise, rad/s; beside a heading it is the feed-forward."""


class AttitudeSetpoint(NamedTuple):
    """Attitude or body rates, and thrust, as a client or a pilot's sticks ask for them; thrust is not corrected."""

    ned_q_body: Quat | None
    """Attitude (w, x, y, z); None: the body rates are steered instead."""
    body_rates_rad_s: Vec3
    """Body rates, rad/s; NaN leaves an axis alone. Beside an attitude the third is the feed-forward of the heading."""
    thrust: float
    """Thrust along −z of the body, 0 to 1; a hover takes `HOVER_THRUST`."""


Setpoint = MotionSetpoint | AttitudeSetpoint


def heading(quat: Quat) -> float:
    """Heading of the body's x axis from north, clockwise, rad, −π to π."""
    w, x, y, z = quat
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
