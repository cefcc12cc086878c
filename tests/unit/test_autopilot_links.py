"""The autopilot's MAVLink conversations over real UDP sockets, in simulated time."""

from __future__ import annotations

import logging
import math
import socket
import struct
import threading
import time
from collections import Counter
from collections.abc import Iterator

import pytest
from pymavlink.dialects.v20 import development as mavlink

from common.config import Config, ConfigError, build
from simulation.autopilot.config import AutopilotSimConfig
from simulation.autopilot.process import Pacer, run
from simulation.autopilot.rates import GROUND_RATES, ONBOARD_RATES
from tests.machine import free_ports
from tests.unit.autopilot_rig import COMPANION, GROUND_STATION, HOST, Rig, settings


@pytest.fixture
def rig() -> Iterator[Rig]:
    rig = Rig()
    yield rig
    rig.close()


def test_messages_appear_in_the_order_of_px4(rig: Rig) -> None:
    rig.run(5.0)
    first: dict[str, float] = {}
    for t_s, message in rig.companion.inbox:
        first.setdefault(message.get_type(), t_s)
    expected = {
        "HIGHRES_IMU": 0.3,
        "HEARTBEAT": 1.35,
        "ATTITUDE": 1.8,
        "HOME_POSITION": 2.4,
        "BATTERY_STATUS": 2.4,
        "GLOBAL_POSITION_INT": 2.9,
    }
    for name, t_s in expected.items():
        assert first[name] == pytest.approx(t_s, abs=0.01), name
    ready = [
        t for t, m in rig.companion.inbox if m.get_type() == "SYS_STATUS" and m.onboard_control_sensors_health & 1 << 28
    ]
    assert ready[0] == pytest.approx(4.5, abs=0.21)
    states = [m.system_status for m in rig.companion.got("HEARTBEAT")]
    assert states[0] == 0 and states[-1] in (0, 3)


def test_rates_on_both_links_and_one_message_a_datagram(rig: Rig) -> None:
    rig.run(5.0)
    for peer in rig.peers:
        peer.inbox.clear()
        peer.datagrams = 0
    rig.run(8.0)
    for peer, rates in ((rig.companion, ONBOARD_RATES), (rig.station, GROUND_RATES)):
        counts = Counter(m.get_msgId() for _, m in peer.inbox)
        for message_id, hz in rates.items():
            assert counts[message_id] / 8.0 == pytest.approx(hz, rel=0.06, abs=0.13), message_id
        assert peer.datagrams == len(peer.inbox)
    assert len(rig.truth.got("HIL_STATE_QUATERNION")) == pytest.approx(200, abs=3)


def test_heartbeat_fields_through_a_flight(rig: Rig) -> None:
    rig.take_off()
    rig.run(1.1)
    beats = rig.companion.got("HEARTBEAT")
    assert {(b.type, b.autopilot) for b in beats} == {(2, 12)}
    assert beats[0].base_mode == 29 and beats[0].custom_mode == 0x03040000
    assert beats[-1].base_mode == 157 and beats[-1].system_status == 4
    rig.companion.setpoint(0x5E3, z=-3.0)
    rig.run(0.1)
    rig.companion.command(176, 1.0, 6.0)
    for _ in range(30):
        rig.companion.setpoint(0x5E3, z=-3.0)
        rig.run(0.05)
    assert rig.companion.got("HEARTBEAT")[-1].base_mode == 145
    rig.run(2.5)
    assert rig.companion.got("HEARTBEAT")[-1].system_status == 5


def test_takeoff_climbs_and_lands_with_acknowledgements_and_states(rig: Rig) -> None:
    rig.take_off()
    assert rig.companion.acks(400) == [0] and rig.companion.acks(22) == [0]
    assert -rig.vehicle.truth.ned_p_m[2] == pytest.approx(2.5, abs=0.3)
    assert {m.landed_state for m in rig.companion.got("EXTENDED_SYS_STATE")} == {1, 2, 3}
    rig.companion.command(400, 0.0)
    rig.companion.command(21)
    rig.run(12.0)
    assert rig.companion.acks(400) == [0, 1], "disarming in the air is refused"
    assert rig.companion.acks(21) == [0]
    assert not rig.vehicle.modes.armed and rig.vehicle.truth.on_ground
    assert {m.landed_state for m in rig.companion.got("EXTENDED_SYS_STATE")} == {1, 2, 3, 4}


def test_offboard_without_a_stream_is_accepted_then_rejected(rig: Rig) -> None:
    rig.run(5.0)
    rig.companion.command(176, 1.0, 6.0)
    rig.run(0.1)
    acks = [(t, m.result) for t, m in rig.companion.inbox if m.get_type() == "COMMAND_ACK"]
    assert [result for _, result in acks] == [0, 1]
    assert acks[1][0] - acks[0][0] == pytest.approx(0.008, abs=0.005)


