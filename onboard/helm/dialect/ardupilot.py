"""ArduPilot's copter: GUIDED, entered at any time; when setpoints stop it stands still and stays in GUIDED.

Written from ArduPilot's documentation and source ("Copter Commands in Guided Mode", GUID_TIMEOUT, ArduCopter's
`mode_guided.cpp`, GCS_MAVLink): see docs/ardupilot.md for what was flown and what was not.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from common.messages import Vec3
from onboard.helm.dialect.base import Command, Dialect, Kind, Role, velocity_target
from onboard.helm.setpoint import LocalSetpoint

VELOCITY = 0x5C7
"""Type mask: use vx, vy, vz and the heading rate. ArduPilot wants all three axes of what is used and takes no held
altitude beside a horizontal velocity, so the height is held by helm's own loop."""
_MODES = {
    0: "STABILIZE",
    1: "ACRO",
    2: "ALT_HOLD",
    3: "AUTO",
    4: "GUIDED",
    5: "LOITER",
    6: "RTL",
    7: "CIRCLE",
    9: "LAND",
    11: "DRIFT",
    13: "SPORT",
    14: "FLIP",
    15: "AUTOTUNE",
    16: "POSHOLD",
    17: "BRAKE",
    18: "THROW",
    19: "AVOID_ADSB",
    20: "GUIDED_NOGPS",
    21: "SMART_RTL",
    22: "FLOWHOLD",
    23: "FOLLOW",
    24: "ZIGZAG",
    25: "SYSTEMID",
    26: "AUTOROTATE",
    27: "AUTO_RTL",
    28: "TURTLE",
}
_NUMBERS = {name: number for number, name in _MODES.items()}
_AHRS = 1 << 21  # MAV_SYS_STATUS_AHRS
_EARTH_RADIUS_M = 6378100.0  # ArduPilot's, so that home comes out where its own local frame has it
_DEG_E7 = math.radians(1e-7)


def _enter(mode: str) -> Command:
    return Command(176, (1.0, float(_NUMBERS[mode])))


class ArduPilot(Dialect):
    """ArduPilot's copter, 4.1 and later."""

    name = "ardupilot"
    title = "ArduPilot"
    autopilot = 3
    control_mode = "GUIDED"
    mode_roles = MappingProxyType(
        {
            "GUIDED": frozenset({Role.CONTROL, Role.TAKEOFF}),
            "LAND": frozenset({Role.LAND}),
            "BRAKE": frozenset({Role.HOLD}),
            "LOITER": frozenset({Role.HOLD}),
            "POSHOLD": frozenset({Role.HOLD}),
            "RTL": frozenset({Role.RETURN}),
            "SMART_RTL": frozenset({Role.RETURN}),
        }
    )
    on_silence = "the autopilot stopped the vehicle and stands in GUIDED"
    silence_parameter = "GUID_TIMEOUT"
    # FS_EKF_ACTION 1 is LAND: without a position GUIDED cannot go on.
    parameters = MappingProxyType({"GUID_TIMEOUT": 1.0, "FS_EKF_ACTION": 1})
    parameter_titles = MappingProxyType(
        {"GUID_TIMEOUT": "guided setpoint timeout", "FS_EKF_ACTION": "estimator failsafe action"}
    )
    messages = (*Dialect.messages, "GPS_GLOBAL_ORIGIN")
    # It streams nothing of this unasked. The mode comes with the heartbeat: 5 Hz instead of 1. HIGHRES_IMU, 105, is
    # refused before 4.6 and where the board has no more than 1 MB: then there are no accelerations.
    rates_hz = (
        (0, 5.0),
        (31, 50.0),
        (32, 30.0),
        (105, 50.0),
        (245, 5.0),
        (1, 5.0),
        (147, 1.0),
        (242, 1.0),
        (49, 1.0),
    )

    def mode_name(self, custom_mode: int) -> str:
        """The copter's mode number."""
        return _MODES.get(custom_mode, f"MODE{custom_mode}")

    def commands(self, kind: Kind, mode: str, height_m: float) -> tuple[Command, ...]:
        """Arming and takeoff happen in GUIDED: a takeoff in another mode would be flown in that mode.

        HOLD is BRAKE: LOITER and POSHOLD obey the throttle stick, which is at the bottom where nobody holds one.
        """
        guided = _enter("GUIDED")
        table = {
            Kind.ARM: (guided, Command(400, (1.0,))),
            Kind.DISARM: (Command(400, (0.0,)),),
            Kind.TAKEOFF: (guided, Command(22, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, height_m))),
            Kind.LAND: (_enter("LAND"),),
            Kind.HOLD: (_enter("BRAKE"),),
            Kind.CONTROL: (guided,),
        }
        return table[kind] if kind in table else super().commands(kind, mode, height_m)

    def setpoint(self, setpoint: LocalSetpoint) -> dict[str, Any]:
        """Velocity in all three axes; the vertical one closes helm's height loop.

        An acceleration goes out as the velocity that it leads to: beside one, ArduPilot holds no height.
        """
        return velocity_target(VELOCITY, setpoint, vz=setpoint.down_m_s)

    def ready(self, sys_status: Mapping[str, Any]) -> bool:
        """The pre-arm checks pass and the attitude and heading reference is healthy."""
        return super().ready(sys_status) and bool(int(sys_status["onboard_control_sensors_health"]) & _AHRS)

    def home_local_m(self, home: Mapping[str, Any], origin: Mapping[str, Any] | None) -> Vec3 | None:
        """From latitude and longitude of home and of the local origin: its HOME_POSITION leaves x, y and z zero."""
        if origin is None:
            return None
        north = (int(home["latitude"]) - int(origin["latitude"])) * _DEG_E7 * _EARTH_RADIUS_M
        middle = (int(home["latitude"]) + int(origin["latitude"])) / 2 * _DEG_E7
        east = (int(home["longitude"]) - int(origin["longitude"])) * _DEG_E7 * _EARTH_RADIUS_M * math.cos(middle)
        return (north, east, (int(origin["altitude"]) - int(home["altitude"])) / 1000.0)


ARDUPILOT = ArduPilot()
