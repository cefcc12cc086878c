"""Checks of the OFFBOARD stream: how fast it must be, what follows its loss, and who wins."""

from __future__ import annotations

import math
from collections.abc import Callable

from simulation.conformance.figures import HOLD, LOSS_ACTIONS, MODE_NAMES, OFFBOARD
from simulation.conformance.judge import Judge
from simulation.conformance.vehicle import ACCEPTED, Vehicle

_WATCHED_S = 4.6


def slow_stream(vehicle: Vehicle, judge: Judge) -> None:
    """A stream at 1.1 Hz holds OFFBOARD."""
    modes = _modes_at(vehicle, 1.1)
    judge.equal("modes seen at 1.1 Hz", modes, ["OFFBOARD"])


def too_slow_stream(vehicle: Vehicle, judge: Judge) -> None:
    """A stream at 0.9 Hz flaps in and out of the failsafe."""
    modes = _modes_at(vehicle, 0.9)
    judge.truth("modes seen at 0.9 Hz", modes.count("OFFBOARD") >= 2 and "HOLD" in modes, modes, "in and out of HOLD")


def _modes_at(vehicle: Vehicle, hz: float) -> list[str]:
    """Modes seen, in order, while the stream runs at a rate; the failsafe is HOLD."""
    client = vehicle.client
    vehicle.set_param("COM_OBL_RC_ACT", 5)
    client.stream, client.stream_hz = vehicle.hovering(), hz
    start_s = client.now_s
    client.run(_WATCHED_S)
    client.stream, client.stream_hz = vehicle.hovering(), 20.0
    modes: list[str] = []
    for seen in client.since(start_s, "CURRENT_MODE"):
        name = MODE_NAMES.get(seen.message.custom_mode, hex(seen.message.custom_mode))
        if not modes or modes[-1] != name:
            modes.append(name)
    return modes


def loss(action: int) -> Callable[[Vehicle, Judge], None]:
    """The check of one COM_OBL_RC_ACT."""

    def check(vehicle: Vehicle, judge: Judge) -> None:
        client = vehicle.client
        judge.truth(
            f"COM_OBL_RC_ACT {action}", vehicle.set_param("COM_OBL_RC_ACT", action), "written", "takes the value"
        )
        loss_s = vehicle.param("COM_OF_LOSS_T") or math.nan
        client.stream = vehicle.hovering()
        client.run(0.3)
        client.stream = None
        lost_s = client.now_s
        left = client.run(loss_s + 1.5, lambda: vehicle.mode != OFFBOARD)
        judge.equal("mode after the loss", vehicle.mode_name if left else "OFFBOARD", MODE_NAMES[LOSS_ACTIONS[action]])
        judge.near("after", client.now_s - lost_s, loss_s, 0.25, "s")
        failsafe = client.run(1.3, lambda: vehicle.field("HEARTBEAT", "system_status") == 5)
        judge.truth("system_status", failsafe, vehicle.field("HEARTBEAT", "system_status"), "5 (failsafe)")
        client.stream = vehicle.hovering()
        resumed_s = client.now_s
        back = client.run(2.5, lambda: vehicle.mode == OFFBOARD)
        took_s = client.now_s - resumed_s if back else math.inf
        judge.between("OFFBOARD by itself, after the stream resumes", took_s, 0.0, 0.85, "s")

    name = MODE_NAMES[LOSS_ACTIONS[action]]
    check.__doc__ = f"COM_OBL_RC_ACT {action}: {name} after COM_OF_LOSS_T; OFFBOARD again by itself within 0.8 s."
    return check


def yielding(vehicle: Vehicle, judge: Judge) -> None:
    """HOLD commanded by a ground station wins, although the stream goes on; OFFBOARD comes back on command alone."""
    client = vehicle.client
    client.station_beats = True
    client.stream = vehicle.velocity(0.5, 0.0)
    client.run(1.2)
    judge.equal("HOLD", [r for _, r in vehicle.set_mode(HOLD, station=True)], [ACCEPTED])
    judge.truth("entered", vehicle.wait_mode(HOLD, 1.0), vehicle.mode_name, "HOLD within 1 s")
    start_s = client.now_s
    client.run(2.5)
    modes = {MODE_NAMES.get(s.message.custom_mode) for s in client.since(start_s, "CURRENT_MODE", "HEARTBEAT")}
    judge.equal("modes while the stream goes on", modes, {"HOLD"})
    judge.between("speed in HOLD", math.hypot(*vehicle.ned_v_m_s[:2]), 0.0, 0.3, "m/s")
    judge.equal("OFFBOARD again", [r for _, r in vehicle.set_mode(OFFBOARD)], [ACCEPTED])


def mode_latency(vehicle: Vehicle, judge: Judge) -> None:
    """A client with the default rates sees a mode late: HEARTBEAT 1 Hz, CURRENT_MODE 0.5 Hz."""
    client = vehicle.client
    vehicle.watch_closely(False)
    client.run(0.5)
    acks = vehicle.set_mode(HOLD)
    seen = vehicle.wait_mode(HOLD, 2.5)
    late_s = client.now_s - acks[0][0] if acks and seen else math.inf
    judge.between("mode seen after the acknowledgement", late_s, 0.0, 1.2, "s")
    vehicle.watch_closely(True)
    vehicle.set_mode(OFFBOARD)
