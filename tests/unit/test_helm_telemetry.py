"""Decoding of what the autopilot says, and the setpoint's fields."""

from __future__ import annotations

import json
import math

import pytest

from onboard.helm.setpoint import LocalSetpoint
from onboard.helm.telemetry import TelemetryDecoder, mode_name

_MS = 1_000_000
ATTITUDE = {
    "time_boot_ms": 1000,
    "q1": 0.7071068,
    "q2": 0.0,
    "q3": 0.0,
    "q4": 0.7071068,
    "rollspeed": 0.1,
    "pitchspeed": 0.2,
    "yawspeed": 0.3,
}
POSITION = {"time_boot_ms": 1000, "x": 1.0, "y": 2.0, "z": -3.0, "vx": 0.1, "vy": 0.2, "vz": 0.3}
HEARTBEAT = {"autopilot": 12, "base_mode": 157, "custom_mode": 0x03040000, "system_status": 4}


def _decoder(*messages: tuple[str, dict]) -> TelemetryDecoder:
    decoder = TelemetryDecoder()
    for name, fields in messages:
        decoder.feed(name, json.dumps(fields), 9_000 * _MS)
    return decoder


@pytest.mark.parametrize(
    ("custom_mode", "name"),
    [
        (0x03040000, "HOLD"),
        (0x00060000, "OFFBOARD"),
        (0x02040000, "TAKEOFF"),
        (0x05040000, "RETURN"),
        (0x06040000, "LAND"),
        (0x00030000, "POSCTL"),
        (0x63040000, "AUTO99"),
        (0, "MODE0"),
    ],
)
def test_mode_names(custom_mode: int, name: str):
    assert mode_name(custom_mode) == name


def test_a_snapshot_is_built_from_its_messages():
    now = _decoder(
        ("ATTITUDE_QUATERNION", ATTITUDE),
        ("LOCAL_POSITION_NED", POSITION),
        ("HEARTBEAT", HEARTBEAT),
        ("HOME_POSITION", {"x": 0.5, "y": 0.0, "z": -0.5}),
        ("EXTENDED_SYS_STATE", {"landed_state": 2}),
        ("SYS_STATUS", {"onboard_control_sensors_health": 1 << 28}),
        ("BATTERY_STATUS", {"battery_remaining": 80}),
    ).now
    assert now.attitude and now.attitude.yaw_rad == pytest.approx(math.pi / 2)
    assert now.ned_p_m() == pytest.approx((0.5, 2.0, -2.5))
    assert (now.mode, now.armed, now.in_air, now.ready, now.battery_fraction) == ("HOLD", True, True, True, 0.8)
    assert now.age_s(9_500 * _MS) == pytest.approx(0.5)
    assert now.estimate_age_s(9_500 * _MS) == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("ATTITUDE_QUATERNION", "{"),
        ("ATTITUDE_QUATERNION", "{}"),
        ("ATTITUDE_QUATERNION", json.dumps({**ATTITUDE, "q1": None})),
        ("ATTITUDE_QUATERNION", json.dumps({**ATTITUDE, "q1": 0.1})),
        ("LOCAL_POSITION_NED", json.dumps({**POSITION, "x": None})),
        ("HEARTBEAT", json.dumps({"autopilot": "twelve"})),
    ],
)
def test_what_cannot_be_read_is_counted_and_ignored(name: str, text: str):
    decoder = TelemetryDecoder()
    before = decoder.now
    assert decoder.feed(name, text, 1) is None
    assert decoder.malformed == 1
    assert decoder.now == before


def test_a_forwarded_ground_station_is_not_the_autopilot():
    assert _decoder(("HEARTBEAT", {**HEARTBEAT, "autopilot": 8})).now.mode == ""


def test_home_does_not_move_in_flight():
    decoder = _decoder(
        ("HOME_POSITION", {"x": 1.0, "y": 0.0, "z": 0.0}),
        ("EXTENDED_SYS_STATE", {"landed_state": 2}),
        ("HOME_POSITION", {"x": 9.0, "y": 0.0, "z": 0.0}),
    )
    assert decoder.now.home_local_m == (1.0, 0.0, 0.0)


def test_an_unknown_landed_state_says_nothing():
    assert not _decoder(("EXTENDED_SYS_STATE", {"landed_state": 0})).now.landed_known


def test_the_setpoint_uses_velocity_altitude_and_heading_rate_only():
    fields = LocalSetpoint(1.0, -2.0, -4.0, 0.1).fields(3, 1, boot_ms=2**40 + 7)
    assert (fields["type_mask"], fields["coordinate_frame"], fields["target_system"]) == (0x5E3, 1, 3)
    assert (fields["vx"], fields["vy"], fields["z"], fields["yaw_rate"]) == (1.0, -2.0, -4.0, 0.1)
    assert fields["time_boot_ms"] < 2**32
    used = {"z": 2, "vx": 3, "vy": 4, "yaw_rate": 11}
    assert all(not fields["type_mask"] >> bit & 1 for bit in used.values())
    assert fields["type_mask"].bit_count() == 7  # the other seven are ignored
