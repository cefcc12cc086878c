"""The vehicle's recent states, looked up by a picture's capture time."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from collections.abc import Iterable

import numpy as np

from common.geometry.rotation import quat_exp, quat_multiply, slerp
from common.header import Received
from common.messages import VehicleState
from ground.pursuit.view import Pose

_FURTHEST_AHEAD_S = 0.3
_FURTHEST_BACK_S = 0.1


class StateHistory:
    """Keeps states for a while and gives the pose at a time between them.

    Args:
        span_s: how long states are kept, s.
    """

    def __init__(self, span_s: float):
        self._span_ns = int(span_s * 1e9)
        self._states: deque[Received[VehicleState]] = deque()

    def extend(self, states: Iterable[Received[VehicleState]]) -> None:
        """Take newer states; one that is not newer than the last, or whose numbers are not finite, is ignored."""
        for state in states:
            if not np.isfinite((*state.message.ned_p_m, *state.message.ned_v_m_s, *state.message.ned_q_body)).all():
                continue
            if not self._states or state.header.capture_ns > self._states[-1].header.capture_ns:
                self._states.append(state)
        while self._states and self._states[-1].header.capture_ns - self._states[0].header.capture_ns > self._span_ns:
            self._states.popleft()

    def pose(self, capture_ns: int) -> tuple[Pose | None, str]:
        """Pose at a capture time and "", or None and why there is none.

        Between two states it is interpolated; up to 0.3 s after the newest and 0.1 s before the oldest one it is
        carried there by velocity and body rates.
        """
        if not self._states:
            return None, "no vehicle state; is helm running, and the link up?"
        oldest, newest = self._states[0], self._states[-1]
        ahead_s = (capture_ns - newest.header.capture_ns) / 1e9
        back_s = (oldest.header.capture_ns - capture_ns) / 1e9
        if ahead_s > _FURTHEST_AHEAD_S:
            return None, f"no vehicle state for {ahead_s:.1f} s before the picture"
        if back_s > _FURTHEST_BACK_S:
            return None, f"the picture is {back_s:.1f} s older than the oldest vehicle state kept"
        if ahead_s >= 0.0 or back_s >= 0.0:
            return _carried(newest if ahead_s >= 0.0 else oldest, capture_ns), ""
        after = bisect_left(self._states, capture_ns, key=lambda s: s.header.capture_ns)
        return _between(self._states[after - 1], self._states[after], capture_ns), ""


def _between(a: Received[VehicleState], b: Received[VehicleState], capture_ns: int) -> Pose:
    share = (capture_ns - a.header.capture_ns) / (b.header.capture_ns - a.header.capture_ns)

    def mix(x: tuple[float, ...], y: tuple[float, ...]) -> np.ndarray:
        return np.array(x) + share * (np.array(y) - np.array(x))

    return Pose(
        mix(a.message.ned_p_m, b.message.ned_p_m),
        mix(a.message.ned_v_m_s, b.message.ned_v_m_s),
        slerp(a.message.ned_q_body, b.message.ned_q_body, share),
    )


def _carried(state: Received[VehicleState], capture_ns: int) -> Pose:
    ahead_s = (capture_ns - state.header.capture_ns) / 1e9
    velocity = np.array(state.message.ned_v_m_s)
    turned = quat_multiply(state.message.ned_q_body, quat_exp(np.array(state.message.body_rates_rad_s) * ahead_s))
    return Pose(np.array(state.message.ned_p_m) + ahead_s * velocity, velocity, turned)
