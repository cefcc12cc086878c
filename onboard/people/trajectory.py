"""Where the camera was along a recording: `groundtruth.txt` of TUM's layout."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass

import numpy as np

from common.config import ConfigError
from common.geometry.rotation import Array, quat_conjugate, quat_multiply, slerp
from onboard.people.sights import VehiclePose

TRUTH = "groundtruth.txt"
_GAP_S = 0.2
"""Between two poses farther apart than this nothing is known."""
_NED_Q_WORLD = (0.0, 1.0, 0.0, 0.0)
"""The recording's world has z up; NED as we lay it there has north along its x, so east is -y and down -z."""
_NORM = 0.01


@dataclass(frozen=True)
class CameraPose:
    """Pose of the colour camera's optical frame in the recording's world, whose z points up."""

    world_p_m: Array
    """(3,)."""
    world_q_camera: Array
    """(4,), w first."""

    def vehicle(self, body_q_camera: Array | tuple[float, float, float, float]) -> VehiclePose:
        """Pose of a vehicle whose camera sits in its middle, turned like this in its body."""
        ned_q_camera = quat_multiply(_NED_Q_WORLD, self.world_q_camera)
        return VehiclePose(ned_of(self.world_p_m), quat_multiply(ned_q_camera, quat_conjugate(body_q_camera)))


def ned_of(world_p_m: Array) -> Array:
    """(3,) north, east, down of a place in the recording's world, and the other way round: it is its own inverse."""
    return np.asarray(world_p_m, float) * (1.0, -1.0, -1.0)


class Trajectory:
    """The camera's poses over time.

    Args:
        rows: time, s, then x, y, z, m, and the quaternion x, y, z, w of each pose, in any order; (N, 8).
        where: file that they are from, for messages.

    Raises:
        ConfigError: a quaternion is none.
    """

    def __init__(self, rows: Array, where: str):
        self._rows = rows[np.argsort(rows[:, 0], kind="stable")]
        norms = np.linalg.norm(self._rows[:, 4:], axis=1)
        wrong = np.flatnonzero(np.abs(norms - 1.0) > _NORM)
        if len(wrong):
            time_s, norm = self._rows[wrong[0], 0], norms[wrong[0]]
            raise ConfigError(f"people: {where}, time {time_s:.6f}: got a quaternion of norm {norm:.3f}, expected 1")

    def at(self, t_s: float) -> CameraPose | None:
        """Pose at a time, s, between the two poses around it; None where those are more than 0.2 s apart."""
        times = self._rows[:, 0]
        after = bisect_left(times, t_s)
        if after == len(times) or (after == 0 and times[0] != t_s):
            return None
        before = max(after - 1, 0)
        span_s = times[after] - times[before]
        if span_s > _GAP_S and times[after] != t_s:
            return None
        share = (t_s - times[before]) / span_s if span_s > 0 else 0.0
        first, last = self._rows[before], self._rows[after]
        turn = slerp(np.roll(first[4:], 1), np.roll(last[4:], 1), share)
        return CameraPose((1.0 - share) * first[1:4] + share * last[1:4], turn)
