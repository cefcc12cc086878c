"""What the autopilot believes of its motion: the truth with coloured errors, and what failing sensors add to them.

It is no filter: it is a model of the errors that PX4's EKF2 shows. Without GNSS the velocity error grows with time and
the position error with its square; after `EKF2_NOAID_TOUT` the horizontal position is no longer valid. A receiver that
is stuck is rejected by the filter, which comes to the same; a wrong one is believed, and its error drags the estimate
along. Without a magnetometer the heading drifts; a wrong one turns it by a fixed angle.
"""

from __future__ import annotations

import math
import random
from enum import Enum

from simulation.autopilot.config import AutopilotSimConfig
from simulation.autopilot.motion import Estimate
from simulation.autopilot.noise import GaussMarkov
from simulation.autopilot.plant import PlantState, Quat, Vec3

_HEADING_TIME_S = 2.0  # how fast the filter follows a wrong magnetometer, and returns to a right one


class Sensor(Enum):
    """Sensors that can fail; the value is the FAILURE_UNIT of MAV_CMD_INJECT_FAILURE."""

    MAG = 2
    BARO = 3
    GPS = 4


class Fault(Enum):
    """How a sensor fails; the value is the FAILURE_TYPE of MAV_CMD_INJECT_FAILURE."""

    NONE = 0
    OFF = 1
    STUCK = 2
    WRONG = 4


class Estimator:
    """Estimate of the motion; deterministic for a seed and a sequence of calls.

    Args:
        config: noise, failures and their sizes.
        dt_s: time between calls of `drift`, s.
        no_aid_s: how long the position stays valid without GNSS, s.
    """

    def __init__(self, config: AutopilotSimConfig, dt_s: float, no_aid_s: float):
        self._config, self._dt_s, self._no_aid_s = config, dt_s, no_aid_s
        self.ned_origin_m: Vec3 = (0.0, 0.0, 0.0)
        """Where the local frame begins, in the world's frame, m: the place at which the autopilot was started."""
        self.faults = dict.fromkeys(Sensor, Fault.NONE)
        """How each sensor fails."""
        self._blind_s = 0.0
        self._p_error = [0.0, 0.0, 0.0]
        self._v_error = [0.0, 0.0]
        self._heading_error = 0.0
        luck = random.Random(f"{config.seed}/faults")
        course = luck.uniform(-math.pi, math.pi)
        self._course = (math.cos(course), math.sin(course))
        self._turn = luck.choice((-1.0, 1.0))

        def process(name: str, std: float, time_s: float) -> GaussMarkov:
            return GaussMarkov(std, time_s, dt_s, random.Random(f"{config.seed}/{name}"))

        time_s = config.noise_time_s
        self._p_noise = [process(f"position{i}", config.position_noise_m, time_s) for i in range(3)]
        self._v_noise = [process(f"velocity{i}", config.velocity_noise_m_s, time_s) for i in range(2)]
        self._v_noise.append(process("climb", config.climb_noise_m_s, config.climb_noise_time_s))
        self._q_noise = [process(f"attitude{i}", config.attitude_noise_rad, time_s) for i in range(3)]
        self._rotation: Quat = (1.0, 0.0, 0.0, 0.0)
        self.drift()

    @property
    def position_valid(self) -> bool:
        """Whether the horizontal position and velocity may be used."""
        return self._blind_s <= self._no_aid_s

    @property
    def height_valid(self) -> bool:
        """Whether the height may be used: it needs the barometer or GNSS."""
        return self.faults[Sensor.BARO] is not Fault.OFF or self.position_valid

    def drift(self) -> None:
        """Let noise and the errors of failed sensors move on by `dt_s`."""
        for process in (*self._p_noise, *self._v_noise, *self._q_noise):
            process.update()
        self._drift_position()
        self._drift_heading()
        self._drift_height()
        a, b, c = (0.5 * process.value for process in self._q_noise)
        self._rotation = (1.0, a, b, c)  # a small rotation: its norm needs no repair

    def estimate(self, truth: PlantState, landed: bool) -> Estimate:
        """The motion as the autopilot sees it now.

        Args:
            truth: the motion.
            landed: the vehicle stands on the ground and knows it.
        """
        vn, ve, vd = truth.ned_v_m_s
        v, dv = self._v_noise, self._v_error
        if not landed:
            vn, ve, vd = vn + v[0].value + dv[0], ve + v[1].value + dv[1], vd + v[2].value
        w, x, y, z = truth.ned_q_body
        _, a, b, c = self._rotation
        quat = (
            w - x * a - y * b - z * c,
            x + w * a + y * c - z * b,
            y + w * b + z * a - x * c,
            z + w * c + x * b - y * a,
        )
        if self._heading_error:
            quat = _turned(quat, self._heading_error)
        pn, pe, pd = truth.ned_p_m
        on, oe, od = self.ned_origin_m
        p, dp = self._p_noise, self._p_error
        position = (pn - on + p[0].value + dp[0], pe - oe + p[1].value + dp[1], pd - od + p[2].value + dp[2])
        return Estimate(position, (vn, ve, vd), quat, truth.body_rates_rad_s)

    def _drift_position(self) -> None:
        fault, dt_s = self.faults[Sensor.GPS], self._dt_s
        p, v, course = self._p_error, self._v_error, self._course
        if fault is Fault.NONE:
            self._blind_s = 0.0
            p[0] = p[1] = v[0] = v[1] = 0.0  # the filter resets to the receiver
        elif fault is Fault.WRONG:
            self._blind_s = 0.0
            for axis in (0, 1):  # believed: position and velocity of the receiver walk away together
                v[axis] = course[axis] * self._config.wrong_gps_m_s
                p[axis] += v[axis] * dt_s
        else:
            self._blind_s += dt_s
            for axis in (0, 1):
                v[axis] += course[axis] * self._config.dead_reckoning_m_s2 * dt_s
                p[axis] += v[axis] * dt_s

    def _drift_heading(self) -> None:
        fault, config = self.faults[Sensor.MAG], self._config
        if fault in (Fault.OFF, Fault.STUCK):
            self._heading_error += self._turn * config.heading_drift_rad_s * self._dt_s
            return
        goal = self._turn * config.wrong_mag_rad if fault is Fault.WRONG else 0.0
        self._heading_error += (goal - self._heading_error) * min(self._dt_s / _HEADING_TIME_S, 1.0)
        if abs(self._heading_error) < 1e-6:
            self._heading_error = 0.0

    def _drift_height(self) -> None:
        if self.faults[Sensor.BARO] is Fault.WRONG:
            self._p_error[2] += self._config.wrong_baro_m_s * self._dt_s
        elif self.faults[Sensor.BARO] is Fault.NONE:
            self._p_error[2] = 0.0


def _turned(quat: Quat, yaw_rad: float) -> Quat:
    """An attitude turned clockwise about the vertical."""
    w, x, y, z = quat
    c, s = math.cos(0.5 * yaw_rad), math.sin(0.5 * yaw_rad)
    return c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w
