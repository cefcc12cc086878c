"""Which messages each link carries unasked, how often, and from when on."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from pymavlink.dialects.v20 import development as mavlink

# When a message is first sent, s after the start; messages that are absent here begin at once.
FIRST_S: Mapping[int, float] = MappingProxyType(
    {
        mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: 0.3,
        mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 0.3,
        mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION: 0.3,
        mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: 0.3,
        mavlink.MAVLINK_MSG_ID_TIMESYNC: 0.3,
        mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1.35,
        mavlink.MAVLINK_MSG_ID_SYS_STATUS: 1.35,
        mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 1.35,
        mavlink.MAVLINK_MSG_ID_CURRENT_MODE: 1.35,
        mavlink.MAVLINK_MSG_ID_ATTITUDE: 1.8,
        mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: 1.8,
        mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET: 1.8,
        mavlink.MAVLINK_MSG_ID_HOME_POSITION: 2.4,
        mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 2.4,
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 2.4,
        mavlink.MAVLINK_MSG_ID_ODOMETRY: 2.4,
        mavlink.MAVLINK_MSG_ID_ALTITUDE: 2.4,
        mavlink.MAVLINK_MSG_ID_VFR_HUD: 2.4,
        mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: 2.4,
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 2.9,
    }
)

# Hz by message; measured on PX4's link to the companion computer.
ONBOARD_RATES: Mapping[int, float] = MappingProxyType(
    {
        mavlink.MAVLINK_MSG_ID_ATTITUDE: 100.0,
        mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: 50.0,
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 50.0,
        mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: 50.0,
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 30.0,
        mavlink.MAVLINK_MSG_ID_ODOMETRY: 30.0,
        mavlink.MAVLINK_MSG_ID_VFR_HUD: 10.0,
        mavlink.MAVLINK_MSG_ID_ALTITUDE: 10.0,
        mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET: 10.0,
        mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: 10.0,
        mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: 10.0,
        mavlink.MAVLINK_MSG_ID_TIMESYNC: 10.0,
        mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 8.0,
        mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 5.0,
        mavlink.MAVLINK_MSG_ID_SYS_STATUS: 5.0,
        mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1.0,
        mavlink.MAVLINK_MSG_ID_CURRENT_MODE: 0.5,
        mavlink.MAVLINK_MSG_ID_HOME_POSITION: 0.5,
        mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 0.5,
    }
)

# Ours: fewer than PX4 in the loop sends to a ground station, as over a radio.
GROUND_RATES: Mapping[int, float] = MappingProxyType(
    {
        mavlink.MAVLINK_MSG_ID_ATTITUDE: 20.0,
        mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: 10.0,
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 10.0,
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 10.0,
        mavlink.MAVLINK_MSG_ID_VFR_HUD: 4.0,
        mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET: 2.0,
        mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: 2.0,
        mavlink.MAVLINK_MSG_ID_ALTITUDE: 2.0,
        mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 1.0,
        mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 2.0,
        mavlink.MAVLINK_MSG_ID_SYS_STATUS: 2.0,
        mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1.0,
        mavlink.MAVLINK_MSG_ID_CURRENT_MODE: 0.5,
        mavlink.MAVLINK_MSG_ID_HOME_POSITION: 0.5,
        mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 0.5,
    }
)

TRUTH_RATES: Mapping[int, float] = MappingProxyType(
    {
        mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION: 25.0,
        mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1.0,
    }
)
