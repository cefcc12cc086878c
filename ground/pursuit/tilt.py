"""The chase law in its orientation form: from the relative position to a tilt, as the acceleration that it causes.

Teulière 2011's inner loop gives an orientation. Thrust stays on board, so a tilt is a horizontal acceleration
g·tan(tilt), which helm can limit; `regulator` says how it is found. The state is estimated from what is known best:

- the relative position comes from the picture, at its capture time, with the vehicle's attitude taken out;
- the vehicle's acceleration comes from its attitude: for a multirotor, tilt is acceleration;
- what tilt does not explain (wind, drag, a slant of the attitude estimate) is the difference between the tilt and the
  change of the estimated velocity, smoothed: the integral part of the paper's PI.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.geometry.rotation import quat_rotate
from ground.pursuit.config import PursuitConfig
from ground.pursuit.regulator import ERROR, OWN, TARGET, VELOCITY, Response, make_gains, make_model
from ground.pursuit.view import Pose

Array = NDArray[np.float64]

_GRAVITY_M_S2 = 9.80665
_DOWN = np.array([0.0, 0.0, 1.0])
_LONGEST_GAP_S = 2.0
# Standard deviations: of the acceleration that a tilt stands for (half a degree and more), and of the unexplained.
_TILT_M_S2 = 0.12
_UNEXPLAINED_M_S2 = 0.15
_UNSEEN = (0.15**2, 0.3**2, 0.3**2)  # variances of position, velocity, acceleration of a target that is predicted
_LEAST_DOWN = 0.3  # of the body's axis: beyond 70 degrees a tilt is no acceleration


class TiltLaw:
    """Estimates the relative motion and asks for an acceleration.

    Args:
        config: weights and the vehicle's answer.
        period_s: nominal time between pictures, s.
    """

    def __init__(self, config: PursuitConfig, period_s: float = 0.05):
        self._config, self._period_s = config, period_s
        response = Response(config.tilt_lag_s, config.tilt_delay_s, config.target_agility_s)
        self._model = make_model(response, period_s)
        self._gains = make_gains(self._model, config.tilt_effort)
        self._noise = _process_noise(config, period_s, len(self._gains))
        self.reset()

    def reset(self) -> None:
        """Forget the target."""
        size = len(self._gains)
        self._state: Array | None = None  # (N, 2): north and east are alike
        self._covariance = np.zeros((size, size))
        self._sent = np.zeros(2)
        self._disturbance = np.zeros(2)
        self._turn_rad_s = 0.0
        self._last: tuple[int, Array] | None = None

    def step(self, relative_m: Array | None, pose: Pose, t_ns: int, turn_rad_s: float = 0.0) -> Array:
        """Acceleration to ask for, north and east, m/s², shape (2,).

        Args:
            relative_m: from the vehicle to the target in the picture captured at `t_ns`, (2,), m; None when it was not
                seen: the motion is then carried on.
            pose: vehicle at that time.
            t_ns: capture time, ns.
            turn_rad_s: rate at which the target turns, clockwise, rad/s: its velocity turns as it does.
        """
        tilt = tilt_acceleration(pose)
        self._turn_rad_s = turn_rad_s
        self._predict(pose, tilt, t_ns)
        if self._state is None:
            if relative_m is None:
                return np.zeros(2)
            state = self._begin(relative_m, pose)
        else:
            state = self._correct(self._state, OWN, tilt - self._disturbance, _TILT_M_S2)
            if relative_m is not None:
                state = self._correct(state, ERROR, relative_m, self._config.tilt_measurement_m)
        self._state = state
        return self._asked(state, pose)

    def coast(self, relative_m: Array, velocity_m_s: Array, pose: Pose, t_ns: int, turn_rad_s: float = 0.0) -> Array:
        """As `step`, for an unseen target that a prediction has at a place, moving at a velocity (2,), m/s.

        What the last pictures said of it is replaced by that: they show an occluder's edge as much as the target.
        """
        asked = self.step(None, pose, t_ns, turn_rad_s)
        if self._state is None:
            return asked
        state = self._state.copy()
        state[ERROR], state[VELOCITY] = relative_m, velocity_m_s - pose.ned_v_m_s[:2]
        state[TARGET] = 0.0
        self._covariance[: TARGET + 1] = self._covariance[:, : TARGET + 1] = 0.0
        self._covariance[range(TARGET + 1), range(TARGET + 1)] = _UNSEEN
        self._state = state
        return self._asked(state, pose)

    def _asked(self, state: Array, pose: Pose) -> Array:
        """What the gains make of a state, with the sideways acceleration of the target's turn added to it."""
        state = state.copy()
        state[TARGET] += self._sideways(state, pose.ned_v_m_s[:2])
        return -self._gains @ state + self._disturbance

    def _sideways(self, state: Array, velocity_m_s: Array) -> Array:
        """Acceleration of the target across its velocity, (2,), m/s²."""
        north, east = state[VELOCITY] + velocity_m_s
        return self._turn_rad_s * np.array([-east, north])

    def took(self, acceleration_m_s2: Array) -> None:
        """Note what was asked for in the end, after the limits, (2,), m/s²."""
        self._sent = acceleration_m_s2 - self._disturbance

    def _begin(self, relative_m: Array, pose: Pose) -> Array:
        state = np.zeros((len(self._gains), 2))
        state[ERROR], state[VELOCITY] = relative_m, -pose.ned_v_m_s[:2]
        spread = np.zeros(len(self._gains))
        spread[:5] = (self._config.tilt_measurement_m**2, 1.0, 0.3, 0.1, 0.1)
        self._covariance = np.diag(spread)
        return state

    def _predict(self, pose: Pose, tilt: Array, t_ns: int) -> None:
        """Carry state and disturbance on to a capture time, a nominal period at a step."""
        velocity = pose.ned_v_m_s[:2].copy()
        if self._last is not None and t_ns > self._last[0]:
            gap_s = (t_ns - self._last[0]) / 1e9
            if gap_s > _LONGEST_GAP_S:
                self._state = None
            change = tilt - (velocity - self._last[1]) / gap_s
            share = min(1.0, gap_s / self._config.disturbance_s)
            self._disturbance = self._disturbance + share * (change - self._disturbance)
            for _ in range(round(gap_s / self._period_s)):
                self._carry_on(velocity)
        self._last = (t_ns, velocity)

    def _carry_on(self, velocity_m_s: Array) -> None:
        """State and covariance a period later, of a vehicle at a velocity (2,), m/s."""
        transition, entry = self._model.transition, self._model.entry
        if self._state is not None:
            across = self._sideways(self._state, velocity_m_s)
            self._state = transition @ self._state + np.outer(entry, self._sent)
            self._state[ERROR] += across * self._period_s**2 / 2
            self._state[VELOCITY] += across * self._period_s
            self._covariance = transition @ self._covariance @ transition.T + self._noise

    def _correct(self, state: Array, row: int, measured: Array, std: float) -> Array:
        """The state after a measurement of one of its rows."""
        gain = self._covariance[:, row] / (self._covariance[row, row] + std**2)
        corrected = state + np.outer(gain, measured - state[row])
        shrink = np.eye(len(gain))
        shrink[:, row] -= gain
        # Joseph's form keeps the covariance symmetric and positive.
        self._covariance = shrink @ self._covariance @ shrink.T + std**2 * np.outer(gain, gain)
        return corrected


def tilt_acceleration(pose: Pose) -> Array:
    """Horizontal acceleration that the tilt stands for while the height is held, north and east, m/s²: g·tan(tilt)."""
    down = quat_rotate(pose.ned_q_body, _DOWN)
    return -_GRAVITY_M_S2 * down[:2] / max(float(down[2]), _LEAST_DOWN)


def _process_noise(config: PursuitConfig, dt_s: float, size: int) -> Array:
    """Covariance (N, N) that a period adds: Singer's for the target, white for the vehicle's own accelerations."""
    noise = np.zeros((size, size))
    density = 2.0 * config.target_agility_m_s2**2 / config.target_agility_s
    block = [
        [dt_s**5 / 20, dt_s**4 / 8, dt_s**3 / 6],
        [dt_s**4 / 8, dt_s**3 / 3, dt_s**2 / 2],
        [dt_s**3 / 6, dt_s**2 / 2, dt_s],
    ]
    noise[: TARGET + 1, : TARGET + 1] = density * np.array(block)
    noise[VELOCITY, VELOCITY] += (_UNEXPLAINED_M_S2 * dt_s) ** 2
    noise[OWN, OWN] = noise[OWN + 1, OWN + 1] = _UNEXPLAINED_M_S2**2 * dt_s
    return noise
