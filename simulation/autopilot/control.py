"""Cascaded flight control: position → velocity → acceleration → attitude → body rate → rotors.

The structure is PX4's. The gains are fitted, by the largest relative deviation, to the step responses that PX4 showed
in the loop with its built-in quadrotor, at both drags; `tests/unit/test_autopilot_control.py` holds the figures. The
fit counts 0.057 s from the arrival of a setpoint until it acts (`setpoint_delay_s` of the configuration): without it no
gains match the slow beginning of PX4's climb and roll steps together with their fast middle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from simulation.autopilot.motion import FREE, NAN, AttitudeSetpoint, Estimate, MotionSetpoint, heading
from simulation.autopilot.plant import GRAVITY_M_S2, Airframe, Rotors, Vec3, down_axis, mix

HOVER_THRUST = 0.495
"""Thrust setpoint at which PX4's built-in quadrotor hovers (the motors' balance alone would make it 0.490)."""
_CLIMB_MAX_M_S2 = 8.0  # the rotors give 2 g in all; the rest is left to steer
_SINK_MAX_M_S2 = 6.0  # keeps a third of the hover thrust: attitude control needs it


@dataclass(frozen=True)
class Limits:
    """Bounds that the controller keeps; the defaults are PX4's."""

    speed_m_s: float = 12.0
    """Fastest horizontal velocity (MPC_XY_VEL_MAX), m/s."""
    climb_m_s: float = 3.0
    """Fastest climb (MPC_Z_VEL_MAX_UP), m/s."""
    sink_m_s: float = 1.5
    """Fastest descent (MPC_Z_VEL_MAX_DN), m/s."""
    tilt_rad: float = math.radians(45.0)
    """Largest tilt (MPC_TILTMAX_AIR), rad."""


@dataclass(frozen=True)
class Gains:
    """Gains of the cascade, tuned on PX4's step responses (see the module's text)."""

    position: float = 0.95
    """Horizontal position error to velocity, 1/s (MPC_XY_P)."""
    height: float = 1.0
    """Vertical position error to velocity, 1/s (MPC_Z_P)."""
    velocity_p: float = 1.957
    """Horizontal velocity error to acceleration, 1/s."""
    velocity_i: float = 0.4115
    """Integral of the horizontal velocity error to acceleration, 1/s²."""
    velocity_d: float = 0.328
    """Damping by the measured horizontal acceleration."""
    climb_p: float = 3.46
    """Vertical velocity error to acceleration, 1/s."""
    climb_i: float = 11.16
    """Integral of the vertical velocity error to acceleration, 1/s²."""
    derivative_lag_s: float = 1.0 / (2.0 * math.pi * 5.0)
    """Time constant of the low-pass on the measured acceleration, s (MPC_VELD_LP)."""
    tilt: float = 4.07
    """Tilt error to body rate, 1/s."""
    heading: float = 2.1
    """Heading error to heading rate, 1/s."""
    heading_rate_max_rad_s: float = math.radians(200.0)
    """Fastest heading rate (MC_YAWRATE_MAX), rad/s."""
    rate: float = 14.0
    """Roll and pitch rate error to angular acceleration, 1/s."""
    yaw_rate: float = 2.87
    """Yaw rate error to angular acceleration, 1/s."""
    yaw_lag_s: float = 0.08
    """Time constant of the low-pass on the yaw torque (MC_YAW_TQ_CUTOFF of 2 Hz), s."""


