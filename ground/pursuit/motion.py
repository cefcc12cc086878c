"""The relative motion of target and vehicle, estimated from pictures and telemetry, and what it is when a request acts.

A Kalman filter on the model of `answer`, with the requests that were sent. A picture is old when it is looked at, and a
request acts later still: the state is carried on to that time with what is already under way (Smith 1957: a predictor
takes the delay out of the loop).
"""

from __future__ import annotations

import math
from collections import deque
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from common.geometry.rotation import quat_rotate
from ground.pursuit.answer import (
    DOUBT,
    ERROR,
    LAGGED,
    OFFSET,
    OWN_V,
    SIZE,
    STEP_S,
    TARGET_A,
    TARGET_V,
    TILT,
    WIND,
    Answer,
)
from ground.pursuit.config import PursuitConfig
from ground.pursuit.view import Pose

Array = NDArray[np.float64]

_GRAVITY_M_S2 = 9.80665
_DOWN = np.array([0.0, 0.0, 1.0])
_LEAST_DOWN = 0.3  # of the body's axis: beyond 70 degrees a tilt is no acceleration
_LONGEST_GAP_S = 2.0
_STEP_NS = round(STEP_S * 1e9)
# Standard deviations of what telemetry says, without what wanders.
_TILT_M_S2, _FORCE_M_S2, _VELOCITY_M_S = 0.03, 0.06, 0.01
_FIRST = (0.05, 0.05, 1.0, 0.5, 0.1, 0.3, 0.5, 0.5, 0.03)  # standard deviations at the first picture
_UNKNOWN = (5.0, 1.5, 0.5)  # of position, velocity, acceleration of a target that was found again, perhaps elsewhere
_UNSEEN = (0.15, 0.3, 0.3)  # of position, velocity, acceleration of a target that is predicted


