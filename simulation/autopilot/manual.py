"""How a pilot's sticks fly: the setpoints of the Manual, Stabilized, Acro, Altitude and Position modes."""

from __future__ import annotations

import math

from simulation.autopilot.flight_modes import Mode
from simulation.autopilot.motion import NAN, AttitudeSetpoint, Estimate, MotionSetpoint, Setpoint, heading
from simulation.autopilot.parameters import Parameters
from simulation.autopilot.plant import GRAVITY_M_S2, Quat
from simulation.autopilot.sticks import Sticks

_CLIMB_ACCELERATION_M_S2 = 4.0
_BRAKED_M_S = 0.3
_BRAKED_CLIMB_M_S = 0.2


class ManualFlight:
    """Setpoints from sticks, with the state that they need between two cycles.

    Args:
        parameters: MPC_* and MC_ACRO_*, read at each use.
    """

    def __init__(self, parameters: Parameters):
        self._parameters = parameters
        self._yaw = 0.0
        self._velocity = (0.0, 0.0, 0.0)
        self._place = (NAN, NAN)
        self._down = NAN

    def enter(self, estimate: Estimate) -> None:
        """Begin a mode: from the motion of this moment."""
        self._yaw = heading(estimate.ned_q_body)
        self._velocity = estimate.ned_v_m_s
        self._place, self._down = (NAN, NAN), NAN

    def setpoint(self, mode: Mode, sticks: Sticks, estimate: Estimate, dt_s: float) -> Setpoint:
        """Setpoint of a manual mode for this cycle."""
        p = self._parameters
        if mode is Mode.ACRO:
            rates = (
                math.radians(p["MC_ACRO_R_MAX"]) * sticks.roll,
                -math.radians(p["MC_ACRO_P_MAX"]) * sticks.pitch,
                math.radians(p["MC_ACRO_Y_MAX"]) * sticks.yaw,
            )
            return AttitudeSetpoint(None, rates, self._thrust(sticks.throttle))
        yaw_rate = math.radians(p["MPC_MAN_Y_MAX"]) * self._shaped(sticks.yaw)
        self._yaw = math.remainder(self._yaw + yaw_rate * dt_s, math.tau)
        if mode in (Mode.MANUAL, Mode.STABILIZED):
            roll, pitch = self._tilts(sticks)
            quat = _quaternion(roll, pitch, self._yaw)
            return AttitudeSetpoint(quat, (NAN, NAN, yaw_rate), self._thrust(sticks.throttle))
        down, sink = self._vertical(sticks, estimate, dt_s)
        if mode is Mode.ALTITUDE:
            roll, pitch = self._tilts(sticks)
            ahead, right = GRAVITY_M_S2 * math.tan(-pitch), GRAVITY_M_S2 * math.tan(roll)
            north, east = self._turned(ahead, right)
            return MotionSetpoint(
                (NAN, NAN, down), (NAN, NAN, sink), (north, east, NAN), yaw_rad=self._yaw, yaw_rate_rad_s=yaw_rate
            )
        north, east = self._horizontal(sticks, estimate, dt_s)
        return MotionSetpoint((*self._place, down), (north, east, sink), yaw_rad=self._yaw, yaw_rate_rad_s=yaw_rate)

    def _shaped(self, stick: float) -> float:
        """A stick without its dead zone (MPC_HOLD_DZ), softer around the middle (MPC_XY_MAN_EXPO)."""
        dead, soft = float(self._parameters["MPC_HOLD_DZ"]), float(self._parameters["MPC_XY_MAN_EXPO"])
        beyond = max(abs(stick) - dead, 0.0) / max(1.0 - dead, 1e-3)
        return math.copysign((1.0 - soft) * beyond + soft * beyond**3, stick)

    def _tilts(self, sticks: Sticks) -> tuple[float, float]:
        """Roll and pitch, rad: at most MPC_MAN_TILT_MAX together."""
        most = math.radians(self._parameters["MPC_MAN_TILT_MAX"])
        roll, pitch = sticks.roll, -sticks.pitch
        size = math.hypot(roll, pitch)
        scale = most / max(size, 1.0)
        return roll * scale, pitch * scale

    def _thrust(self, throttle: float) -> float:
        """Thrust of a throttle, 0 to 1: its middle hovers (MPC_THR_CURVE 0), its lower end is MPC_MANTHR_MIN."""
        low, hover = float(self._parameters["MPC_MANTHR_MIN"]), float(self._parameters["MPC_THR_HOVER"])
        if throttle < 0.0:
            return hover + throttle * (hover - low)
        return hover + throttle * (1.0 - hover)

    def _vertical(self, sticks: Sticks, estimate: Estimate, dt_s: float) -> tuple[float, float]:
        """Height to hold and vertical velocity, positive down; one of them is NaN."""
        p = self._parameters
        stick = self._shaped(sticks.throttle)
        wanted = -stick * float(p["MPC_Z_VEL_MAX_UP"] if stick > 0.0 else p["MPC_Z_VEL_MAX_DN"])
        vn, ve, vd = self._velocity
        most = _CLIMB_ACCELERATION_M_S2 * dt_s
        vd += min(max(wanted - vd, -most), most)
        self._velocity = (vn, ve, vd)
        if wanted != 0.0:
            self._down = NAN
        elif self._down != self._down and abs(estimate.ned_v_m_s[2]) < _BRAKED_CLIMB_M_S and abs(vd) < 1e-3:
            self._down = estimate.ned_p_m[2]
        return (self._down, NAN) if self._down == self._down else (NAN, vd)

    def _horizontal(self, sticks: Sticks, estimate: Estimate, dt_s: float) -> tuple[float, float]:
        """Horizontal velocity, NED, m/s; where the sticks rest it brakes, then the place is held."""
        p = self._parameters
        ahead, right = self._shaped(sticks.pitch), self._shaped(sticks.roll)
        scale = float(p["MPC_VEL_MANUAL"]) / max(math.hypot(ahead, right), 1.0)
        north, east = self._turned(ahead * scale, right * scale)
        vn, ve, vd = self._velocity
        dn, de = north - vn, east - ve
        change, most = math.hypot(dn, de), float(p["MPC_ACC_HOR"]) * dt_s
        if change > most:
            dn, de = dn * most / change, de * most / change
        self._velocity = (vn + dn, ve + de, vd)
        if ahead or right:
            self._place = (NAN, NAN)
        elif self._place[0] != self._place[0] and math.hypot(*estimate.ned_v_m_s[:2]) < _BRAKED_M_S:
            self._place = (estimate.ned_p_m[0], estimate.ned_p_m[1])
        return self._velocity[0], self._velocity[1]

    def _turned(self, ahead: float, right: float) -> tuple[float, float]:
        """North and east parts of a vector of the heading frame."""
        c, s = math.cos(self._yaw), math.sin(self._yaw)
        return ahead * c - right * s, ahead * s + right * c


def _quaternion(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Quat:
    """Attitude of Euler angles, yaw first."""
    cr, sr = math.cos(0.5 * roll_rad), math.sin(0.5 * roll_rad)
    cp, sp = math.cos(0.5 * pitch_rad), math.sin(0.5 * pitch_rad)
    cy, sy = math.cos(0.5 * yaw_rad), math.sin(0.5 * yaw_rad)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )
