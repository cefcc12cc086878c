"""Decoding of what the autopilot says."""

from __future__ import annotations

import json
import math

import pytest

from onboard.helm.dialect.ardupilot import ARDUPILOT
from onboard.helm.dialect.base import Dialect
from onboard.helm.dialect.px4 import PX4
from onboard.helm.telemetry import TelemetryDecoder

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
IMU = {"time_usec": 1_000_000, "xacc": 0.1, "yacc": -0.2, "zacc": -9.8, "xgyro": 0.0, "fields_updated": 0x1FFF}
HEARTBEAT = {"autopilot": 12, "base_mode": 157, "custom_mode": 0x03040000, "system_status": 4}


def _decoder(*messages: tuple[str, dict], dialect: Dialect = PX4) -> TelemetryDecoder:
    decoder = TelemetryDecoder(dialect)
    for name, fields in messages:
        decoder.feed(name, json.dumps(fields), 9_000 * _MS)
    return decoder


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
        ("HIGHRES_IMU", json.dumps({**IMU, "yacc": None})),
        ("HEARTBEAT", json.dumps({"autopilot": "twelve"})),
    ],
)
def test_what_cannot_be_read_is_counted_and_ignored(name: str, text: str):
    decoder = TelemetryDecoder()
    before = decoder.now
    assert decoder.feed(name, text, 1) is None
    assert decoder.malformed == 1
    assert decoder.now == before


def test_an_attitude_comes_with_the_newest_accelerometers_while_they_are_told():
    decoder = _decoder(("ATTITUDE_QUATERNION", ATTITUDE))
    assert decoder.now.attitude and decoder.now.attitude.body_f_m_s2 is None
    decoder.feed("HIGHRES_IMU", json.dumps(IMU), 9_000 * _MS)
    for later_ms, expected in ((20, (0.1, -0.2, -9.8)), (200, None)):
        sample = decoder.feed("ATTITUDE_QUATERNION", json.dumps(ATTITUDE), (9_000 + later_ms) * _MS)
        assert sample and sample.body_f_m_s2 == expected


def test_accelerometers_that_are_not_told_anew_are_not_believed():
    decoder = _decoder(("HIGHRES_IMU", {**IMU, "xacc": 0.0, "yacc": 0.0, "zacc": 0.0, "fields_updated": 0x1FF8}))
    sample = decoder.feed("ATTITUDE_QUATERNION", json.dumps(ATTITUDE), 9_000 * _MS)
    assert sample and sample.body_f_m_s2 is None


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


def test_a_second_battery_is_not_the_one_that_flies():
    now = _decoder(
        ("BATTERY_STATUS", {"id": 0, "battery_remaining": 80}), ("BATTERY_STATUS", {"id": 1, "battery_remaining": 5})
    ).now
    assert now.battery_fraction == 0.8


def test_home_comes_from_latitude_and_longitude_where_the_autopilot_gives_no_local_place():
    """ArduPilot leaves x, y and z of HOME_POSITION zero; the answer does not depend on which message comes first."""
    home = {"latitude": 473977420 + 90, "longitude": 85455940 - 90, "altitude": 488_500, "x": 0.0, "y": 0.0, "z": 0.0}
    origin = {"latitude": 473977420, "longitude": 85455940, "altitude": 488_000}
    messages = (("HOME_POSITION", home), ("GPS_GLOBAL_ORIGIN", origin))
    assert _decoder(messages[0], dialect=ARDUPILOT).now.home_local_m is None
    for order in (messages, messages[::-1]):
        now = _decoder(*order, dialect=ARDUPILOT).now
        assert now.home_local_m == pytest.approx((1.00, -0.68, -0.5), abs=0.01)
