"""The obstacle map as MAVLink's OBSTACLE_DISTANCE, for the autopilot's own collision prevention and QGroundControl."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from common.messages import SECTORS

_BODY_FRD = 12  # MAV_FRAME_BODY_FRD
_UNKNOWN_SENSOR = 4  # MAV_DISTANCE_SENSOR_UNKNOWN
_UNKNOWN_CM = 65535
_INCREMENT_DEG = 360.0 / SECTORS
_CM_PER_M = 100.0


def obstacle_distance(
    sectors_m: Sequence[float], heading_rad: float, least_m: float, most_m: float, time_us: int
) -> dict[str, Any]:
    """Fields of an OBSTACLE_DISTANCE, as autopilots read them: body frame, clockwise from forward, cm.

    The sectors stay as they are, none is resampled: the first one sent is the one that the vehicle looks into, and
    `angle_offset` says how far its middle is from forward.

    Args:
        sectors_m: distances of `LimiterStatus.sectors_m`, from north clockwise, m; -1 where nothing is known.
        heading_rad: heading of the vehicle, rad from north, clockwise.
        least_m: smallest distance that is told, m; what is nearer is told as that.
        most_m: largest distance that is told, m; what is farther, or free beyond it, is told as free (one more).
        time_us: time stamp, µs.
    """
    heading_deg = math.degrees(heading_rad) % 360.0
    first = int(heading_deg // _INCREMENT_DEG) % SECTORS
    turned = [*sectors_m[first:], *sectors_m[:first]]
    most_cm = round(most_m * _CM_PER_M)
    distances = [_UNKNOWN_CM if d < 0 else most_cm + 1 if d >= most_m else round(max(d, least_m) * 100) for d in turned]
    return {
        "time_usec": time_us,
        "sensor_type": _UNKNOWN_SENSOR,
        "distances": distances,
        "increment": round(_INCREMENT_DEG),
        "min_distance": round(least_m * _CM_PER_M),
        "max_distance": most_cm,
        "increment_f": _INCREMENT_DEG,
        "angle_offset": (first + 0.5) * _INCREMENT_DEG - heading_deg,
        "frame": _BODY_FRD,
    }
