"""Whether a depth picture is news: frozen, repeated, empty or without a pose, it shows nothing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from common.geometry.rotation import quat_conjugate, quat_multiply
from onboard.proximity.config import ProximityConfig

Array = NDArray[np.float64]
Blind = Literal["", "frozen", "repeated", "empty", "no_pose", "silent"]
"""Why a picture shows nothing; empty when it does show something."""
REASONS: tuple[Blind, ...] = ("frozen", "repeated", "empty", "no_pose", "silent")
_MOVED_M, _TURNED_RAD = 0.05, 0.01


@dataclass(frozen=True)
class Taken:
    """One depth picture and where the vehicle was."""

    capture_ns: int
    """Its stamp."""
    data: bytes
    """Its pixels."""
    ned_p_m: Array
    """Position of the vehicle, (3,), NED, m."""
    ned_q_body: Array
    """Attitude, (4,)."""


class Watch:
    """Compares each picture with the ones before.

    Args:
        config: how long a picture may stay the same.
    """

    def __init__(self, config: ProximityConfig):
        self._config = config
        self._first: Taken | None = None
        self._newest_ns = -1

    def judge(self, taken: Taken) -> Blind:
        """Why a picture is no news, or nothing.

        `repeated`: its stamp is not newer than the last one's. `frozen`: its pixels are those of an earlier one, and
        the vehicle has moved or turned since, or time has passed: with a sensor's noise no two pictures are equal.
        """
        if taken.capture_ns <= self._newest_ns:
            return "repeated"
        self._newest_ns = taken.capture_ns
        first = self._first
        if first is None or first.data != taken.data:
            self._first = taken
            return ""
        same_s = (taken.capture_ns - first.capture_ns) / 1e9
        moved = float(np.linalg.norm(taken.ned_p_m - first.ned_p_m)) > _MOVED_M
        turned = _angle(first.ned_q_body, taken.ned_q_body) > _TURNED_RAD
        return "frozen" if moved or turned or same_s >= self._config.identical_s else ""


def _angle(q0: Array, q1: Array) -> float:
    """Angle between two attitudes, rad."""
    vector = quat_multiply(quat_conjugate(q0), q1)[1:]
    return 2.0 * float(np.arcsin(min(float(np.linalg.norm(vector)), 1.0)))
