"""The vehicle's pose at a picture's capture, from the stream of its states."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.geometry.rotation import quat_exp, quat_multiply, slerp
from common.messages import VehicleState

Array = NDArray[np.float64]
_KEPT = 100
_AHEAD_S = 0.1


@dataclass(frozen=True)
class Pose:
    """Where the vehicle is and how it stands."""

    ned_p_m: Array
    """Position, (3,), NED, m."""
    ned_q_body: Array
    """Attitude, (4,)."""


class PoseTrack:
    """The last seconds of states."""

    def __init__(self) -> None:
        self._states: deque[tuple[int, VehicleState]] = deque(maxlen=_KEPT)

    def add(self, stamp_ns: int, state: VehicleState) -> None:
        """Keep a state; one that is not newer than the last is dropped."""
        if not self._states or stamp_ns > self._states[-1][0]:
            self._states.append((stamp_ns, state))

    def at(self, t_ns: int) -> Pose | None:
        """Pose at an instant, ns: between two states, or up to 0.1 s after the newest; None when unknown."""
        if not self._states or t_ns < self._states[0][0]:
            return None
        index = bisect_right(self._states, t_ns, key=lambda entry: entry[0])
        stamp_ns, state = self._states[index - 1]
        dt_s = (t_ns - stamp_ns) / 1e9
        if index == len(self._states):
            if dt_s > _AHEAD_S:
                return None
            turned = quat_multiply(state.ned_q_body, quat_exp(np.array(state.body_rates_rad_s) * dt_s))
            return Pose(np.array(state.ned_p_m) + np.array(state.ned_v_m_s) * dt_s, turned)
        after_ns, after = self._states[index]
        share = (t_ns - stamp_ns) / (after_ns - stamp_ns)
        position = (1.0 - share) * np.array(state.ned_p_m) + share * np.array(after.ned_p_m)
        return Pose(position, slerp(state.ned_q_body, after.ned_q_body, share))
