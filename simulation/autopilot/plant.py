"""Rigid-body multirotor with four rotors in a plus arrangement (Al-Kaff 2019, eqs 8-18), one step at a time.

World frame NED with its origin on flat ground, body frame FRD. Rotor 1 is on the left arm, 2 in front, 3 on the right,
4 behind; 1 and 3 turn counter-clockwise seen from above, so their reaction turns the body clockwise (positive yaw).
Where the printed equations are garbled: the first entry of eq. 8 is cos θ cos ψ; eq. 17 writes z upwards although the
frame is NED, so gravity is +g here and thrust acts along −z of the body; the product in eq. 18 is the cross product
ω × Iω. Beyond the paper: the air moves (eq. 16 relative to the wind), rotors lag, and there is a ground.

Plain floats and tuples on purpose: at this size NumPy costs ten times the arithmetic.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

Vec3 = tuple[float, float, float]
Quat = tuple[float, float, float, float]
Rotors = tuple[float, float, float, float]

GRAVITY_M_S2 = 9.80665
_LEVELLING_TIME_S = 0.05  # how fast the ground levels a body that touches it
_FRICTION_M_S2 = 6.0  # sliding on the landing gear
_REST = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Airframe:
    """What the equations of motion need to know of a vehicle; defaults are those of PX4's built-in quadrotor."""

    mass_kg: float = 1.0
    """Mass, kg."""
    arm_m: float = 0.2
    """Arm length L, m."""
    thrust_n_s2: float = 5.0 / 900.0**2
    """Thrust coefficient k of eq. 14, N per (rad/s)²."""
    torque_n_m_s2: float = 0.1 / 900.0**2
    """Torque coefficient b of eq. 15, N m per (rad/s)²."""
    inertia_kg_m2: Vec3 = (0.025, 0.025, 0.030)
    """Diagonal of the inertia matrix of eq. 13 (body axes are principal axes), kg m²."""
    rotor_max_rad_s: float = 900.0
    """Fastest rotor speed, rad/s: 5 N a rotor, so a hover takes 0.49 of the thrust (PX4 in the loop: 0.495)."""
    rotor_lag_s: float = 0.038
    """Time constant of a rotor's speed, s."""
    drag_n_s_m: float = 0.1
    """Drag coefficient k_x = k_y = k_z of eq. 16, N per m/s."""


class PlantState(NamedTuple):
    """Motion of the vehicle at one instant."""

    ned_p_m: Vec3 = _REST
    """Position, NED, m; the ground is at z = 0."""
    ned_v_m_s: Vec3 = _REST
    """Velocity, NED, m/s."""
    ned_q_body: Quat = (1.0, 0.0, 0.0, 0.0)
    """Attitude (w, x, y, z)."""
    body_rates_rad_s: Vec3 = _REST
    """Angular velocity ω, body frame, rad/s."""
    rotors_rad_s: Rotors = (0.0, 0.0, 0.0, 0.0)
    """Rotor speeds, rad/s."""
    ned_a_m_s2: Vec3 = _REST
    """Acceleration over the last step, NED, m/s² (zero at rest on the ground)."""
    on_ground: bool = True
    """Whether the landing gear touches the ground."""


def step(
    airframe: Airframe, state: PlantState, rotor_commands_rad_s: Rotors, dt_s: float, wind_m_s: Vec3
) -> PlantState:
    """State one step later, with rotor commands and wind held over it.

    Args:
        airframe: the vehicle.
        state: where it is now.
        rotor_commands_rad_s: commanded rotor speeds, each clamped to 0 .. `rotor_max_rad_s`.
        dt_s: duration, s; up to about 5 ms keeps the integration error far below the sensor noise.
        wind_m_s: velocity of the air, NED, m/s.
    """
    keep = math.exp(-dt_s / airframe.rotor_lag_s)
    top = airframe.rotor_max_rad_s
    c1, c2, c3, c4 = rotor_commands_rad_s
    r1, r2, r3, r4 = state.rotors_rad_s
    c1, c2, c3, c4 = min(max(c1, 0.0), top), min(max(c2, 0.0), top), min(max(c3, 0.0), top), min(max(c4, 0.0), top)
    rotors = (c1 + (r1 - c1) * keep, c2 + (r2 - c2) * keep, c3 + (r3 - c3) * keep, c4 + (r4 - c4) * keep)
    thrust_n, torque_n_m = wrench(airframe, rotors)
    rates = _spin(airframe, state.body_rates_rad_s, torque_n_m, dt_s)
    quat = _turn(state.ned_q_body, rates, dt_s)

    # eq. 17 in NED: m a = (0, 0, m g) + R (0, 0, -T) - k (v - wind)
    w, x, y, z = quat
    lift = thrust_n / airframe.mass_kg
    drag = airframe.drag_n_s_m / airframe.mass_kg
    vn, ve, vd = state.ned_v_m_s
    an = -lift * 2.0 * (x * z + w * y) - drag * (vn - wind_m_s[0])
    ae = -lift * 2.0 * (y * z - w * x) - drag * (ve - wind_m_s[1])
    ad = GRAVITY_M_S2 - lift * (1.0 - 2.0 * (x * x + y * y)) - drag * (vd - wind_m_s[2])
    pn, pe, pd = state.ned_p_m
    half = 0.5 * dt_s
    position = (pn + (vn + half * an) * dt_s, pe + (ve + half * ae) * dt_s, pd + (vd + half * ad) * dt_s)
    velocity = (vn + an * dt_s, ve + ae * dt_s, vd + ad * dt_s)
    moved = PlantState(position, velocity, quat, rates, rotors, (an, ae, ad), False)
    return moved if position[2] < 0.0 else _touch(state, moved, dt_s)


