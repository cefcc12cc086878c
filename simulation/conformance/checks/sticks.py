"""Checks of a pilot's sticks (MANUAL_CONTROL) and of the geofence. The sticks come last: their loss is a failsafe."""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import development as mavlink

from simulation.conformance.client import Stream
from simulation.conformance.figures import ALTITUDE_MODE, HOLD, POSITION_MODE
from simulation.conformance.judge import Judge
from simulation.conformance.vehicle import ACCEPTED, Vehicle

_MIDDLE, _HALF = 500, 500
_OUT_OF_FENCE_M = 2.0


def fence(vehicle: Vehicle, judge: Judge) -> None:
    """Beyond GF_MAX_HOR_DIST with GF_ACTION 2 the vehicle holds, whatever is streamed."""
    client = vehicle.client
    n, e, _ = vehicle.ned_p_m
    away_m = math.hypot(n, e)
    north, east = (n / away_m, e / away_m) if away_m > 0.5 else (1.0, 0.0)
    limit_m = math.floor(away_m) + _OUT_OF_FENCE_M
    for name, value in (("GF_ACTION", 2), ("GF_MAX_HOR_DIST", limit_m)):
        judge.truth(name, vehicle.set_param(name, value), vehicle.param(name), f"takes {value:g}")
    client.stream = vehicle.velocity(1.5 * north, 1.5 * east)
    held = vehicle.wait_mode(HOLD, 6.0)
    beyond_m = math.hypot(*vehicle.ned_p_m[:2]) - limit_m
    judge.truth("mode", held, vehicle.mode_name, "HOLD beyond the fence")
    judge.between("distance beyond the fence", beyond_m, -1.0, 2.5, "m")
    client.stream = vehicle.hovering()


def position_sticks(vehicle: Vehicle, judge: Judge) -> None:
    """Position mode: a stick forward flies forward, centred sticks brake and hold the place and the height."""
    _enter(vehicle, judge, POSITION_MODE)
    client = vehicle.client
    yaw = vehicle.yaw_rad
    client.stream = _sticks(vehicle, forward=_HALF)
    client.run(1.8)
    vn, ve, _ = vehicle.ned_v_m_s
    judge.between("speed ahead with half a stick", vn * math.cos(yaw) + ve * math.sin(yaw), 0.7, 6.0, "m/s")
    height_m = -vehicle.ned_p_m[2]
    client.stream = _sticks(vehicle)
    client.run(4.0)
    before = vehicle.ned_p_m
    client.run(1.0)
    judge.near("moved with centred sticks, in 1 s", math.dist(vehicle.ned_p_m, before), 0.0, 0.35, "m")
    judge.near("height kept", -vehicle.ned_p_m[2], height_m, 0.5, "m")


def altitude_sticks(vehicle: Vehicle, judge: Judge) -> None:
    """Altitude mode: a stick tilts the vehicle, the middle of the throttle holds the height."""
    _enter(vehicle, judge, ALTITUDE_MODE)
    client = vehicle.client
    height_m = -vehicle.ned_p_m[2]
    client.stream = _sticks(vehicle, forward=-_HALF)
    start_s = client.now_s
    client.run(1.4)
    pitches = [math.degrees(s.message.pitch) for s in client.since(start_s + 0.9, "ATTITUDE")]
    judge.between("pitch with half a stick back", max(pitches, default=math.nan), 5.0, 25.0, "°")
    client.stream = _sticks(vehicle)
    client.run(1.5)
    judge.near("height kept", -vehicle.ned_p_m[2], height_m, 0.6, "m")


def _enter(vehicle: Vehicle, judge: Judge, mode: int) -> None:
    """Let the sticks in, without a failsafe where they end, and enter a manual mode."""
    client = vehicle.client
    for name, value in (("COM_RC_IN_MODE", 1), ("COM_RCL_EXCEPT", 7)):
        judge.truth(name, vehicle.set_param(name, value, until_landed=True), "written", f"takes {value}")
    client.stream, client.stream_hz = _sticks(vehicle), 25.0
    client.run(0.8)
    judge.equal("mode", [r for _, r in vehicle.set_mode(mode)], [ACCEPTED])
    judge.truth("entered", vehicle.wait_mode(mode, 1.0), vehicle.mode_name, "within 1 s")


def _sticks(vehicle: Vehicle, forward: int = 0, right: int = 0, throttle: int = _MIDDLE) -> Stream:
    """MANUAL_CONTROL, thousandths of full deflection; throttle from 0, its middle at 500."""
    message = mavlink.MAVLink_manual_control_message(vehicle.client.address[0], forward, right, throttle, 0, 0)
    return lambda: message
