"""Checks of what flies below velocity: attitude, body rates and thrust in OFFBOARD."""

from __future__ import annotations

import math
from collections.abc import Sequence

from pymavlink.dialects.v20 import development as mavlink

from simulation.conformance.client import Stream
from simulation.conformance.figures import HOLD, HOVER_THRUST, OFFBOARD
from simulation.conformance.judge import Judge
from simulation.conformance.vehicle import ACCEPTED, Vehicle

_NO_RATES, _NO_ATTITUDE = 7, 128


def attitude(vehicle: Vehicle, judge: Judge) -> None:
    """SET_ATTITUDE_TARGET is ignored outside OFFBOARD, though its stream is enough to enter it; then it flies."""
    client = vehicle.client
    vehicle.set_mode(HOLD)
    vehicle.wait_mode(HOLD, 1.0)
    client.run(0.5)
    roll_rad = math.radians(10.0)
    client.stream, client.stream_hz = _attitude(vehicle, HOVER_THRUST, roll_rad), 50.0
    start_s = client.now_s
    client.run(1.2)
    rolls = [abs(math.degrees(s.message.roll)) for s in client.since(start_s + 0.3, "ATTITUDE")]
    judge.between("roll outside OFFBOARD", max(rolls, default=math.nan), 0.0, 4.0, "°")
    judge.equal("OFFBOARD on that stream", [r for _, r in vehicle.set_mode(OFFBOARD)], [ACCEPTED])
    client.run(1.2)
    rolls = [math.degrees(s.message.roll) for s in client.since(client.now_s - 0.5, "ATTITUDE")]
    judge.near("roll in OFFBOARD", _mean(rolls), 10.0, 1.0, "°")


def thrust(vehicle: Vehicle, judge: Judge) -> None:
    """Thrust is direct: 0.495 hovers, a tenth less sinks after 2 s; body rates show as base_mode 129."""
    client = vehicle.client
    client.stream, client.stream_hz = _attitude(vehicle, HOVER_THRUST), 50.0
    client.run(1.0)
    before = _climb(vehicle)
    judge.near("climb at 0.495", before, 0.0, 0.35, "m/s")
    client.stream = _attitude(vehicle, HOVER_THRUST * 0.9)
    client.run(2.0)
    # 1 m/s with the default drag of PX4's built-in quadrotor; 2 m/s without any
    judge.between("sink 2 s later at 0.446", before - _climb(vehicle), 0.6, 2.1, "m/s")
    system, component = client.address
    rates = mavlink.MAVLink_set_attitude_target_message(
        0, system, component, _NO_ATTITUDE, (1.0, 0.0, 0.0, 0.0), 0.0, 0.0, 0.0, HOVER_THRUST * 1.05
    )
    client.stream = lambda: rates
    client.run(0.1)
    beat = client.await_message("HEARTBEAT", 1.5)
    judge.equal("base_mode with body rates", beat.base_mode if beat else -1, 129)


def _climb(vehicle: Vehicle) -> float:
    client = vehicle.client
    return -_mean([s.message.vz for s in client.since(client.now_s - 0.15, "LOCAL_POSITION_NED")])


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values) if values else math.nan


def _attitude(vehicle: Vehicle, thrust_share: float, roll_rad: float = 0.0) -> Stream:
    """SET_ATTITUDE_TARGET that keeps the heading, for the stream."""
    r, y = 0.5 * roll_rad, 0.5 * vehicle.yaw_rad
    quat = (math.cos(r) * math.cos(y), math.sin(r) * math.cos(y), math.sin(r) * math.sin(y), math.cos(r) * math.sin(y))
    system, component = vehicle.client.address
    message = mavlink.MAVLink_set_attitude_target_message(
        0, system, component, _NO_RATES, quat, 0.0, 0.0, 0.0, thrust_share
    )
    return lambda: message
