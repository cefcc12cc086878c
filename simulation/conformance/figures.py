"""What PX4 does: measured on PX4 main of March 2026 in the loop with its built-in quadrotor.

The checks compare with these; docs/conformance.md tells how.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from simulation.px4_steps import STEPS, times_s

OFFBOARD = 6 << 16
TAKEOFF, HOLD, RETURN, LAND = (4 << 16 | sub << 24 for sub in (2, 3, 5, 6))
POSITION_MODE, ALTITUDE_MODE = 3 << 16, 2 << 16
MODE_NAMES: Mapping[int, str] = MappingProxyType(
    {
        OFFBOARD: "OFFBOARD",
        TAKEOFF: "TAKEOFF",
        HOLD: "HOLD",
        RETURN: "RTL",
        LAND: "LAND",
        POSITION_MODE: "POSITION",
        ALTITUDE_MODE: "ALTITUDE",
    }
)

RATES_HZ: Mapping[str, float] = MappingProxyType(
    {
        "ATTITUDE": 100.0,
        "ATTITUDE_QUATERNION": 50.0,
        "GLOBAL_POSITION_INT": 50.0,
        "HIGHRES_IMU": 50.0,
        "LOCAL_POSITION_NED": 30.0,
        "ODOMETRY": 30.0,
        "VFR_HUD": 10.0,
        "ALTITUDE": 10.0,
        "ATTITUDE_TARGET": 10.0,
        "POSITION_TARGET_LOCAL_NED": 10.0,
        "SERVO_OUTPUT_RAW": 10.0,
        "TIMESYNC": 10.0,
        "GPS_RAW_INT": 8.0,
        "EXTENDED_SYS_STATE": 5.0,
        "SYS_STATUS": 5.0,
        "HEARTBEAT": 1.0,
        "CURRENT_MODE": 0.5,
        "HOME_POSITION": 0.5,
        "BATTERY_STATUS": 0.5,
    }
)
"""Rates on the link to the companion computer, Hz."""

START_ORDER_S: Mapping[str, float] = MappingProxyType(
    {
        "HIGHRES_IMU": 0.3,
        "HEARTBEAT": 1.35,
        "ATTITUDE": 1.8,
        "HOME_POSITION": 2.4,
        "BATTERY_STATUS": 2.4,
        "GLOBAL_POSITION_INT": 2.9,
    }
)
"""When a message is first sent after a start, s."""
READY_S = (3.5, 7.5)
"""When it is ready to arm after a start, s: 4.5, sometimes 6.8."""

LOSS_ACTIONS: Mapping[int, int] = MappingProxyType({0: RETURN, 3: RETURN, 4: LAND, 5: HOLD})
"""Mode that follows the loss of the OFFBOARD stream, by COM_OBL_RC_ACT; 0 without a remote control."""


def _range(step: str, name: str) -> tuple[float, float]:
    reading = STEPS[step][name]
    return reading if isinstance(reading, tuple) else (reading, reading)


def _reading(step: str, name: str) -> float:
    return _range(step, name)[0]


class StepResponse(NamedTuple):
    """Response to a horizontal velocity step of 2 m/s and to the stop after it."""

    name: str
    """Which drag."""
    up_s: Mapping[float, float]
    """Seconds until a share of 2 m/s is reached."""
    tilt_deg: float
    """Largest tilt while it speeds up, degrees."""
    speed_2s_m_s: float
    """Speed 2 s after the step, m/s."""
    overshoot: float
    """Share by which 2 m/s is exceeded."""
    down_s: Mapping[float, float]
    """Seconds until a share of the speed is lost."""
    stop_m: tuple[float, float]
    """Way covered after the stop, within 6 s, m: least and most."""


STEP_RESPONSES = (
    StepResponse(
        "SIH default drag (1 N per m/s)",
        times_s("start_default"),
        _reading("start_default", "tilt_deg"),
        _reading("start_default", "speed_2s_m_s"),
        0.0,
        times_s("stop_default"),
        _range("stop_default", "stop_distance_m"),
    ),
    StepResponse(
        "low drag (0.1 N per m/s)",
        times_s("start_low"),
        _reading("start_low", "tilt_deg"),
        2.1,
        sum(_range("start_low", "overshoot_percent")) / 200.0,
        times_s("stop_low"),
        _range("stop_low", "stop_distance_m"),
    ),
)
HOVER_THRUST = 0.495
"""Thrust of SET_ATTITUDE_TARGET that hovers."""