class Controller:
    """The cascade with its integrators, for one airframe.

    Args:
        airframe: mass, inertia and mixing.
        limits: bounds to keep.
        gains: of the loops.
    """

    def __init__(self, airframe: Airframe, limits: Limits = Limits(), gains: Gains = Gains()):
        self._airframe, self._gains = airframe, gains
        self.limits = limits
        """Bounds in force."""
        self.climb_share = 1.0
        """Part of the climb limit that may be used: grows from 0 to 1 while the vehicle lifts off."""
        self.thrust_max_n = airframe.mass_kg * GRAVITY_M_S2 / HOVER_THRUST
        """Thrust at a setpoint of 1, N."""
        self.reset()

    def reset(self) -> None:
        """Forget integrals, filters and the held heading: to be called on the ground."""
        self._integral = [0.0, 0.0, 0.0]
        self._acceleration = [0.0, 0.0]
        self._last_v: Vec3 | None = None
        self._yaw_torque = 0.0
        self._held_yaw = NAN
        self.target_a_m_s2: Vec3 = (0.0, 0.0, 0.0)
        self.target_v_m_s: Vec3 = FREE
        self.target_down: Vec3 = (0.0, 0.0, 1.0)
        self.target_yaw_rad = 0.0
        self.target_rates_rad_s: Vec3 = (0.0, 0.0, 0.0)
        self.thrust_fraction = 0.0

    def update(self, estimate: Estimate, setpoint: MotionSetpoint, dt_s: float) -> Rotors:
        """Rotor speed commands for this cycle, rad/s.

        Args:
            estimate: the motion now.
            setpoint: what is asked; an axis without position, velocity and acceleration asks for no acceleration.
            dt_s: time since the last cycle, s.
        """
        self.target_v_m_s = self._velocity_target(estimate, setpoint)
        self.target_a_m_s2 = self._acceleration_target(estimate, setpoint, dt_s)
        an, ae, ad = self.target_a_m_s2
        lift = GRAVITY_M_S2 - ad
        size = math.sqrt(an * an + ae * ae + lift * lift)
        ned_down = (-an / size, -ae / size, lift / size)
        return self.point(estimate, ned_down, self._heading_rate(estimate, setpoint), size, dt_s)

    def steer(self, estimate: Estimate, setpoint: AttitudeSetpoint, dt_s: float) -> Rotors:
        """Rotor speeds for an attitude or body rates with direct thrust, rad/s.

        Args:
            estimate: the motion now.
            setpoint: what is asked; there is no bound on its tilt, as in PX4.
            dt_s: time since the last cycle, s.
        """
        gains = self._gains
        self._integral = [0.0, 0.0, 0.0]  # a motion setpoint that follows starts afresh
        self._last_v = None
        self._held_yaw = NAN
        thrust_n = min(max(setpoint.thrust, 0.0), 1.0) * self.thrust_max_n
        if setpoint.ned_q_body is None:
            p, q, r = (
                asked if asked == asked else now
                for asked, now in zip(setpoint.body_rates_rad_s, estimate.body_rates_rad_s, strict=True)
            )
            return self._drive(estimate, (p, q, r), thrust_n, dt_s)
        ahead = setpoint.body_rates_rad_s[2]
        self.target_yaw_rad = heading(setpoint.ned_q_body)
        error = math.remainder(self.target_yaw_rad - heading(estimate.ned_q_body), math.tau)
        yaw_rate = gains.heading * error + (ahead if ahead == ahead else 0.0)
        yaw_rate = min(max(yaw_rate, -gains.heading_rate_max_rad_s), gains.heading_rate_max_rad_s)
        self.target_down = down_axis(setpoint.ned_q_body)
        rates, _ = self._tilt_rates(estimate, yaw_rate)
        return self._drive(estimate, rates, thrust_n, dt_s)

    def point(self, estimate: Estimate, ned_down: Vec3, yaw_rate_rad_s: float, lift_m_s2: float, dt_s: float) -> Rotors:
        """Rotor speeds that turn the body's z axis to a direction, rad/s: the inner loops alone.

        Args:
            estimate: the motion now.
            ned_down: wanted body z axis, NED, unit vector.
            yaw_rate_rad_s: wanted heading rate, rad/s.
            lift_m_s2: wanted thrust along that axis by mass, m/s²; only its part along the present axis is given.
            dt_s: time since the last cycle, s.
        """
        self.target_down = ned_down
        rates, along = self._tilt_rates(estimate, yaw_rate_rad_s)
        return self._drive(estimate, rates, self._airframe.mass_kg * lift_m_s2 * max(along, 0.2), dt_s)

    def _tilt_rates(self, estimate: Estimate, yaw_rate_rad_s: float) -> tuple[Vec3, float]:
        """Body rates that turn the z axis to `target_down`, rad/s, and the cosine of the angle between the two."""
        w, x, y, z = estimate.ned_q_body
        dn, de, dd = self.target_down
        # wanted axis in the body: R^T d
        bx = (1 - 2 * (y * y + z * z)) * dn + 2 * (x * y + w * z) * de + 2 * (x * z - w * y) * dd
        by = 2 * (x * y - w * z) * dn + (1 - 2 * (x * x + z * z)) * de + 2 * (y * z + w * x) * dd
        bz = 2 * (x * z + w * y) * dn + 2 * (y * z - w * x) * de + (1 - 2 * (x * x + y * y)) * dd
        sine = math.hypot(bx, by)
        gain = self._gains.tilt * (math.atan2(sine, bz) / sine if sine > 1e-9 else 1.0)
        p = -by * gain + yaw_rate_rad_s * 2 * (x * z - w * y)
        q = bx * gain + yaw_rate_rad_s * 2 * (y * z + w * x)
        return (p, q, yaw_rate_rad_s * (1 - 2 * (x * x + y * y))), bz

    def _drive(self, estimate: Estimate, rates: Vec3, thrust_n: float, dt_s: float) -> Rotors:
        """Rotor speeds that give body rates and a thrust, rad/s."""
        gains = self._gains
        self.target_rates_rad_s = p, q, r = rates
        wp, wq, wr = estimate.body_rates_rad_s
        ix, iy, iz = self._airframe.inertia_kg_m2
        self._yaw_torque += (iz * gains.yaw_rate * (r - wr) - self._yaw_torque) * min(1.0, dt_s / gains.yaw_lag_s)
        torque = (ix * gains.rate * (p - wp), iy * gains.rate * (q - wq), self._yaw_torque)
        self.thrust_fraction = min(max(thrust_n / self.thrust_max_n, 0.0), 1.0)
        return mix(self._airframe, thrust_n, torque)

    def _velocity_target(self, estimate: Estimate, setpoint: MotionSetpoint) -> Vec3:
        """Velocity to reach, NED, m/s; NaN on axes that are steered by acceleration."""
        limits, gains = self.limits, self._gains
        vn, ve, vd = setpoint.ned_v_m_s
        pn, pe, pd = setpoint.ned_p_m
        hn, he, hd = estimate.ned_p_m
        if pn == pn:  # a number: NaN differs from itself
            vn = (vn if vn == vn else 0.0) + gains.position * (pn - hn)
        if pe == pe:
            ve = (ve if ve == ve else 0.0) + gains.position * (pe - he)
        if pd == pd:
            vd = (vd if vd == vd else 0.0) + gains.height * (pd - hd)
        speed = math.hypot(vn, ve)
        if speed > limits.speed_m_s:
            vn, ve = vn * limits.speed_m_s / speed, ve * limits.speed_m_s / speed
        return vn, ve, min(max(vd, -limits.climb_m_s * self.climb_share), limits.sink_m_s) if vd == vd else NAN

    def _acceleration_target(self, estimate: Estimate, setpoint: MotionSetpoint, dt_s: float) -> Vec3:
        """Acceleration to command, NED, m/s²: velocity loop, the setpoint's own acceleration, tilt limit."""
        gains, integral = self._gains, self._integral
        v = estimate.ned_v_m_s
        last = self._last_v or v
        self._last_v = v
        share = dt_s / (dt_s + gains.derivative_lag_s)
        target: list[float] = []
        errors = [0.0, 0.0]
        for axis in (0, 1):
            measured = self._acceleration[axis]
            self._acceleration[axis] = measured + ((v[axis] - last[axis]) / dt_s - measured) * share
            wanted, forward = self.target_v_m_s[axis], setpoint.ned_a_m_s2[axis]
            value = forward if forward == forward else 0.0
            if wanted == wanted:
                errors[axis] = wanted - v[axis]
                value += gains.velocity_p * errors[axis] + integral[axis] - gains.velocity_d * self._acceleration[axis]
            else:
                integral[axis] = 0.0
            target.append(value)
        down = self._vertical_target(v[2], setpoint.ned_a_m_s2[2], dt_s)
        most = math.tan(self.limits.tilt_rad) * max(GRAVITY_M_S2 - down, 1.0)
        size = math.hypot(target[0], target[1])
        if size > most:
            return target[0] * most / size, target[1] * most / size, down
        for axis in (0, 1):  # integrate only while the tilt limit leaves room: no wind-up
            integral[axis] += gains.velocity_i * errors[axis] * dt_s
        return target[0], target[1], down

    def _vertical_target(self, vd: float, forward: float, dt_s: float) -> float:
        """Vertical acceleration to command, positive downwards, m/s²."""
        gains = self._gains
        value = forward if forward == forward else 0.0
        wanted = self.target_v_m_s[2]
        if wanted == wanted:
            error = wanted - vd
            value += gains.climb_p * error + self._integral[2]
            if -_CLIMB_MAX_M_S2 < value < _SINK_MAX_M_S2:
                self._integral[2] += gains.climb_i * error * dt_s
        else:
            self._integral[2] = 0.0
        return min(max(value, -_CLIMB_MAX_M_S2), _SINK_MAX_M_S2)

    def _heading_rate(self, estimate: Estimate, setpoint: MotionSetpoint) -> float:
        """Heading rate to command, clockwise, rad/s."""
        gains = self._gains
        yaw = heading(estimate.ned_q_body)
        wanted, rate = setpoint.yaw_rad, setpoint.yaw_rate_rad_s
        if wanted != wanted and rate != rate:
            if self._held_yaw != self._held_yaw:
                self._held_yaw = yaw
            wanted = self._held_yaw
        else:
            self._held_yaw = NAN
        self.target_yaw_rad = wanted if wanted == wanted else yaw
        total = rate if rate == rate else 0.0
        if wanted == wanted:
            total += gains.heading * math.remainder(wanted - yaw, math.tau)
        return min(max(total, -gains.heading_rate_max_rad_s), gains.heading_rate_max_rad_s)
