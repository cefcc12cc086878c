"""Along a line: face its end, keep on it, slow down before it, hold the height."""

from __future__ import annotations

import math

import numpy as np

from common.geometry.rotation import Array, wrap_angle
from common.messages import Request
from onboard.search.config import SearchConfig


def along(begin_m: Array, end_m: Array, ned_p_m: Array, yaw_rad: float, config: SearchConfig) -> Request:
    """Velocity and heading rate towards the end of a line.

    Along the line the speed is v = min(v_search, gain · d), with d the way that is left; beside it the vehicle is drawn
    back by gain times the offset. It moves only when its nose is about where it is going.

    Args:
        begin_m: beginning of the line (2,), north and east, m.
        end_m: its end (2,).
        ned_p_m: the vehicle (3,), NED, m.
        yaw_rad: its heading, rad.
        config: speeds and gains.
    """
    line, place = end_m - begin_m, ned_p_m[:2]
    to_end = end_m - place
    left_m = float(np.linalg.norm(to_end))
    direction = line / max(float(np.linalg.norm(line)), 1e-9)
    if float(np.linalg.norm(line)) < config.reached_m:  # no line to keep to
        direction = to_end / max(left_m, 1e-9)
    beside = to_end - (to_end @ direction) * direction
    forward = max(min(config.gain_1_s * float(to_end @ direction), config.speed_m_s), -config.speed_m_s)
    velocity = forward * direction + config.gain_1_s * beside
    speed = float(np.linalg.norm(velocity))
    velocity = velocity * min(1.0, config.speed_m_s / max(speed, 1e-9))
    wanted = math.atan2(direction[1], direction[0])
    off = wrap_angle(wanted - yaw_rad)
    turn = min(max(config.yaw_gain_1_s * off, -config.yaw_rate_rad_s), config.yaw_rate_rad_s)
    if abs(off) > config.facing_rad:
        velocity = np.zeros(2)
    down = config.gain_1_s * (-config.height_m - float(ned_p_m[2]))
    down = min(max(down, -config.climb_m_s), config.climb_m_s)
    return Request(frame="ned", vector=(float(velocity[0]), float(velocity[1]), down), yaw_rate_rad_s=turn)
