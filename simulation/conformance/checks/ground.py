"""Checks that leave the vehicle on the ground: messages, parameters, arming and refusals."""

from __future__ import annotations

import math
from collections import Counter

from pymavlink.dialects.v20 import development as mavlink

from simulation.conformance.figures import HOLD, LAND, OFFBOARD, RATES_HZ
from simulation.conformance.judge import Judge
from simulation.conformance.vehicle import ACCEPTED, ARM, REJECTED, REQUEST_MESSAGE, Vehicle, decode, encode

_RATE_TIME_S = 4.0
_HOME_POSITION = 242


def connect(vehicle: Vehicle, judge: Judge) -> None:
    """HEARTBEAT of a disarmed quadrotor with PX4: type, autopilot, modes, system status."""
    client = vehicle.client
    client.run(12.0, lambda: vehicle.ready)
    if vehicle.mode != HOLD:
        vehicle.set_mode(HOLD)
    beat = client.await_message("HEARTBEAT", 2.5)
    if not judge.truth("heartbeat", beat is not None, "heard" if beat else "none", "within 2.5 s"):
        return
    judge.equal("type", beat.type, 2)
    judge.equal("autopilot", beat.autopilot, 12)
    judge.equal("base_mode disarmed, automatic", beat.base_mode, 29)
    judge.equal("custom_mode", hex(beat.custom_mode), hex(HOLD))
    judge.equal("system_status", beat.system_status, 3)
    judge.equal("MAVLink version", 2 if beat.get_msgbuf()[0] == 0xFD else 1, 2)


def rates(vehicle: Vehicle, judge: Judge) -> None:
    """Messages of the companion's link come at PX4's rates, in the autopilot's seconds."""
    client = vehicle.client
    client.run(1.0)
    start_s = client.now_s
    client.run(_RATE_TIME_S)
    counts = Counter(s.message.get_type() for s in client.since(start_s))
    for name, hz in RATES_HZ.items():
        # 12 % for the clock and the machine; two messages for what is rare
        judge.near(name, counts[name] / _RATE_TIME_S, hz, max(0.12 * hz, 1.6 / _RATE_TIME_S), "Hz")


def health(vehicle: Vehicle, judge: Judge) -> None:
    """Readiness is bit 28 of the SYS_STATUS health, on the ground, with a battery and landed state reported."""
    vehicle.client.latest.pop("SYS_STATUS", None)  # what was heard before does not count
    ready = vehicle.client.run(12.0, lambda: vehicle.ready)
    judge.truth("ready (bit 28)", ready, ready, "set within 12 s")
    judge.equal("landed_state", vehicle.field("EXTENDED_SYS_STATE", "landed_state"), 1)
    judge.between("battery_remaining", vehicle.field("SYS_STATUS", "battery_remaining"), 1, 100, "%")


def home(vehicle: Vehicle, judge: Judge) -> None:
    """HOME_POSITION on request, and the vehicle stands there."""
    client = vehicle.client
    client.run(12.0, lambda: vehicle.ready)
    client.latest.pop("HOME_POSITION", None)
    acks = [result for _, result in client.command(REQUEST_MESSAGE, _HOME_POSITION)]
    judge.equal("acknowledgement", acks, [ACCEPTED])
    client.run(1.0, lambda: "HOME_POSITION" in client.latest)
    north = (vehicle.field("HOME_POSITION", "latitude") - vehicle.field("GLOBAL_POSITION_INT", "lat")) * 0.0111
    up = (vehicle.field("HOME_POSITION", "altitude") - vehicle.field("GLOBAL_POSITION_INT", "alt")) * 1e-3
    judge.near("home north of the vehicle", north, 0.0, 2.0, "m")
    judge.near("home above the vehicle", up, 0.0, 2.0, "m")