@pytest.mark.parametrize(
    ("mask", "frame", "fields", "expected"),
    [
        (0x9C7, 1, {"vx": 1.0, "vy": -0.5, "yaw": 0.0}, (1.0, -0.5)),
        (0x5C7, 8, {"vx": 1.0}, (1.0, 0.0)),
        (0x5E3, 1, {"vx": -1.0, "vy": 0.5, "z": -3.0}, (-1.0, 0.5)),
        (0xDC7, 1, {"vx": 1.0, "x": math.nan, "yaw": math.nan}, (1.0, 0.0)),
    ],
)
def test_velocity_setpoints_by_type_mask(
    rig: Rig, mask: int, frame: int, fields: dict[str, float], expected: tuple[float, float]
) -> None:
    rig.take_off()
    for index in range(80):
        rig.companion.setpoint(mask, frame, **fields)
        if index == 2:
            rig.companion.command(176, 1.0, 6.0)
        rig.run(0.05)
    assert rig.vehicle.truth.ned_v_m_s[:2] == pytest.approx(expected, abs=0.2)


def test_acceleration_and_position_setpoints_by_type_mask(rig: Rig) -> None:
    rig.take_off()
    for index in range(44):
        rig.companion.setpoint(0x53B, afx=1.0, z=-3.0)
        if index == 2:
            rig.companion.command(176, 1.0, 6.0)
        rig.run(0.05)
    assert rig.vehicle.truth.ned_v_m_s[0] == pytest.approx(1.8, abs=0.4)
    for _ in range(240):
        rig.companion.setpoint(0x9F8, x=1.0, y=2.0, z=-4.0)
        rig.run(0.05)
    assert rig.vehicle.truth.ned_p_m == pytest.approx((1.0, 2.0, -4.0), abs=0.4)


@pytest.mark.parametrize(
    ("mask", "frame", "fields", "reason"),
    [
        (0x5E3, 1, {"vx": math.inf, "z": -3.0}, "infinite"),
        (0x5E3, 1, {"vx": math.nan, "z": -3.0}, "incomplete"),
        (0xFFF, 1, {}, "force"),
        (0xDFF, 1, {}, "incomplete"),
        (0x5E3, 3, {}, "frame"),
        (0x9F8, 8, {}, "frame"),
    ],
)
def test_bad_setpoints_are_counted_and_are_no_stream(
    rig: Rig, mask: int, frame: int, fields: dict[str, float], reason: str
) -> None:
    rig.run(1.0)
    rig.companion.setpoint(mask, frame, **fields)
    rig.run(0.02)
    assert rig.autopilot.protocol.counters[f"setpoints_{reason}"] == 1
    assert rig.vehicle.situation.stream_age_s == math.inf


def test_hold_from_the_ground_station_wins_over_a_running_stream(rig: Rig) -> None:
    rig.take_off()
    for index in range(100):
        rig.companion.setpoint(0x5E3, vx=1.0, z=-3.0)
        if index == 2:
            rig.companion.command(176, 1.0, 6.0)
        if index == 40:
            rig.station.command(176, 1.0, 4.0, 3.0)
        rig.run(0.05)
    assert rig.station.acks(176) == [0]
    assert rig.vehicle.modes.mode.name == "HOLD" and not rig.vehicle.modes.failsafe
    assert math.hypot(*rig.vehicle.truth.ned_v_m_s[:2]) < 0.3


def test_parameters_are_listed_read_and_set(rig: Rig) -> None:
    rig.run(2.0)
    rig.station.send(mavlink.MAVLink_param_request_list_message(1, 1))
    rig.run(1.0)
    listed = {m.param_id: m for m in rig.station.got("PARAM_VALUE")}
    assert len(listed) == listed["COM_OBL_RC_ACT"].param_count == len(rig.vehicle.parameters.names)
    assert listed["COM_OBL_RC_ACT"].param_type == 6
    cast = struct.unpack("<f", struct.pack("<i", 5))[0]
    rig.companion.send(mavlink.MAVLink_param_set_message(1, 1, b"COM_OBL_RC_ACT", cast, 6))
    rig.companion.send(mavlink.MAVLink_param_set_message(1, 1, b"MIS_TAKEOFF_ALT", math.nan, 9))
    rig.companion.send(mavlink.MAVLink_param_request_read_message(1, 1, b"COM_OF_LOSS_T", -1))
    rig.run(0.1)
    assert rig.vehicle.parameters["COM_OBL_RC_ACT"] == 5
    assert rig.vehicle.parameters["MIS_TAKEOFF_ALT"] == 2.5
    replies = {m.param_id: m.param_value for m in rig.companion.got("PARAM_VALUE")}
    assert struct.pack("<f", replies["COM_OBL_RC_ACT"]) == struct.pack("<i", 5)
    assert replies["COM_OF_LOSS_T"] == 1.0 and replies["MIS_TAKEOFF_ALT"] == 2.5


