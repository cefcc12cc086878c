"""Where down and north are: the autopilot's attitude with its errors taken out by gyroscopes and accelerometers.

The error of an attitude estimate wanders; the gyroscopes say how the attitude really changed meanwhile. So the attitude
is carried on by the body rates alone and drawn to the estimate slowly: a Kalman filter whose axes share one covariance
of attitude error and gyroscope bias (Mahony, Hamel, Pflimlin 2008, DOI 10.1109/TAC.2008.923738, with the gains of a
Kalman filter instead of fixed ones). The estimate's error is correlated over `time_s`; a filter that is much slower
than that may take it as white noise of the same density.

An error that stays for many seconds is told by what a tilt does: one degree is 0.17 m/s². So where the accelerometers
are told, a velocity is carried on by the specific force, turned into the level frame, and compared with the
autopilot's. The errors, in the body's axes:

    φ' = −b        φ: tilt; b: the gyroscopes' bias
    w' = φ − α     w: velocity, a quarter turn on and over g; α: the accelerometers' bias, as w

Roll and pitch are the parts of one complex number: a body that turns turns φ and w against the biases, by a factor.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.geometry.rotation import quat_conjugate, quat_exp, quat_multiply, quat_rotate

Array = NDArray[np.float64]

_LONGEST_STEP_S = 0.15
_REFUSED_S = 0.4  # an estimate that stays away for so long has jumped: the filter begins anew from it
_GYRO_RAD_RTS = 3e-4  # random walk of the integrated rates, rad per root second
_BIAS_RAD_S, _BIAS_WALK = 5e-4, 1e-5  # what an autopilot leaves of a gyroscope's bias; its walk, per root second
_FORCE_RTS, _FORCE_BIAS = 1e-3, 3e-3  # the same of the accelerometers, over g: walk, s per root second, and bias
_GRAVITY_M_S2 = 9.80665
_DOWN = np.array([0.0, 0.0, 1.0])
_QUARTER_TURN = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
_TILT, _BIAS, _SHORT, _FORCE = range(4)
_LEVEL, _HEADING = 0, 1


class Horizon:
    """Attitude by gyroscopes, accelerometers and the autopilot's estimate together.

    Args:
        error_rad: standard deviation of the estimate's error, per axis, rad; 0 takes the estimate as it is.
        time_s: its correlation time, s.
        velocity_m_s: standard deviation of the velocity estimate's error, per axis, m/s.
        velocity_time_s: its correlation time, s.
    """

    def __init__(self, error_rad: float, time_s: float, velocity_m_s: float = 0.03, velocity_time_s: float = 1.0):
        self._error_rad = error_rad
        self._short_s = velocity_m_s / _GRAVITY_M_S2
        self._densities = {_TILT: 2.0 * error_rad**2 * time_s, _SHORT: 2.0 * self._short_s**2 * velocity_time_s}
        self._quat: Array | None = None
        self._bias, self._force_bias = np.zeros(3), np.zeros(3)
        self._covariance = np.zeros(
            (2, 4, 4), complex
        )  # of roll + i pitch, and of the heading, which no velocity tells
        self._rates = np.zeros(3)
        self._carried: tuple[Array, Array] | None = None  # velocity and the last specific force
        self._t_ns = 0
        self._refused_s = 0.0

    def update(
        self,
        ned_q_body: Array,
        body_rates_rad_s: Array,
        t_ns: int,
        ned_v_m_s: Array | None = None,
        body_f_m_s2: Array | None = None,
    ) -> Array:
        """Attitude (4,) at a time, from what was told of that time.

        Args:
            ned_q_body: the autopilot's estimate, (4,).
            body_rates_rad_s: body rates, (3,), rad/s.
            t_ns: that time, ns.
            ned_v_m_s: the autopilot's velocity estimate, (3,), m/s.
            body_f_m_s2: specific force in the body frame, (3,), m/s²; without it, or a velocity, gyroscopes and
                estimate say all.
        """
        dt_s = (t_ns - self._t_ns) / 1e9
        rates = (self._rates + body_rates_rad_s) / 2
        self._t_ns, self._rates = t_ns, body_rates_rad_s
        if self._quat is None or self._error_rad == 0.0 or not 0.0 < dt_s <= _LONGEST_STEP_S:
            return self._begin(ned_q_body)
        before = self._quat
        quat = self._quat = quat_multiply(before, quat_exp((rates - self._bias) * dt_s))
        self._predict(dt_s, float(rates[2]))
        self._carry(before, quat, dt_s, ned_v_m_s, body_f_m_s2)
        error = quat_multiply(quat_conjugate(quat), ned_q_body)
        error = 2.0 * error[1:] * (1.0 if error[0] >= 0.0 else -1.0)
        if np.linalg.norm(error) > 6.0 * np.hypot(
            self._error_rad, np.sqrt(self._covariance[_LEVEL, _TILT, _TILT].real)
        ):
            self._refused_s += dt_s
            return self._begin(ned_q_body) if self._refused_s > _REFUSED_S else quat
        self._refused_s = 0.0
        turn = self._correct(_TILT, error, dt_s)
        if self._carried is not None and ned_v_m_s is not None:
            short = quat_rotate(quat_conjugate(quat), ned_v_m_s - self._carried[0])
            turn = turn + self._correct(_SHORT, _QUARTER_TURN @ short / _GRAVITY_M_S2, dt_s)
        quat = quat_multiply(quat, quat_exp(turn))
        self._quat = quat / np.linalg.norm(quat)
        return self._quat

    def _begin(self, ned_q_body: Array) -> Array:
        self._quat, self._refused_s, self._carried = np.asarray(ned_q_body, float), 0.0, None
        self._bias, self._force_bias = np.zeros(3), np.zeros(3)
        first = np.diag(np.square([self._error_rad, _BIAS_RAD_S, 0.0, _FORCE_BIAS])).astype(complex)
        self._covariance = np.stack((first, first))
        return self._quat

    def _predict(self, dt_s: float, yaw_rate_rad_s: float) -> None:
        step = np.eye(4, dtype=complex)
        step[_TILT, _BIAS] = -dt_s
        step[_SHORT] = dt_s, -(dt_s**2) / 2, 1.0, -dt_s
        transition = np.stack((step, step))
        transition[_LEVEL, [_TILT, _SHORT]] *= np.exp(-1j * yaw_rate_rad_s * dt_s)
        walk = np.square([_GYRO_RAD_RTS, _BIAS_WALK, _FORCE_RTS, 0.0])
        carried = transition @ self._covariance @ transition.conj().mT + np.diag(walk * dt_s)
        # What rounding leaves that is not Hermitian grows with every correction, and would end the filter in minutes.
        self._covariance = (carried + carried.conj().mT) / 2

    def _carry(self, before: Array, quat: Array, dt_s: float, velocity: Array | None, force: Array | None) -> None:
        """Carry the velocity on by the specific force between two attitudes; begin with it; or do without it."""
        if velocity is None or force is None:
            self._carried = None
            return
        if self._carried is None:
            self._carried = np.asarray(velocity, float), force
            level = self._covariance[_LEVEL]
            level[_SHORT] = level[:, _SHORT] = 0.0
            level[_SHORT, _SHORT] = self._short_s**2
            return
        carried, last = self._carried
        bias = _GRAVITY_M_S2 * _QUARTER_TURN.T @ self._force_bias
        mean = (quat_rotate(before, last - bias) + quat_rotate(quat, force - bias)) / 2 + _GRAVITY_M_S2 * _DOWN
        carried = carried + mean * dt_s
        carried[2] = velocity[2]
        self._carried = carried, force

    def _correct(self, row: int, measured: Array, dt_s: float) -> Array:
        """Take in what a row's error is in the body's axes, (3,). Returns how far to turn the attitude, (3,), rad."""
        column = self._covariance[:, :, row]
        gain = column / (np.real(column[:, row]) + self._densities[row] / dt_s)[:, None]
        if row == _SHORT:
            gain[_HEADING] = 0.0
        self._covariance = self._covariance - gain[:, :, None] * column.conj()[:, None, :]
        level = gain[_LEVEL] * complex(measured[0], measured[1])
        change = np.stack((level.real, level.imag, gain[_HEADING].real * measured[2]), axis=1)  # columns x, y, z
        self._bias = self._bias + change[_BIAS]
        self._force_bias = self._force_bias + change[_FORCE]
        if self._carried is not None and self._quat is not None:
            carried, force = self._carried
            self._carried = carried + _GRAVITY_M_S2 * quat_rotate(self._quat, _QUARTER_TURN.T @ change[_SHORT]), force
        return change[_TILT]