def wrench(airframe: Airframe, rotors_rad_s: Rotors) -> tuple[float, Vec3]:
    """Total thrust (eq. 14, N, along −z of the body) and torque (eq. 15, body axes, N m) at these speeds."""
    r1, r2, r3, r4 = rotors_rad_s
    s1, s2, s3, s4 = r1 * r1, r2 * r2, r3 * r3, r4 * r4
    lever = airframe.arm_m * airframe.thrust_n_s2
    torque = (lever * (s1 - s3), lever * (s2 - s4), airframe.torque_n_m_s2 * (s1 - s2 + s3 - s4))
    return airframe.thrust_n_s2 * (s1 + s2 + s3 + s4), torque


def mix(airframe: Airframe, thrust_n: float, torque_n_m: Vec3) -> Rotors:
    """Rotor speeds that give a thrust and a torque: the inverse of `wrench`, rad/s.

    What the rotors cannot give together is given up in this order: yaw torque, then roll and pitch torque (both
    scaled alike), then thrust. So the result is always within 0 .. `rotor_max_rad_s`.
    """
    top = airframe.rotor_max_rad_s * airframe.rotor_max_rad_s
    mean = min(max(thrust_n / (4.0 * airframe.thrust_n_s2), 0.0), top)
    room = min(mean, top - mean)
    lever = 2.0 * airframe.arm_m * airframe.thrust_n_s2
    roll, pitch = torque_n_m[0] / lever, torque_n_m[1] / lever
    most = max(abs(roll), abs(pitch))
    if most > room:
        shrink = room / most
        roll, pitch, most = roll * shrink, pitch * shrink, room
    yaw = min(max(torque_n_m[2] / (4.0 * airframe.torque_n_m_s2), most - room), room - most)
    squares = (mean + roll + yaw, mean + pitch - yaw, mean - roll + yaw, mean - pitch - yaw)
    s1, s2, s3, s4 = (math.sqrt(min(max(s, 0.0), top)) for s in squares)
    return s1, s2, s3, s4


def down_axis(quat: Quat) -> Vec3:
    """Third column of R (eq. 8): the body's z axis in NED."""
    w, x, y, z = quat
    return 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)


def _spin(airframe: Airframe, rates: Vec3, torque: Vec3, dt_s: float) -> Vec3:
    """Angular velocity after a step of eq. 18, ω' = I⁻¹ (τ − ω × Iω), by the midpoint rule."""
    ix, iy, iz = airframe.inertia_kg_m2
    tx, ty, tz = torque
    p, q, r = rates
    half = 0.5 * dt_s
    pm = p + half * (tx - q * r * (iz - iy)) / ix
    qm = q + half * (ty - r * p * (ix - iz)) / iy
    rm = r + half * (tz - p * q * (iy - ix)) / iz
    return (
        p + dt_s * (tx - qm * rm * (iz - iy)) / ix,
        q + dt_s * (ty - rm * pm * (ix - iz)) / iy,
        r + dt_s * (tz - pm * qm * (iy - ix)) / iz,
    )


def _turn(quat: Quat, rates: Vec3, dt_s: float) -> Quat:
    """Attitude after turning at body rates for a step, second order in the angle, normalised."""
    w, x, y, z = quat
    half = 0.5 * dt_s
    a, b, c = rates[0] * half, rates[1] * half, rates[2] * half
    s = 1.0 - 0.5 * (a * a + b * b + c * c)
    nw = w * s - x * a - y * b - z * c
    nx = x * s + w * a + y * c - z * b
    ny = y * s + w * b + z * a - x * c
    nz = z * s + w * c + x * b - y * a
    scale = 1.0 / math.sqrt(nw * nw + nx * nx + ny * ny + nz * nz)
    return nw * scale, nx * scale, ny * scale, nz * scale


def _touch(before: PlantState, moved: PlantState, dt_s: float) -> PlantState:
    """State of a body that would sink into the ground: it stops there, slides with friction, and is levelled."""
    vn, ve, _ = moved.ned_v_m_s
    speed = math.hypot(vn, ve)
    keep = max(0.0, 1.0 - _FRICTION_M_S2 * dt_s / speed) if speed > 1e-9 else 0.0
    velocity = (vn * keep, ve * keep, 0.0)
    bn, be, bd = before.ned_v_m_s
    acceleration = ((velocity[0] - bn) / dt_s, (velocity[1] - be) / dt_s, -bd / dt_s)
    pn, pe, _ = before.ned_p_m
    position = (pn + velocity[0] * dt_s, pe + velocity[1] * dt_s, 0.0)
    w, x, y, z = moved.ned_q_body
    level = max(0.0, 1.0 - dt_s / _LEVELLING_TIME_S)
    x, y = x * level, y * level
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    quat = (w / norm, x / norm, y / norm, z / norm) if norm > 1e-6 else (1.0, 0.0, 0.0, 0.0)
    return PlantState(position, velocity, quat, _REST, moved.rotors_rad_s, acceleration, True)