def parameters(vehicle: Vehicle, judge: Judge) -> None:
    """Parameters are typed, read by name, written, refused with a wrong type, and listed whole."""
    client = vehicle.client
    for name, wire_type in (("COM_OBL_RC_ACT", 6), ("COM_OF_LOSS_T", 9), ("MIS_TAKEOFF_ALT", 9), ("MAV_SYS_ID", 6)):
        answer = client.param_read(name)
        judge.equal(f"{name} type", answer and answer.param_type, wire_type)
    before = vehicle.param("MIS_TAKEOFF_ALT")
    if before is None:
        return
    wanted = before + 0.5
    judge.truth("MIS_TAKEOFF_ALT written", vehicle.set_param("MIS_TAKEOFF_ALT", wanted), "answered", f"{wanted:g} m")
    judge.near("read back", vehicle.param("MIS_TAKEOFF_ALT") or math.nan, wanted, 1e-4, "m")
    answer = client.param_write("MIS_TAKEOFF_ALT", encode(7, 6), 6)
    judge.near("INT32 written to a REAL32", decode(answer) if answer else math.nan, wanted, 1e-4, "m")
    judge.equal("restored", vehicle.restore_params(), [])
    start_s = client.now_s
    client.send(mavlink.MAVLink_param_request_list_message(*client.address))

    def listed() -> set[str]:
        return {s.message.param_id for s in client.since(start_s, "PARAM_VALUE")}

    client.run(1.0, lambda: bool(listed()))
    count = vehicle.field("PARAM_VALUE", "param_count", 0)
    client.run(30.0, lambda: client.now_s > client.latest["PARAM_VALUE"].t_s + 0.7 if listed() else True)
    judge.truth("listed", len(listed()) >= 0.98 * count > 0, len(listed()), f"{count} parameters")


def return_altitude(vehicle: Vehicle, judge: Judge) -> None:
    """The return's heights are parameters of PX4's names, and can be set."""
    for name, value in (("RTL_RETURN_ALT", 20.0), ("RTL_DESCEND_ALT", 8.0), ("RTL_MIN_DIST", 5.0)):
        judge.truth(name, vehicle.set_param(name, value), vehicle.param(name), f"takes {value:g} m")


def signing(vehicle: Vehicle, judge: Judge) -> None:
    """Signed frames are answered as unsigned ones are; frames that come signed are read."""
    client = vehicle.client
    client.sign(bytes(range(32)))
    answer = client.param_read("COM_OF_LOSS_T")
    judge.truth("signed request", answer is not None, "answered" if answer else "no answer", "answered")
    beat = client.await_message("HEARTBEAT", 2.5)
    signed = bool(beat and beat.get_msgbuf()[2] & 1)
    judge.truth("frames read", beat is not None, "signed" if signed else "unsigned" if beat else "none", "either")


def offboard_refused(vehicle: Vehicle, judge: Judge) -> None:
    """OFFBOARD without a stream is accepted and, 8 ms later, rejected: two acknowledgements of command 176."""
    vehicle.client.stream = None
    vehicle.client.run(1.2)
    acks = vehicle.set_mode(OFFBOARD)
    judge.equal("acknowledgements", [result for _, result in acks], [ACCEPTED, REJECTED])
    if len(acks) == 2:
        judge.between("second after the first", (acks[1][0] - acks[0][0]) * 1e3, 0.0, 60.0, "ms")
    vehicle.client.run(1.2)
    judge.equal("mode", vehicle.mode_name, "HOLD")


def arming(vehicle: Vehicle, judge: Judge) -> None:
    """Arming and disarming on command, seen in the heartbeat."""
    client = vehicle.client
    client.run(12.0, lambda: vehicle.ready)
    judge.equal("arm", [r for _, r in client.command(ARM, 1.0)], [ACCEPTED])
    judge.truth("armed", client.run(1.5, lambda: vehicle.armed), vehicle.armed, "within 1.5 s")
    judge.equal("base_mode armed, automatic", vehicle.field("HEARTBEAT", "base_mode"), 157)
    judge.equal("system_status armed", vehicle.field("HEARTBEAT", "system_status"), 4)
    judge.equal("disarm", [r for _, r in client.command(ARM, 0.0)], [ACCEPTED])
    judge.truth("disarmed", client.run(1.5, lambda: not vehicle.armed), not vehicle.armed, "within 1.5 s")


def refusal_texts(vehicle: Vehicle, judge: Judge) -> None:
    """Arming in LAND is refused; why is told as STATUSTEXT, only where a ground station's heartbeat is heard."""
    client = vehicle.client
    vehicle.set_mode(LAND)
    client.run(1.3)
    for station in (False, True):
        client.station_beats = station
        client.run(2.1)  # two heartbeats
        start_s = client.now_s
        judge.equal("arming in LAND", [r for _, r in client.command(ARM, 1.0, settle_s=0.7)], [REJECTED])
        texts = [s.message.text for s in client.since(start_s, "STATUSTEXT")]
        if station:
            said = any("denied" in text.lower() or "preflight fail" in text.lower() for text in texts)
            judge.truth("text with a ground station", said, texts or "none", "a text with 'denied'")
        else:
            judge.truth("text without a ground station", not texts, texts or "none", "none")
    client.station_beats = False
    client.run(1.1)
    judge.equal("back to HOLD", [r for _, r in vehicle.set_mode(HOLD)], [ACCEPTED])