def test_heartbeats_are_forwarded_and_statustext_goes_to_ground_stations_only(rig: Rig) -> None:
    rig.run(4.6)
    rig.companion.heartbeat()
    rig.station.heartbeat()
    rig.run(0.1)
    rig.companion.command(400, 1.0)
    rig.run(0.1)
    assert [m.get_srcSystem() for m in rig.companion.got("HEARTBEAT") if m.type == GROUND_STATION] == [255]
    assert len([m for m in rig.station.got("HEARTBEAT") if m.type == COMPANION]) == 1
    assert [m.text for m in rig.station.got("STATUSTEXT")] == ["Armed by external command"]
    assert rig.companion.got("STATUSTEXT") == []


def test_obstacle_distances_reach_the_ground_station_and_bad_ones_do_not(rig: Rig) -> None:
    rig.run(0.5)
    for least_cm, most_cm in ((20, 600), (600, 20)):
        rig.companion.send(
            mavlink.MAVLink_obstacle_distance_message(7, 4, [321] * 72, 5, least_cm, most_cm, 5.0, 1.5, 12)
        )
    rig.run(0.1)
    (message,) = rig.station.got("OBSTACLE_DISTANCE")
    assert list(message.distances) == [321] * 72
    assert (message.min_distance, message.max_distance, message.angle_offset) == (20, 600, 1.5)
    assert not rig.companion.got("OBSTACLE_DISTANCE")
    counters = rig.autopilot.protocol.counters
    assert (counters["obstacle_distances"], counters["obstacle_distances_bad"]) == (1, 1)


def test_a_long_notice_comes_in_numbered_pieces(rig: Rig) -> None:
    rig.run(4.6)
    rig.station.heartbeat()
    rig.station.command(176, 1.0, 6.0)
    rig.run(0.1)
    pieces = rig.station.got("STATUSTEXT")
    assert [m.chunk_seq for m in pieces] == [0, 1] and len({m.id for m in pieces}) == 1 and pieces[0].id > 0
    assert "".join(m.text for m in pieces).endswith("not available: no offboard signal")


def test_truth_port_follows_the_vehicle_at_a_hundred_hertz_with_a_clock_that_stands(rig: Rig) -> None:
    rig.truth.command(511, 115.0, 10_000.0)
    rig.take_off()
    assert rig.truth.acks(511) == [0]
    rig.truth.inbox.clear()
    rig.run(2.0)
    states = rig.truth.got("HIL_STATE_QUATERNION")
    assert len(states) == pytest.approx(200, abs=3)
    assert {s.time_usec for s in states} == {0}
    truth, config = rig.vehicle.truth, rig.vehicle.config
    assert states[-1].alt / 1e3 - config.home_alt_m == pytest.approx(-truth.ned_p_m[2], abs=0.02)
    north_m = math.radians(states[-1].lat / 1e7 - config.home_lat_deg) * 6371000.0
    assert north_m == pytest.approx(truth.ned_p_m[0], abs=0.03)
    assert list(states[-1].attitude_quaternion) == pytest.approx(truth.ned_q_body, abs=1e-3)


def test_requests_missions_timesync_and_unknown_commands_are_answered(rig: Rig) -> None:
    rig.run(1.0)
    peer = rig.companion
    peer.command(512, 242.0)  # there is no home yet
    rig.run(2.0)
    peer.command(512, 148.0)
    peer.command(512, 242.0)
    peer.command(520, 1.0)
    peer.command(511, 30.0, 100_000.0)
    peer.command(510, 30.0)
    peer.command(511, 9999.0, 100_000.0)
    peer.command(31000)
    peer.command(21, target=7)
    peer.send(mavlink.MAVLink_mission_request_list_message(1, 1, 0))
    peer.send(mavlink.MAVLink_timesync_message(0, 1234))
    rig.run(0.1)
    assert peer.acks(512) == [1, 0, 0] and peer.acks(520) == [0]
    assert peer.acks(511) == [0, 2] and peer.acks(31000) == [3]
    assert peer.acks(21) == [], "a command for another system is not ours"
    assert {(m.target_system, m.target_component) for m in peer.got("COMMAND_ACK")} == {(1, 190)}
    assert len(peer.got("AUTOPILOT_VERSION")) == 2
    assert peer.got("MESSAGE_INTERVAL")[-1].interval_us == 100_000
    assert peer.got("MISSION_COUNT")[-1].count == 0
    assert [m.tc1 > 0 for m in peer.got("TIMESYNC") if m.ts1 == 1234] == [True]


