"""PX4: OFFBOARD, entered while setpoints already stream; it leaves by itself when they stop.

Figures and behaviour as measured on PX4 1.17 in the loop.
"""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import Any

from onboard.helm.dialect.base import Command, Dialect, Kind, Role, velocity_target
from onboard.helm.setpoint import AccelerationSetpoint, LocalSetpoint, position_target

VELOCITY_WITH_ALTITUDE = 0x5E3
"""Type mask: use z, vx, vy and the heading rate; ignore x, y, vz, accelerations and heading. PX4 held the altitude
within 0.25 m with it, against 0.5 m of drift and more with a velocity in all three axes."""
ACCELERATION_WITH_ALTITUDE = 0x53B
"""Type mask: use z, afx, afy and the heading rate. PX4 held the altitude within 0.1 m with it: tilt without mixing
setpoint kinds."""
_AUTO = 4
_MAIN_MODES = {1: "MANUAL", 2: "ALTCTL", 3: "POSCTL", 5: "ACRO", 6: "OFFBOARD", 7: "STABILIZED"}
_AUTO_MODES = {1: "READY", 2: "TAKEOFF", 3: "HOLD", 4: "MISSION", 5: "RETURN", 6: "LAND", 8: "FOLLOW", 9: "PRECLAND"}
_NOT_ARMABLE = ("MISSION", "RETURN")
_HOLD = Command(176, (1.0, _AUTO, 3.0))
_NAN = math.nan
_COMMANDS = {
    Kind.ARM: Command(400, (1.0,)),
    Kind.DISARM: Command(400, (0.0,)),
    # Not given: the height is MIS_TAKEOFF_ALT, the place is here.
    Kind.TAKEOFF: Command(22, (_NAN, _NAN, _NAN, _NAN, _NAN, _NAN, _NAN)),
    Kind.LAND: Command(21, (_NAN, _NAN, _NAN, _NAN, _NAN, _NAN, _NAN)),
    Kind.HOLD: _HOLD,
    Kind.CONTROL: Command(176, (1.0, 6.0)),
}


class Px4(Dialect):
    """PX4's multicopter."""

    name = "px4"
    title = "PX4"
    autopilot = 12
    control_mode = "OFFBOARD"
    mode_roles = MappingProxyType(
        {
            "OFFBOARD": frozenset({Role.CONTROL}),
            "TAKEOFF": frozenset({Role.TAKEOFF}),
            "LAND": frozenset({Role.LAND}),
            "HOLD": frozenset({Role.HOLD}),
            "RETURN": frozenset({Role.RETURN}),
        }
    )
    after_takeoff = frozenset({Role.TAKEOFF, Role.HOLD})
    after_silence = frozenset({Role.HOLD, Role.RETURN, Role.LAND})
    on_silence = "the autopilot's failsafe has taken over"
    silence_parameter = "COM_OF_LOSS_T"
    takeoff_parameter = "MIS_TAKEOFF_ALT"
    # COM_OBL_RC_ACT 5 is HOLD: PX4's own default returned home after a hang.
    parameters = MappingProxyType(
        {"COM_OF_LOSS_T": 1.0, "COM_OBL_RC_ACT": 5, "RTL_RETURN_ALT": 8.0, "MIS_TAKEOFF_ALT": 4.0}
    )
    parameter_titles = MappingProxyType(
        {
            "COM_OF_LOSS_T": "offboard loss time",
            "COM_OBL_RC_ACT": "offboard loss action",
            "RTL_RETURN_ALT": "return altitude",
        }
    )
    height_gain_1_s = 1.0  # MPC_Z_P
    rates_hz = ((31, 50.0), (32, 30.0), (436, 5.0), (245, 5.0))

    def mode_name(self, custom_mode: int) -> str:
        """Main mode in bits 16-23, sub mode in bits 24-31."""
        main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
        if main == _AUTO:
            return _AUTO_MODES.get(sub, f"AUTO{sub}")
        return _MAIN_MODES.get(main, f"MODE{main}")

    def commands(self, kind: Kind, mode: str, height_m: float) -> tuple[Command, ...]:
        """One command each; a vehicle that stands in a mode that cannot be armed is put into HOLD first."""
        if kind not in _COMMANDS:
            return super().commands(kind, mode, height_m)
        first = (_HOLD,) if kind is Kind.ARM and mode in _NOT_ARMABLE else ()
        return (*first, _COMMANDS[kind])

    def setpoint(self, setpoint: LocalSetpoint) -> dict[str, Any]:
        """Horizontal velocity or acceleration; the altitude is PX4's to hold."""
        if isinstance(setpoint, AccelerationSetpoint):
            return position_target(
                ACCELERATION_WITH_ALTITUDE,
                z=setpoint.local_z_m,
                afx=setpoint.north_m_s2,
                afy=setpoint.east_m_s2,
                yaw_rate=setpoint.yaw_rate_rad_s,
            )
        return velocity_target(VELOCITY_WITH_ALTITUDE, setpoint, z=setpoint.local_z_m)


PX4 = Px4()
