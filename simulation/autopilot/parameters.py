"""The autopilot's parameters under their PX4 names, and how they travel in MAVLink."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from types import MappingProxyType

Value = int | float

TYPE_INT32 = 6  # MAV_PARAM_TYPE
TYPE_REAL32 = 9

# Whole numbers are INT32 parameters, the others REAL32; names, units and defaults are PX4's.
DEFAULTS: Mapping[str, Value] = MappingProxyType(
    {
        "BAT1_N_CELLS": 4,
        "BAT_CRIT_THR": 0.07,
        "BAT_EMERGEN_THR": 0.05,
        "BAT_LOW_THR": 0.15,
        "CAL_ACC0_ID": 1310988,
        "CAL_GYRO0_ID": 1310988,
        "CAL_MAG0_ID": 197388,
        "COM_DISARM_LAND": 2.0,  # s on the ground after a flight
        "COM_DISARM_PRFLT": 10.0,  # s armed without taking off
        "COM_DLL_EXCEPT": 0,  # bits: 2 automatic modes, 4 OFFBOARD do without a ground station
        "COM_DL_LOSS_T": 10.0,  # s without a ground station's heartbeat
        "COM_FAIL_ACT_T": 5.0,  # s of HOLD before most failsafes act
        "COM_LOW_BAT_ACT": 0,  # 0 warn, 2 land, 3 return and at the emergency level land
        "COM_OBL_RC_ACT": 0,  # lost OFFBOARD stream: 0 Position (return without sticks), 3 return, 4 land, 5 hold
        "COM_OF_LOSS_T": 1.0,  # s without a setpoint that count as a loss
        "COM_RCL_EXCEPT": 0,  # bits: 2 automatic modes, 4 OFFBOARD do without sticks
        "COM_RC_IN_MODE": 3,  # 0 and 4: a joystick (MANUAL_CONTROL) is ignored
        "COM_RC_LOSS_T": 0.5,  # s without MANUAL_CONTROL
        "COM_RC_OVERRIDE": 1,  # bits: moving the sticks takes over from 1 automatic modes, 2 OFFBOARD
        "COM_RC_STICK_OV": 30.0,  # percent, how much movement that takes
        "COM_SPOOLUP_TIME": 1.0,  # s from arming to lift
        "EKF2_NOAID_TOUT": 5_000_000,  # µs without GNSS that the position stays valid
        "GF_ACTION": 2,  # 0 nothing, 1 warn, 2 hold, 3 return, 4 terminate, 5 land
        "GF_MAX_HOR_DIST": 0.0,  # m from home, 0: no fence
        "GF_MAX_VER_DIST": 0.0,  # m above home, 0: no fence
        "MAV_COMP_ID": 1,
        "MAV_SYS_ID": 1,
        "MAV_TYPE": 2,
        "MC_ACRO_P_MAX": 100.0,  # degrees/s
        "MC_ACRO_R_MAX": 100.0,  # degrees/s
        "MC_ACRO_Y_MAX": 100.0,  # degrees/s
        "MIS_TAKEOFF_ALT": 2.5,  # m above home
        "MPC_ACC_HOR": 3.0,  # m/s², automatic modes
        "MPC_HOLD_DZ": 0.1,  # dead zone of the sticks
        "MPC_LAND_ALT1": 10.0,  # m, landing begins to slow down
        "MPC_LAND_ALT2": 5.0,  # m, landing speed is reached
        "MPC_LAND_SPEED": 0.7,  # m/s
        "MPC_MANTHR_MIN": 0.08,
        "MPC_MAN_TILT_MAX": 35.0,  # degrees
        "MPC_MAN_Y_MAX": 150.0,  # degrees/s
        "MPC_THR_HOVER": 0.495,
        "MPC_TILTMAX_AIR": 45.0,  # degrees
        "MPC_TKO_RAMP_T": 3.0,  # s
        "MPC_TKO_SPEED": 1.5,  # m/s
        "MPC_VEL_MANUAL": 10.0,  # m/s, full stick in Position mode
        "MPC_XY_CRUISE": 5.0,  # m/s, automatic modes
        "MPC_XY_MAN_EXPO": 0.6,
        "MPC_XY_VEL_MAX": 12.0,  # m/s
        "MPC_Z_VEL_MAX_DN": 1.5,  # m/s
        "MPC_Z_VEL_MAX_UP": 3.0,  # m/s
        "MPC_Z_V_AUTO_DN": 1.5,  # m/s
        "MPC_Z_V_AUTO_UP": 3.0,  # m/s
        "NAV_DLL_ACT": 0,  # loss of the ground station: 0 nothing, 1 hold, 2 return, 3 land, 5 terminate, 6 disarm
        "NAV_RCL_ACT": 2,  # loss of the sticks, the same numbers
        "RTL_CONE_ANG": 45,  # degrees, half angle: near home it climbs less
        "RTL_DESCEND_ALT": 30.0,  # m above home
        "RTL_MIN_DIST": 10.0,  # m
        "RTL_RETURN_ALT": 60.0,  # m above home
        "SYS_AUTOSTART": 10040,
        "SYS_FAILURE_EN": 0,  # 1: MAV_CMD_INJECT_FAILURE is obeyed
    }
)


class Parameters:
    """Values by name; `revision` grows with each change.

    Args:
        overrides: values that differ from `DEFAULTS`.
    """

    def __init__(self, overrides: Mapping[str, Value]):
        self._values = dict(DEFAULTS)
        self.revision = 0
        for name, value in overrides.items():
            self.set(name, value)

    @property
    def names(self) -> list[str]:
        """All names; the place of a name is its index in MAVLink."""
        return list(self._values)

    def __getitem__(self, name: str) -> Value:
        return self._values[name]

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def set(self, name: str, value: Value) -> None:
        """Change a value, keeping its kind.

        Raises:
            KeyError: unknown name.
            ValueError: not a finite number.
        """
        if not math.isfinite(value):
            raise ValueError(f"{name}: got {value}, expected a finite number")
        self._values[name] = int(value) if isinstance(self._values[name], int) else float(value)
        self.revision += 1

    def wire_type(self, name: str) -> int:
        """MAV_PARAM_TYPE of a parameter."""
        return TYPE_INT32 if isinstance(self._values[name], int) else TYPE_REAL32


def to_wire(value: Value) -> float:
    """The float that carries a value in MAVLink: whole numbers are cast bit by bit."""
    return struct.unpack("<f", struct.pack("<i", value))[0] if isinstance(value, int) else value


def from_wire(raw: float, wire_type: int) -> Value:
    """The value in a float off the wire, by its MAV_PARAM_TYPE."""
    return struct.unpack("<i", struct.pack("<f", raw))[0] if wire_type == TYPE_INT32 else raw
