"""The vehicle's recent states, looked up by a picture's capture time."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.geometry.rotation import quat_exp, quat_multiply, quat_rotate, slerp
from common.header import Received
from common.messages import VehicleState
from ground.pursuit.horizon import Horizon
from ground.pursuit.view import Pose

Array = NDArray[np.float64]
_FURTHEST_AHEAD_S = 0.3
_FURTHEST_BACK_S = 0.1


@dataclass(frozen=True)
class _State:
    t_ns: int
    pose: Pose
    level: Array
    body_rates_rad_s: Array


class StateHistory:
    """Keeps states for a while and gives the pose at a time between them.

    Args:
        span_s: how long states are kept, s.
        horizon: what makes the attitude of estimate and body rates; None takes the estimate as it is.
    """

    def __init__(self, span_s: float, horizon: Horizon | None = None):
        self._span_ns = int(span_s * 1e9)
        self._horizon = horizon or Horizon(0.0, 1.0)
        self._states: deque[_State] = deque()

    def extend(self, states: Iterable[Received[VehicleState]]) -> None:
        """Take newer states; one that is not newer than the last, or whose numbers are not finite, is ignored."""
        for state in states:
            if not np.isfinite((*state.message.ned_p_m, *state.message.ned_v_m_s, *state.message.ned_q_body)).all():
                continue
            self.add(state.message, state.header.capture_ns)

    def add(self, state: VehicleState, t_ns: int) -> None:
        """Take the finite state of a time, ns, if it is newer than the last one."""
        if self._states and t_ns <= self._states[-1].t_ns:
            return
        quat, rates = np.array(state.ned_q_body), np.array(state.body_rates_rad_s)
        velocity, force = np.array(state.ned_v_m_s), state.body_f_m_s2
        attitude = self._horizon.update(quat, rates, t_ns, velocity, None if force is None else np.array(force))
        acceleration = None if force is None else quat_rotate(attitude, np.array(force))[:2]
        pose = Pose(np.array(state.ned_p_m), velocity, attitude, quat, acceleration)
        self._states.append(_State(t_ns, pose, quat, rates))
        while self._states[-1].t_ns - self._states[0].t_ns > self._span_ns:
            self._states.popleft()

    def pose(self, capture_ns: int) -> tuple[Pose | None, str]:
        """Pose at a capture time and "", or None and why there is none.

        Between two states it is interpolated; up to 0.3 s after the newest and 0.1 s before the oldest one it is
        carried there by velocity and body rates.
        """
        if not self._states:
            return None, "no vehicle state; is helm running, and the link up?"
        oldest, newest = self._states[0], self._states[-1]
        ahead_s, back_s = (capture_ns - newest.t_ns) / 1e9, (oldest.t_ns - capture_ns) / 1e9
        if ahead_s > _FURTHEST_AHEAD_S:
            return None, f"no vehicle state for {ahead_s:.1f} s before the picture"
        if back_s > _FURTHEST_BACK_S:
            return None, f"the picture is {back_s:.1f} s older than the oldest vehicle state kept"
        if ahead_s >= 0.0 or back_s >= 0.0:
            return _carried(newest if ahead_s >= 0.0 else oldest, capture_ns), ""
        after = bisect_left(self._states, capture_ns, key=lambda s: s.t_ns)
        return _between(self._states[after - 1], self._states[after], capture_ns), ""


def _between(a: _State, b: _State, capture_ns: int) -> Pose:
    share = (capture_ns - a.t_ns) / (b.t_ns - a.t_ns)

    def mix(x: Array, y: Array) -> Array:
        return x + share * (y - x)

    return Pose(
        mix(a.pose.ned_p_m, b.pose.ned_p_m),
        mix(a.pose.ned_v_m_s, b.pose.ned_v_m_s),
        slerp(a.pose.ned_q_body, b.pose.ned_q_body, share),
        slerp(a.level, b.level, share),
        None if a.pose.ned_a_m_s2 is None or b.pose.ned_a_m_s2 is None else mix(a.pose.ned_a_m_s2, b.pose.ned_a_m_s2),
    )


def _carried(state: _State, capture_ns: int) -> Pose:
    ahead_s = (capture_ns - state.t_ns) / 1e9
    turn = quat_exp(state.body_rates_rad_s * ahead_s)
    return Pose(
        state.pose.ned_p_m + ahead_s * state.pose.ned_v_m_s,
        state.pose.ned_v_m_s,
        quat_multiply(state.pose.ned_q_body, turn),
        quat_multiply(state.level, turn),
        state.pose.ned_a_m_s2,
    )
