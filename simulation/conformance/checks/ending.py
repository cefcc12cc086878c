"""Checks that end a flight or the autopilot's run: landing, and a reboot on the ground."""

from __future__ import annotations

import math
from itertools import pairwise

from simulation.conformance.client import Client
from simulation.conformance.figures import READY_S, START_ORDER_S
from simulation.conformance.judge import Judge
from simulation.conformance.vehicle import ACCEPTED, Vehicle

_REBOOT = 246
_DOWN_S = 40.0


def land(vehicle: Vehicle, judge: Judge) -> None:
    """A landing touches down and disarms by itself after COM_DISARM_LAND."""
    wait_s = vehicle.param("COM_DISARM_LAND") or math.nan
    landing = vehicle.client.now_s
    touched_s = vehicle.land()
    judge.between("time to touch down", vehicle.client.now_s - touched_s - landing, 3.0, 30.0, "s")
    judge.between("motors stop after", touched_s, wait_s - 0.6, wait_s + 1.6, "s")
    judge.truth("disarmed", not vehicle.armed, "armed" if vehicle.armed else "disarmed", "disarmed")


def reboot(vehicle: Vehicle, judge: Judge) -> None:
    """The autopilot reboots on command 246: silence, its clock starts again, messages in order, parameters kept."""
    client = vehicle.client
    vehicle.watch_closely(False)
    kept = (vehicle.param("MIS_TAKEOFF_ALT") or 2.5) + 0.75
    judge.truth("parameter before", vehicle.set_param("MIS_TAKEOFF_ALT", kept), "written", f"{kept:g} m")
    acks = client.command(_REBOOT, 1.0)
    if not judge.equal("acknowledgement", [r for _, r in acks], [ACCEPTED]):
        return
    start_s = acks[0][0]
    was_us = vehicle.field("HIGHRES_IMU", "time_usec")
    restarted = client.run(_DOWN_S, lambda: vehicle.field("HIGHRES_IMU", "time_usec") < was_us)
    if not judge.truth("clock", restarted, "starts again" if restarted else "goes on", "starts again"):
        return
    client.latest.clear()
    asked_s = client.now_s
    up = client.run(_DOWN_S, lambda: _all_heard(client, asked_s))
    judge.truth("all messages again", up, "heard" if up else _missing(client), f"within {_DOWN_S:.0f} s")
    if not up:
        return
    _judge_start(client, judge, start_s)
    ready = client.run(12.0, lambda: vehicle.ready)
    zero_s = _zero_s(client)
    judge.between("ready to arm", client.now_s - zero_s if ready else math.inf, *READY_S, "s")
    judge.near("parameter kept", vehicle.param("MIS_TAKEOFF_ALT") or math.nan, kept, 1e-4, "m")


def _zero_s(client: Client) -> float:
    """When the autopilot's clock was zero, on ours, s."""
    attitude = client.latest["ATTITUDE"]
    return attitude.t_s - attitude.message.time_boot_ms * 1e-3


def _all_heard(client: Client, since_s: float) -> bool:
    return all(name in client.latest and client.latest[name].t_s > since_s for name in START_ORDER_S)


def _missing(client: Client) -> str:
    return "without " + ", ".join(name for name in START_ORDER_S if name not in client.latest)


def _judge_start(client: Client, judge: Judge, start_s: float) -> None:
    """Silence, and order of the messages after a restart."""
    times = [s.t_s for s in client.since(start_s)]
    silence_s, resumed_s = max(((b - a, b) for a, b in pairwise(times)), default=(0.0, start_s))
    judge.between("silence", silence_s, 0.15, _DOWN_S, "s")
    zero_s = _zero_s(client)
    first = {name: client.since(resumed_s, name)[0].t_s - zero_s for name in START_ORDER_S}
    for name, expected_s in START_ORDER_S.items():
        judge.near(f"first {name}", first[name], expected_s, 0.7, "s")
    order = sorted(("HIGHRES_IMU", "HEARTBEAT", "ATTITUDE", "GLOBAL_POSITION_INT"), key=lambda n: first[n])
    judge.equal("order", order, ["HIGHRES_IMU", "HEARTBEAT", "ATTITUDE", "GLOBAL_POSITION_INT"])
