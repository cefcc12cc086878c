"""Where the autopilot flies by itself: hold, takeoff, landing and return as motion setpoints."""

from __future__ import annotations

import math

from simulation.autopilot.modes import Mode
from simulation.autopilot.motion import FREE, NAN, Estimate, MotionSetpoint, heading
from simulation.autopilot.parameters import Parameters
from simulation.autopilot.plant import Vec3

_BRAKED_M_S = 0.3  # slower than this, a hold fixes its place
_BRAKED_CLIMB_M_S = 0.2
_CLIMB_ACCELERATION_M_S2 = 4.0
_TAKEOFF_ACCEPTED_M = 0.3
_HOME_ACCEPTED_M = 1.0
_HEIGHT_ACCEPTED_M = 0.5
_POSITION_GAIN = 0.95  # 1/s, MPC_XY_P; also vertically, where PX4 has 1.0


class Guidance:
    """Setpoints of the automatic modes, with the state that they need between two cycles.

    Args:
        parameters: speeds and heights (MPC_*, RTL_*, MIS_*), read at each use.
    """

    def __init__(self, parameters: Parameters):
        self._parameters = parameters
        self._goal: Vec3 = FREE
        self._velocity: Vec3 = (0.0, 0.0, 0.0)
        self._yaw = 0.0
        self._phase = ""
        self.takeoff_height_m = 0.0
        """Height that the takeoff climbs to, above home, m."""

    def enter(self, mode: Mode, estimate: Estimate, after: Mode) -> None:
        """Begin a mode.

        Args:
            mode: the mode.
            estimate: the motion now.
            after: the mode before; a hold that ends a takeoff keeps the takeoff's goal.
        """
        n, e, d = estimate.ned_p_m
        if mode is Mode.HOLD and after is Mode.TAKEOFF:
            return
        self._velocity = estimate.ned_v_m_s
        self._yaw = heading(estimate.ned_q_body)
        self._goal = FREE
        if mode is Mode.TAKEOFF:
            self.takeoff_height_m = max(self.takeoff_height_m, -d)
            self._goal = (n, e, -self.takeoff_height_m)
        elif mode is Mode.RETURN:
            self._phase = "climb"
            self._goal = (NAN, NAN, -self._return_height(math.hypot(n, e), -d))

    def takeoff_done(self, estimate: Estimate) -> bool:
        """Whether the takeoff height is reached within 0.3 m."""
        return -estimate.ned_p_m[2] > self.takeoff_height_m - _TAKEOFF_ACCEPTED_M

    def setpoint(self, mode: Mode, estimate: Estimate, dt_s: float) -> MotionSetpoint:
        """Setpoint of an automatic mode for this cycle."""
        p = self._parameters
        if mode is Mode.TAKEOFF:
            return self._fly(estimate, p["MPC_TKO_SPEED"], p["MPC_Z_V_AUTO_DN"], dt_s)
        if mode is Mode.LAND:
            return self._land(estimate, dt_s)
        if mode is Mode.DESCEND:  # blind: level, so that the wind carries it, and down
            return MotionSetpoint(
                ned_v_m_s=(NAN, NAN, p["MPC_LAND_SPEED"]), ned_a_m_s2=(0.0, 0.0, NAN), yaw_rad=self._yaw
            )
        if mode is Mode.RETURN:
            return self._return(estimate, dt_s)
        return self._fly(estimate, p["MPC_Z_V_AUTO_UP"], p["MPC_Z_V_AUTO_DN"], dt_s)

    def _return_height(self, distance_m: float, height_m: float) -> float:
        """Height of the way home, above home, m: lower inside the cone over home (RTL_CONE_ANG), never below now."""
        p = self._parameters
        wanted = float(p["RTL_RETURN_ALT"])
        descend = float(p["RTL_DESCEND_ALT"])
        if distance_m <= p["RTL_MIN_DIST"]:
            wanted = min(wanted, descend)
        elif 0 < p["RTL_CONE_ANG"] < 90:
            wanted = min(wanted, max(distance_m / math.tan(math.radians(p["RTL_CONE_ANG"])), descend))
        return max(wanted, height_m)

    def _return(self, estimate: Estimate, dt_s: float) -> MotionSetpoint:
        p = self._parameters
        n, e, d = estimate.ned_p_m
        if self._phase == "climb" and abs(d - self._goal[2]) < _HEIGHT_ACCEPTED_M:
            self._phase, self._goal = "cruise", (0.0, 0.0, self._goal[2])
        if self._phase == "cruise" and math.hypot(n, e) < _HOME_ACCEPTED_M:
            self._phase, self._goal = "descend", (0.0, 0.0, max(-float(p["RTL_DESCEND_ALT"]), self._goal[2]))
        if self._phase == "descend" and abs(d - self._goal[2]) < _HEIGHT_ACCEPTED_M:
            self._phase = "land"
        if self._phase == "land":
            return self._land(estimate, dt_s)
        return self._fly(estimate, p["MPC_Z_V_AUTO_UP"], p["MPC_Z_V_AUTO_DN"], dt_s)

    def _land(self, estimate: Estimate, dt_s: float) -> MotionSetpoint:
        """Descent at the automatic speed above MPC_LAND_ALT1, at the landing speed below MPC_LAND_ALT2."""
        p = self._parameters
        high, low = p["MPC_LAND_ALT1"], p["MPC_LAND_ALT2"]
        share = min(max((-estimate.ned_p_m[2] - low) / max(high - low, 0.1), 0.0), 1.0)
        sink = p["MPC_LAND_SPEED"] + share * (p["MPC_Z_V_AUTO_DN"] - p["MPC_LAND_SPEED"])
        self._goal = (self._goal[0], self._goal[1], math.inf)
        return self._fly(estimate, p["MPC_Z_V_AUTO_UP"], sink, dt_s)

    def _fly(self, estimate: Estimate, climb: float, sink: float, dt_s: float) -> MotionSetpoint:
        """Velocity towards the goal, its change limited; axes without a goal brake, then hold where they stopped."""
        p = self._parameters
        v, here = estimate.ned_v_m_s, estimate.ned_p_m
        gn, ge, gd = self._goal
        if gn != gn and math.hypot(v[0], v[1]) < _BRAKED_M_S:
            gn, ge = here[0], here[1]
        if gd != gd and abs(v[2]) < _BRAKED_CLIMB_M_S:
            gd = here[2]
        self._goal = (gn, ge, gd)
        vn = _POSITION_GAIN * (gn - here[0]) if gn == gn else 0.0
        ve = _POSITION_GAIN * (ge - here[1]) if ge == ge else 0.0
        speed = math.hypot(vn, ve)
        if speed > p["MPC_XY_CRUISE"]:
            vn, ve = vn * p["MPC_XY_CRUISE"] / speed, ve * p["MPC_XY_CRUISE"] / speed
        vd = min(max(_POSITION_GAIN * (gd - here[2]), -climb), sink) if gd == gd else 0.0
        was = self._velocity
        dn, de = vn - was[0], ve - was[1]
        change, most = math.hypot(dn, de), p["MPC_ACC_HOR"] * dt_s
        if change > most:
            dn, de = dn * most / change, de * most / change
        most = _CLIMB_ACCELERATION_M_S2 * dt_s
        self._velocity = (was[0] + dn, was[1] + de, was[2] + min(max(vd - was[2], -most), most))
        return MotionSetpoint(ned_v_m_s=self._velocity, yaw_rad=self._yaw)
