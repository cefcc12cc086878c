"""What the limiter tells the bus: zone, speeds, and the distances around the vehicle."""

from __future__ import annotations

import math
from collections.abc import Sequence

from common.messages import SECTORS, Obstacle

_SECTOR_RAD = 2.0 * math.pi / SECTORS
_LEVEL_SINE = math.sin(math.radians(60.0))


def sectors_m(obstacles: Sequence[Obstacle]) -> tuple[float, ...]:
    """Nearest horizontal distance in each sector of 5 degrees, from north clockwise, m; -1 where nothing is known.

    Obstacles more than 60 degrees above or below the horizon stand in no sector.
    """
    nearest = [-1.0] * SECTORS
    for obstacle in obstacles:
        north, east, down = obstacle.ned_direction
        if abs(down) > _LEVEL_SINE:
            continue
        sector = int(math.atan2(east, north) // _SECTOR_RAD) % SECTORS
        distance_m = obstacle.distance_m * math.hypot(north, east)
        nearest[sector] = distance_m if nearest[sector] < 0.0 else min(nearest[sector], distance_m)
    return tuple(nearest)
