"""The chase law's horizontal part: from the target in the picture to a request, in either form.

One law in accelerations serves both forms. The regulator's gains on the state at the time when the request acts give
the acceleration that the vehicle should have; wind and drag, as estimated, come on top; and the model of the autopilot
says what to request for it: the acceleration itself, or the velocity with which the autopilot's own velocity loop
commands it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ground.pursuit.answer import ERROR, OFFSET, TARGET_A, TARGET_V, WIND, make_answer
from ground.pursuit.config import PursuitConfig
from ground.pursuit.motion import RelativeMotion
from ground.pursuit.regulator import make_gains
from ground.pursuit.view import Pose

Array = NDArray[np.float64]

_BRAKE_SHARE = 0.27
"""Of the largest acceleration, for the approach to a far target; the rest is for what it does meanwhile."""


class Steering:
    """Estimates the relative motion and asks for the vehicle's.

    Args:
        config: weights, limits and the vehicle's answer.
        period_s: nominal time between pictures, s.
    """

    def __init__(self, config: PursuitConfig, period_s: float = 0.05):
        self._config = config
        answer = make_answer(config, config.output)
        self._motion = RelativeMotion(config, answer)
        effort = config.velocity_effort if config.output == "velocity" else config.effort
        # The weight is on the acceleration that a request makes the autopilot command.
        self._gains = make_gains(answer, period_s, effort * answer.command_request**2)
        self._closing_1_s = float(self._gains[ERROR] / self._gains[TARGET_V])
        self.reset()

    def reset(self) -> None:
        """Forget target and requests."""
        self._motion.reset()
        self._request: Array | None = None
        self._last_ns = 0

    def delayed(self, request_s: float) -> None:
        """Reckon with a time from a picture's capture to the setpoint that comes of it, s."""
        self._motion.request_delay_s = request_s

    def retarget(self) -> None:
        """Forget the target alone."""
        self._motion.retarget()

    def follow(
        self, relative_m: Array, std_m: float, pose: Pose, t_ns: int, turn_rad_s: float, towards_m_s2: float
    ) -> Array:
        """Request for a target that was seen: a velocity, m/s, or an acceleration, m/s², north and east, shape (2,).

        Args:
            relative_m: from the vehicle to the target in the picture captured at `t_ns`, (2,), m.
            std_m: its standard deviation, m.
            pose: vehicle at that time.
            t_ns: capture time, ns.
            turn_rad_s: rate at which the target turns, clockwise, rad/s.
            towards_m_s2: largest acceleration towards the target.
        """
        self._motion.update(relative_m, pose, t_ns, turn_rad_s, std_m)
        return self._ask(pose, t_ns, relative_m, towards_m_s2)

    def coast(self, relative_m: Array, velocity_m_s: Array, pose: Pose, t_ns: int, turn_rad_s: float) -> Array:
        """As `follow`, for an unseen target that a prediction has at a place, moving at a velocity (2,), m/s."""
        self._motion.update(None, pose, t_ns, turn_rad_s, 1.0)
        self._motion.predicted(relative_m, velocity_m_s)
        # A place that nobody sees is worth no hard start: a target that was lost at the picture's edge was flown past.
        return self._ask(pose, t_ns, relative_m, self._config.acceleration_min_m_s2)

    def stand(self, pose: Pose, t_ns: int) -> Array:
        """Velocity request that ends the flight after a target, (2,), m/s."""
        self._motion.reset()
        return self._slewed(np.zeros(2), pose, t_ns)

    def _ask(self, pose: Pose, t_ns: int, relative_m: Array, towards_m_s2: float) -> Array:
        motion = self._motion
        state = motion.ahead()
        if state is None:
            return pose.ned_v_m_s[:2].copy() if self._config.output == "velocity" else np.zeros(2)
        seen = state.copy()
        seen[TARGET_A], seen[OFFSET] = motion.target_acceleration(state), state[OFFSET] - motion.slant_m_s2
        seen[ERROR] = brakable(state[ERROR], self._closing_1_s, _BRAKE_SHARE * self._config.acceleration_m_s2)
        last = motion.last_request
        request = last - self._gains @ np.vstack((seen, last))
        commanded = capped(motion.commanded(state, request), self._config.tilt_max_m_s2)
        wanted = self._within(commanded + state[WIND], relative_m, towards_m_s2)
        request = motion.request(state, wanted - state[WIND])
        if self._config.output == "velocity":
            request = self._slewed(request, pose, t_ns)
        motion.sent(request)
        return request

    def _within(self, wanted: Array, relative_m: Array, towards_m_s2: float) -> Array:
        """Acceleration within its limit, and towards the target within what keeps it in view."""
        towards = relative_m / max(float(np.linalg.norm(relative_m)), 1e-6)
        excess = float(wanted @ towards) - towards_m_s2
        return capped(wanted - max(0.0, excess) * towards, self._config.acceleration_m_s2)

    def _slewed(self, velocity: Array, pose: Pose, t_ns: int) -> Array:
        """The velocity request within speed and slew, (2,), m/s."""
        last = pose.ned_v_m_s[:2] if self._request is None else self._request
        dt_s = min(max((t_ns - self._last_ns) / 1e9, 0.01), 0.2) if self._request is not None else 0.05
        change = capped(velocity, self._config.speed_m_s) - last
        self._request, self._last_ns = last + capped(change, self._config.slew_m_s2 * dt_s), t_ns
        return self._request.copy()


def brakable(error_m: Array, closing_1_s: float, brake_m_s2: float) -> Array:
    """The distance (2,), m, as far as the regulator may act on it: linear gains know no largest acceleration.

    They close in on a far target at a speed that grows with the distance, v = k e, and fly past it. The speed from
    which a vehicle stops over a distance grows with its root alone: beyond e0 = a / k², v² = 2 a (e − e0 / 2), which
    continues the line smoothly.

    Args:
        error_m: from vehicle to target.
        closing_1_s: speed by distance, k, for which the gains ask near the target, 1/s.
        brake_m_s2: acceleration that is kept for stopping, a, m/s².
    """
    distance_m, linear_m = float(np.linalg.norm(error_m)), brake_m_s2 / closing_1_s**2
    if distance_m <= linear_m:
        return error_m
    speed_m_s = math.sqrt(2.0 * brake_m_s2 * (distance_m - linear_m / 2.0))
    return error_m * (speed_m_s / (closing_1_s * distance_m))


def capped(vector: Array, length: float) -> Array:
    """The vector, shortened to a length where it is longer."""
    norm = float(np.linalg.norm(vector))
    return vector if norm <= length else vector * (length / norm)