class RelativeMotion:
    """Estimate of where target and vehicle are and how they move; north and east share one covariance.

    Args:
        config: the vehicle's answer, and how much to believe of what.
        answer: how the vehicle answers what is requested.
    """

    def __init__(self, config: PursuitConfig, answer: Answer):
        self._config, self._answer = config, answer
        self.request_delay_s = config.request_delay_s
        """From a picture's capture to the setpoint that comes of it, s."""
        self._over = lru_cache(maxsize=64)(self._steps)
        self.reset()

    def reset(self) -> None:
        """Forget target and requests."""
        self.state: Array | None = None
        """Rows of `answer`, columns north and east, shape (9, 2); None before the first picture."""
        self._covariance = np.zeros((SIZE, SIZE))
        self._requests: deque[tuple[int, Array]] = deque()  # from when it acts, ns, and what
        self.slant_m_s2 = np.zeros(2)
        """What the autopilot took for tilt and was none in the last picture, m/s²."""
        self._turn_rad_s = 0.0
        self._t_ns = 0

    def retarget(self) -> None:
        """Forget the target, and not the vehicle."""
        rows = [ERROR, TARGET_V, TARGET_A]
        self._covariance[rows] = self._covariance[:, rows] = 0.0
        self._covariance[rows, rows] = np.square(_UNKNOWN)

    def update(self, relative_m: Array | None, pose: Pose, t_ns: int, turn_rad_s: float, std_m: float) -> None:
        """Take in a picture.

        Args:
            relative_m: from the vehicle to the target in the picture captured at `t_ns`, (2,), m; None when it was not
                seen.
            pose: vehicle at that time.
            t_ns: capture time, ns.
            turn_rad_s: rate at which the target turns, clockwise, rad/s: its velocity turns as it does.
            std_m: standard deviation of `relative_m`, m.
        """
        tilt = tilt_acceleration(pose.ned_q_body)
        velocity = pose.ned_v_m_s[:2]
        if self.state is not None and not 0 <= t_ns - self._t_ns <= _LONGEST_GAP_S * 1e9:
            self.state = None
        if self.state is None:
            self._t_ns = t_ns
            if relative_m is not None:
                self._begin(relative_m, velocity, tilt)
        else:
            steps = round((t_ns - self._t_ns) / _STEP_NS)
            self.state = self._carried(self.state, self._t_ns, steps)
            transition, noise = self._over(steps)
            self._covariance = transition @ self._covariance @ transition.T + noise
            self._t_ns += steps * _STEP_NS
            self._correct((TILT,), tilt, _TILT_M_S2)
            if pose.ned_a_m_s2 is not None:
                self._correct((TILT, WIND), pose.ned_a_m_s2, _FORCE_M_S2)
            self._correct((OWN_V, DOUBT), velocity, _VELOCITY_M_S)
            if relative_m is not None:
                self._correct((ERROR,), relative_m, std_m)
        self.slant_m_s2, self._turn_rad_s = _slant(pose, tilt), turn_rad_s

    def predicted(self, relative_m: Array, velocity_m_s: Array) -> None:
        """Replace what the last pictures said of the target by a prediction: (2,), m, and its velocity (2,), m/s.

        Before an occlusion they show the occluder's edge as much as the target.
        """
        if self.state is None:
            return
        state = self.state.copy()
        state[ERROR], state[TARGET_V], state[TARGET_A] = relative_m, velocity_m_s, 0.0
        rows = [ERROR, TARGET_V, TARGET_A]
        self._covariance[rows] = self._covariance[:, rows] = 0.0
        self._covariance[rows, rows] = np.square(_UNSEEN)
        self.state = state

    def ahead(self) -> Array | None:
        """State (9, 2) when a request for the last picture begins to act."""
        if self.state is None:
            return None
        return self._carried(self.state, self._t_ns, round(self._delay_s / STEP_S))

    @property
    def _delay_s(self) -> float:
        return self.request_delay_s + self._config.tilt_delay_s

    @property
    def last_request(self) -> Array:
        """What was requested last, (2,); before the first request one that changes nothing."""
        if self._requests:
            return self._requests[-1][1]
        return np.zeros(2) if self.state is None else self._idle(self.state)

    def commanded(self, state: Array, request: Array) -> Array:
        """Acceleration (2,), m/s², that the autopilot commands for a request (2,) in a state (9, 2)."""
        answer = self._answer
        return answer.command @ state + answer.command_request * request - self.slant_m_s2

    def request(self, state: Array, acceleration_m_s2: Array) -> Array:
        """The request (2,) for which the autopilot commands an acceleration (2,), m/s²: the inverse of `commanded`."""
        answer = self._answer
        return (acceleration_m_s2 + self.slant_m_s2 - answer.command @ state) / answer.command_request

    def sent(self, request: Array) -> None:
        """Note what was requested for the last picture, after every limit, (2,)."""
        self._requests.append((self._t_ns + round(self._delay_s * 1e9), request.copy()))
        while len(self._requests) > 1 and self._requests[1][0] <= self._t_ns:
            self._requests.popleft()

    def target_acceleration(self, state: Array) -> Array:
        """Acceleration of the target, along its velocity and, by its turn, across it, (2,), m/s²."""
        north, east = state[TARGET_V]
        return state[TARGET_A] + self._turn_rad_s * np.array([-east, north])

    def _begin(self, relative_m: Array, velocity: Array, tilt: Array) -> None:
        state = np.zeros((SIZE, 2))
        state[ERROR], state[OWN_V], state[TILT], state[LAGGED] = relative_m, velocity, tilt, tilt
        state[WIND] = -tilt
        if self._answer.command[OWN_V]:  # a velocity loop's integral already balances the wind
            state[OFFSET] = tilt
        self.state, self._covariance = state, np.diag(np.square(_FIRST))

    def _carried(self, state: Array, t_ns: int, steps: int) -> Array:
        """State some steps of the model later, with the requests that act meanwhile."""
        answer = self._answer
        state = state.copy()
        angle_rad = self._turn_rad_s * STEP_S
        c, s = math.cos(angle_rad), math.sin(angle_rad)
        turn = np.array([[c, s], [-s, c]])  # from the right, on rows of north and east: clockwise
        slant = np.outer(answer.slant, self.slant_m_s2)
        for _ in range(steps):
            request = self._acting(t_ns, state)
            state = answer.transition @ state + np.outer(answer.request, request) + slant
            state[TARGET_V : TARGET_A + 1] = state[TARGET_V : TARGET_A + 1] @ turn
            t_ns += _STEP_NS
        return state

    def _acting(self, t_ns: int, state: Array) -> Array:
        """The request that acts at a time; before the first one what changes nothing."""
        for from_ns, request in reversed(self._requests):
            if from_ns <= t_ns:
                return request
        return self._idle(state)

    def _idle(self, state: Array) -> Array:
        return self.request(state, state[LAGGED])

    def _steps(self, count: int) -> tuple[Array, Array]:
        """Transition (9, 9) of a number of steps, and the covariance that they add."""
        total, noise = np.eye(SIZE), np.zeros((SIZE, SIZE))
        for _ in range(count):
            total = self._answer.transition @ total
            noise = self._answer.transition @ noise @ self._answer.transition.T + self._answer.noise
        return total, noise

    def _correct(self, rows: tuple[int, ...], measured: Array, std: float) -> None:
        """Take in a measurement of the sum of some rows."""
        if self.state is None:
            return
        row = np.zeros(SIZE)
        row[list(rows)] = 1.0
        carried = self._covariance @ row
        gain = carried / (row @ carried + std**2)
        self.state = self.state + np.outer(gain, measured - row @ self.state)
        shrink = np.eye(SIZE) - np.outer(gain, row)
        # Joseph's form keeps the covariance symmetric and positive.
        self._covariance = shrink @ self._covariance @ shrink.T + std**2 * np.outer(gain, gain)


def tilt_acceleration(ned_q_body: Array) -> Array:
    """Horizontal acceleration that a tilt stands for while the height is held, north and east, m/s²: g·tan(tilt)."""
    down = quat_rotate(ned_q_body, _DOWN)
    return -_GRAVITY_M_S2 * down[:2] / max(float(down[2]), _LEAST_DOWN)


def _slant(pose: Pose, tilt: Array) -> Array:
    """What the autopilot takes for tilt and is none, (2,), m/s²."""
    return np.zeros(2) if pose.ned_q_level is None else tilt_acceleration(pose.ned_q_level) - tilt