def test_garbage_is_counted_and_harms_nothing(rig: Rig) -> None:
    rig.run(0.5)
    for datagram in (b"", b"\x00" * 50, b"\xfd\x09\x00\x00", bytes(range(256)) * 4):
        rig.companion.socket.sendto(datagram, rig.companion.to)
    rig.run(0.1)
    rig.companion.command(519, 1.0)
    rig.run(0.1)
    assert rig.autopilot.links[0].counters["bad"] >= 4
    assert rig.companion.acks(519) == [0]


@pytest.mark.parametrize("ours", [False, True])
def test_frames_may_be_signed_in_either_direction(ours: bool) -> None:
    rig = Rig(sign_frames=ours)
    try:
        rig.companion.mav.signing.secret_key = bytes(range(32))
        rig.companion.mav.signing.sign_outgoing = True
        rig.run(4.6)
        rig.companion.command(400, 1.0)
        rig.run(0.1)
        assert rig.companion.acks(400) == [0] and rig.vehicle.modes.armed, "a signed command is obeyed"
        signed = {bool(m.get_header().incompat_flags & 1) for m in rig.companion.got("ATTITUDE")}
        assert signed == {ours}
        assert rig.autopilot.links[0].counters["bad"] == 0
    finally:
        rig.close()


def test_a_start_is_sometimes_slow_and_repeats_for_a_seed() -> None:
    ready = []
    for seed in (1, 1):
        rig = Rig(slow_start_probability=1.0, seed=seed)
        rig.run(7.0)
        ready.append(next(t for t, m in rig.companion.inbox if getattr(m, "onboard_control_sensors_health", 0) >> 28))
        rig.close()
    assert ready == [pytest.approx(6.8, abs=0.25)] * 2


def test_a_vehicle_without_a_gimbal_has_none_to_offer(rig: Rig) -> None:
    rig.run(3.0)
    for message_id in (280, 281, 283, 285):  # GIMBAL_MANAGER_INFORMATION, ..._STATUS, GIMBAL_DEVICE_INFORMATION, ...
        rig.companion.command(512, float(message_id))
    rig.companion.command(1000, 0.0, 0.0)  # DO_GIMBAL_MANAGER_PITCHYAW
    rig.companion.command(1001, 1.0, 1.0)  # DO_GIMBAL_MANAGER_CONFIGURE
    rig.run(0.1)
    assert rig.companion.acks(512) == [2, 2, 2, 2]
    assert rig.companion.acks(1000) == [3] and rig.companion.acks(1001) == [3]


def test_a_takeoff_that_fails_is_acknowledged_and_does_not_climb() -> None:
    rig = Rig(takeoff_failure_probability=1.0)
    try:
        rig.take_off()
        assert rig.companion.acks(22) == [0]
        assert rig.vehicle.truth.on_ground and rig.vehicle.modes.armed
    finally:
        rig.close()


def test_a_port_in_use_is_one_clear_line_and_exit_code_2(caplog: pytest.LogCaptureFixture) -> None:
    ports = free_ports(6)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken, caplog.at_level(logging.ERROR):
        taken.bind((HOST, ports[2]))
        config = Config({"autopilot": settings(ports)}, {"autopilot": "simulation.autopilot.config:AutopilotSimConfig"})
        assert run(config, threading.Event()) == 2
    assert len(caplog.records) == 1
    text = caplog.records[0].getMessage()
    assert str(ports[2]) in text and "autopilot.ground.local_port" in text and "expected a free local port" in text


def test_a_mistyped_parameter_is_refused_with_a_suggestion() -> None:
    with pytest.raises(ConfigError, match="did you mean 'COM_OBL_RC_ACT'"):
        build(AutopilotSimConfig, {"parameters": {"COM_OBL_RC_ACTT": 5}}, "test")


def test_the_process_keeps_real_time_and_stops_at_once() -> None:
    config = Config(
        {"autopilot": settings(free_ports(6))}, {"autopilot": "simulation.autopilot.config:AutopilotSimConfig"}
    )
    stop, codes = threading.Event(), []
    thread = threading.Thread(target=lambda: codes.append(run(config, stop)))
    thread.start()
    time.sleep(0.3)
    stop.set()
    thread.join(1.0)
    assert codes == [0]


def test_the_pacer_catches_up_a_little_and_skips_much() -> None:
    pacer = Pacer(0.004, 100.0)
    assert pacer.wait_s(99.999) == pytest.approx(0.001)
    assert pacer.wait_s(100.050) < 0.0
    assert pacer.skipped == 0
    assert pacer.wait_s(101.0) == pytest.approx(0.0, abs=0.0041)
    assert pacer.skipped == 250
