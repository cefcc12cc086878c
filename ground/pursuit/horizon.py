"""Where down and north are: the autopilot's attitude with its fast errors taken out by its gyroscopes.

The error of an attitude estimate wanders; the gyroscopes say how the attitude really changed meanwhile. So the attitude
is carried on by the body rates alone and drawn to the estimate slowly: a Kalman filter whose three axes share one
covariance of attitude error and gyroscope bias (Mahony, Hamel, Pflimlin 2008, DOI 10.1109/TAC.2008.923738, with the
gains of a Kalman filter instead of fixed ones). The estimate's error is correlated over `time_s`; a filter that
is much slower than that may take it as white noise of the same density.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.geometry.rotation import quat_conjugate, quat_exp, quat_multiply

Array = NDArray[np.float64]

_LONGEST_STEP_S = 0.15
_REFUSED_S = 0.4  # an estimate that stays away for so long has jumped: the filter begins anew from it
_GYRO_RAD_RTS = 3e-4  # random walk of the integrated rates, rad per root second
_BIAS_RAD_S, _BIAS_WALK = 5e-4, 1e-5  # what an autopilot leaves of a gyroscope's bias; its walk, per root second


class Horizon:
    """Attitude by gyroscopes and the autopilot's estimate together.

    Args:
        error_rad: standard deviation of the estimate's error, per axis, rad; 0 takes the estimate as it is.
        time_s: its correlation time, s.
    """

    def __init__(self, error_rad: float, time_s: float):
        self._error_rad, self._time_s = error_rad, time_s
        self._quat: Array | None = None
        self._rates = np.zeros(3)
        self._bias = np.zeros(3)
        self._covariance = np.zeros((2, 2))
        self._t_ns = 0
        self._refused_s = 0.0

    def update(self, ned_q_body: Array, body_rates_rad_s: Array, t_ns: int) -> Array:
        """Attitude (4,) at a time, from the estimate (4,) and the body rates (3,), rad/s, of that time."""
        dt_s = (t_ns - self._t_ns) / 1e9
        mean = (self._rates + body_rates_rad_s) / 2
        self._t_ns, self._rates = t_ns, body_rates_rad_s
        if self._quat is None or self._error_rad == 0.0 or not 0.0 < dt_s <= _LONGEST_STEP_S:
            return self._begin(ned_q_body)
        quat = quat_multiply(self._quat, quat_exp((mean - self._bias) * dt_s))
        transition = np.array([[1.0, -dt_s], [0.0, 1.0]])
        covariance = transition @ self._covariance @ transition.T
        covariance = covariance + np.diag([_GYRO_RAD_RTS**2 * dt_s, _BIAS_WALK**2 * dt_s])
        error = quat_multiply(quat_conjugate(quat), ned_q_body)
        error = 2.0 * error[1:] * (1.0 if error[0] >= 0.0 else -1.0)
        if np.linalg.norm(error) > 6.0 * np.hypot(self._error_rad, np.sqrt(covariance[0, 0])):
            self._refused_s += dt_s
            if self._refused_s > _REFUSED_S:
                return self._begin(ned_q_body)
            self._quat, self._covariance = quat, covariance
            return quat
        self._refused_s = 0.0
        variance = 2.0 * self._error_rad**2 * self._time_s / dt_s
        gain = covariance[:, 0] / (covariance[0, 0] + variance)
        quat = quat_multiply(quat, quat_exp(gain[0] * error))
        self._bias = self._bias + gain[1] * error
        self._covariance = covariance - np.outer(gain, covariance[0])
        self._quat = quat / np.linalg.norm(quat)
        return self._quat

    def _begin(self, ned_q_body: Array) -> Array:
        self._quat, self._bias, self._refused_s = np.asarray(ned_q_body, float), np.zeros(3), 0.0
        self._covariance = np.diag([self._error_rad**2, _BIAS_RAD_S**2])
        return self._quat
