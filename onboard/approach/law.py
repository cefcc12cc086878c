"""Towards a thing: face it, close in, hold at a distance."""

from __future__ import annotations

import math

import numpy as np

from common.geometry.rotation import Array, wrap_angle
from common.messages import Request
from onboard.approach.config import ApproachConfig

_LEVEL_MIN_M = 0.3


def closing(
    ned_p_target_m: Array, ned_p_vehicle_m: Array, yaw_rad: float, goal_m: float, config: ApproachConfig
) -> Request:
    """Velocity and heading rate towards a point.

    The speed is v = gain (h - goal), from 0 to the greatest, times cos² of the angle between nose and thing, and none
    where that angle is too large. Down it is the same gain, up to `sink_m_s`, while the point lies rather below than
    ahead. It never backs away and never climbs: that is the limiter's to do.

    Args:
        ned_p_target_m: nearest point of the thing (3,), NED, m.
        ned_p_vehicle_m: the vehicle (3,), NED, m.
        yaw_rad: its heading, rad.
        goal_m: distance to hold, m.
        config: gains and limits.
    """
    north, east, down = (np.asarray(ned_p_target_m) - np.asarray(ned_p_vehicle_m)).tolist()
    level_m = math.hypot(north, east)
    to_go_m = math.hypot(level_m, down) - goal_m
    sink = 0.0
    if to_go_m > config.hold_band_m and down > level_m:
        sink = min(config.gain_1_s * to_go_m, config.sink_m_s)
    if level_m < _LEVEL_MIN_M:  # above or below it: no direction to face, and near enough
        return Request(frame="ned", vector=(0.0, 0.0, sink))
    bearing = wrap_angle(math.atan2(east, north) - yaw_rad)
    turn = min(max(config.yaw_gain_1_s * bearing, -config.yaw_rate_rad_s), config.yaw_rate_rad_s)
    speed = 0.0
    if to_go_m > config.hold_band_m and abs(bearing) < config.facing_rad:
        # v = k (h - h_goal)
        speed = min(config.gain_1_s * to_go_m, config.speed_m_s) * math.cos(bearing) ** 2
    return Request(frame="ned", vector=(speed * north / level_m, speed * east / level_m, sink), yaw_rate_rad_s=turn)
