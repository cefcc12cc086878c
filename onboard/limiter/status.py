"""What the limiter tells the bus: zone, speeds, and the distances around the vehicle."""

from __future__ import annotations

import math

import numpy as np

from common.messages import SECTORS, LimiterStatus
from onboard.limiter.config import LimiterConfig
from onboard.limiter.limiter import Limited
from onboard.limiter.surroundings import COLUMNS, ROWS, Surroundings

_SECTOR_RAD = 2.0 * math.pi / SECTORS
_LEVEL_SINE = math.sin(math.radians(60.0))


def limiter_status(limited: Limited, around: Surroundings | None, config: LimiterConfig) -> LimiterStatus:
    """The status of a limited velocity in its surroundings."""
    known, index = around or Surroundings(blind=True), limited.culprit
    return LimiterStatus(
        zone=limited.zone,
        distance_m=limited.distance_m,
        ned_direction=limited.ned_direction,
        asked_m_s=math.hypot(*limited.asked_ned_v_m_s),
        allowed_m_s=math.hypot(*limited.ned_v_m_s),
        why=limited.why,
        source=known.sources[index] if 0 <= index < len(known.sources) else "",
        label=known.labels[index] if 0 <= index < len(known.labels) else "",
        h_min_m=config.h_min_m,
        h_desired_m=config.h_desired_m,
        h_mid_m=config.h_mid_m,
        h_max_m=config.h_max_m,
        push_back_m_s=config.push_back_m_s,
        sectors_m=sectors_m(known),
        seen=tuple((_free_m(known) > 0.0).tolist()),
    )


def sectors_m(around: Surroundings) -> tuple[float, ...]:
    """Nearest horizontal distance in each sector of 5 degrees, from north clockwise, m.

    -1 where nothing is known; the range of what looks there where it sees nothing. Obstacles more than 60 degrees above
    or below the horizon stand in no sector.
    """
    nearest = np.full(SECTORS, np.inf)
    if len(around.distance_m):
        north, east, down = around.ned_direction.T
        level = np.abs(down) <= _LEVEL_SINE
        sector = np.floor(np.arctan2(east, north) / _SECTOR_RAD).astype(int)[level] % SECTORS
        np.minimum.at(nearest, sector, (around.least_m * np.hypot(north, east))[level])
    free = _free_m(around)
    shown = np.where(np.isfinite(nearest), nearest, np.where(free > 0.0, free, -1.0))
    return tuple(shown.tolist())


def _free_m(around: Surroundings) -> np.ndarray:
    """How far each sector, (72,), is known to be free but for the obstacles, m; 0 where nobody looked of late."""
    if around.range_m is None:
        return np.zeros(SECTORS)
    return np.repeat(around.range_m[ROWS // 2], SECTORS // COLUMNS)
