"""The vehicle's pose from the simulator's truth port: smoothing, interpolation, the port itself."""

import socket
import time

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from common.geometry.rotation import euler_from_quat, quat_conjugate, quat_from_euler, quat_multiply
from simulation.world.config import WorldConfig
from simulation.world.truth_filter import EARTH_RADIUS_M, Motion, motion_at, ned_from_geodetic, smoothed
from simulation.world.truth_port import TruthPort, TruthPortError
from tests.machine import free_port

HOME = (47.397742, 8.545594, 488.0)
STEP_M = 1e-7 * np.pi / 180 * EARTH_RADIUS_M


def true_motion(t_s: float) -> Motion:
    """A weaving flight: up to 2 m/s, 15 degrees of tilt, 60 degrees a second of yaw."""
    w = 1.1
    position = np.array([1.8 * np.sin(w * t_s), 1.2 * np.cos(0.7 * t_s), -5 + 0.3 * np.sin(0.5 * t_s)])
    velocity = np.array([1.8 * w * np.cos(w * t_s), -0.84 * np.sin(0.7 * t_s), 0.15 * np.cos(0.5 * t_s)])
    return Motion(int(t_s * 1e9), position, velocity, attitude(t_s), body_rates(t_s))


def attitude(t_s: float) -> np.ndarray:
    return quat_from_euler(0.2 * np.sin(2 * t_s), 0.25 * np.cos(1.5 * t_s), 1.0 * np.sin(t_s))


def body_rates(t_s: float) -> np.ndarray:
    step = 1e-5
    derivative = (attitude(t_s + step) - attitude(t_s - step)) / (2 * step)
    return 2 * quat_multiply(quat_conjugate(attitude(t_s)), derivative)[1:]


def quantised(motion: Motion) -> Motion:
    """As HIL_STATE_QUATERNION carries it: degE7, mm, cm/s."""
    grid = np.array([STEP_M, STEP_M * np.cos(np.deg2rad(HOME[0])), 1e-3])
    return Motion(
        motion.t_ns,
        np.round(motion.ned_p_m / grid) * grid,
        np.round(motion.ned_v_m_s, 2),
        motion.ned_q_body,
        motion.body_rates_rad_s,
    )


def history(rate_hz: float, seconds: float) -> list[Motion]:
    out: list[Motion] = []
    for i in range(int(seconds * rate_hz)):
        out.append(smoothed(out[-1] if out else None, quantised(true_motion(i / rate_hz)), 0.15))
    return out


def angle_between(a: np.ndarray, b: np.ndarray) -> float:
    return 2 * float(np.arccos(min(abs(float(a @ b)), 1.0)))


def test_smoothing_takes_the_steps_out_of_positions() -> None:
    flown = history(100.0, 8.0)[100:]
    raw = [np.abs(quantised(true_motion(m.t_ns / 1e9)).ned_p_m - true_motion(m.t_ns / 1e9).ned_p_m)[:2] for m in flown]
    smooth = [np.abs(m.ned_p_m - true_motion(m.t_ns / 1e9).ned_p_m)[:2] for m in flown]
    assert np.max(raw) > 0.005
    assert np.max(smooth) < 0.004
    assert np.std(smooth) < 0.5 * np.std(raw)
    # What shakes a picture is the change from frame to frame.
    jitter = np.diff([m.ned_p_m[0] - true_motion(m.t_ns / 1e9).ned_p_m[0] for m in flown])
    assert np.abs(jitter).max() < 0.0015


def test_interpolation_at_full_rate_is_good_to_millimetres_and_tenths_of_a_degree() -> None:
    flown = history(100.0, 4.0)
    for t_s in np.arange(1.0, 3.9, 0.0137):
        got, want = motion_at(flown, int(t_s * 1e9), 0), true_motion(t_s)
        assert got is not None
        assert np.abs(got.ned_p_m - want.ned_p_m).max() < 0.005
        assert np.abs(got.ned_v_m_s - want.ned_v_m_s).max() < 0.02
        assert angle_between(got.ned_q_body, want.ned_q_body) < np.deg2rad(0.05)


def test_interpolation_at_the_default_rate_of_the_port_still_holds() -> None:
    flown = history(25.0, 4.0)
    errors = [
        np.abs(got.ned_p_m - true_motion(t).ned_p_m).max()
        for t in np.arange(1.0, 3.9, 0.0137)
        if (got := motion_at(flown, int(t * 1e9), 0))
    ]
    assert len(errors) > 200 and max(errors) < 0.008


def test_extrapolation_is_short_and_bounded() -> None:
    flown = history(100.0, 2.0)
    end_ns = flown[-1].t_ns
    got = motion_at(flown, end_ns + 28_000_000, 30_000_000)
    want = true_motion((end_ns + 28_000_000) / 1e9)
    assert got is not None
    assert np.abs(got.ned_p_m - want.ned_p_m).max() < 0.006
    assert angle_between(got.ned_q_body, want.ned_q_body) < np.deg2rad(0.2)
    assert motion_at(flown, end_ns + 31_000_000, 30_000_000) is None
    assert motion_at(flown, flown[0].t_ns - 1, 30_000_000) is None
    assert motion_at([], 0, 30_000_000) is None


def test_a_jump_or_a_gap_starts_the_filter_anew() -> None:
    before = true_motion(1.0)
    jumped = Motion(before.t_ns + 10_000_000, before.ned_p_m + 50.0, *list(vars(before).values())[2:])
    assert smoothed(before, jumped, 0.15) is jumped
    late = Motion(before.t_ns + 2_000_000_000, *list(vars(before).values())[1:])
    assert smoothed(before, late, 0.15) is late


def test_geodetic_positions_become_north_east_down() -> None:
    lat = HOME[0] + np.degrees(30 / EARTH_RADIUS_M)
    lon = HOME[1] - np.degrees(20 / EARTH_RADIUS_M) / np.cos(np.deg2rad(HOME[0]))
    np.testing.assert_allclose(ned_from_geodetic(lat, lon, 492.5, HOME), (30.0, -20.0, -4.5), atol=1e-3)


class Autopilot:
    """The other end of the link: sends what it is told to, and reads what it is asked for."""

    def __init__(self, port: int) -> None:
        self.udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.udp.bind(("127.0.0.1", 0))
        self.udp.settimeout(3.0)
        self.peer = ("127.0.0.1", port)
        self.mav = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)

    @property
    def port(self) -> int:
        return self.udp.getsockname()[1]

    def send(self, message: mavlink.MAVLink_message) -> None:
        self.udp.sendto(message.pack(self.mav), self.peer)

    def truth(self, north_m: float, up_m: float, yaw_rad: float = 0.0) -> None:
        lat = HOME[0] + np.degrees(north_m / EARTH_RADIUS_M)
        attitude_q = [float(c) for c in quat_from_euler(0.0, 0.0, yaw_rad)]
        self.send(
            self.mav.hil_state_quaternion_encode(
                0,
                attitude_q,
                0.0,
                0.0,
                0.1,
                round(lat * 1e7),
                round(HOME[1] * 1e7),
                round((HOME[2] + up_m) * 1000),
                120,
                0,
                -50,
                0,
                0,
                0,
                0,
                0,
            )
        )

    def asked(self) -> mavlink.MAVLink_command_long_message:
        """Next COMMAND_LONG that arrives."""
        while True:
            for message in mavlink.MAVLink(None).parse_buffer(self.udp.recv(2048)) or ():
                if isinstance(message, mavlink.MAVLink_command_long_message):
                    return message

    def close(self) -> None:
        self.udp.close()


def wait_for_pose(port: TruthPort) -> int:
    deadline = time.monotonic() + 3.0
    while port.newest_ns is None and time.monotonic() < deadline:
        time.sleep(0.01)
    newest_ns = port.newest_ns
    assert newest_ns is not None
    return newest_ns


@pytest.mark.parametrize("signed", [False, True])
def test_hil_state_quaternion_becomes_a_pose_and_home_is_the_first_one(signed: bool) -> None:
    number = free_port()
    autopilot = Autopilot(number)
    if signed:  # PX4 signs its frames; the world has no key
        autopilot.mav.signing.secret_key = bytes(range(32))
        autopilot.mav.signing.sign_outgoing = True
    port = TruthPort(WorldConfig(port=number, autopilot_port=autopilot.port))
    try:
        sent_ns = time.monotonic_ns()
        autopilot.truth(2.0, 0.0)
        first = port.motion_at(wait_for_pose(port))
        assert first is not None
        np.testing.assert_allclose(first.ned_p_m, 0.0, atol=1e-9)
        assert 0 <= first.t_ns - sent_ns < 100_000_000
        autopilot.truth(2.5, 3.0, yaw_rad=0.7)
        deadline = time.monotonic() + 3.0
        while (port.newest_ns or 0) == first.t_ns and time.monotonic() < deadline:
            time.sleep(0.01)
        second = port.motion_at(port.newest_ns or 0)
        assert second is not None
        # Half a metre in no time is a jump for the height, which is taken as it comes.
        np.testing.assert_allclose(second.ned_p_m, (0.5, 0.0, -3.0), atol=0.02)
        np.testing.assert_allclose(second.ned_v_m_s, (1.2, 0.0, -0.5))
        assert euler_from_quat(second.ned_q_body)[2] == pytest.approx(0.7, abs=1e-6)
        assert second.body_rates_rad_s[2] == pytest.approx(0.1)
    finally:
        port.close()
        autopilot.close()


def test_it_asks_for_100_hz_and_for_nothing_else() -> None:
    number = free_port()
    autopilot = Autopilot(number)
    port = TruthPort(WorldConfig(port=number, autopilot_port=autopilot.port))
    try:
        request = autopilot.asked()
        assert request.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
        assert (request.param1, request.param2) == (115.0, 10_000.0)
        autopilot.truth(0.0, 0.0)
        again = autopilot.asked()  # one message in a second is not enough: asked again, of the sender
        assert (again.command, again.target_system) == (mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 7)
    finally:
        port.close()
        autopilot.close()


def test_a_configured_home_survives_a_restart_in_flight() -> None:
    number = free_port()
    autopilot = Autopilot(number)
    port = TruthPort(WorldConfig(port=number, autopilot_port=autopilot.port, home=HOME))
    try:
        autopilot.truth(12.0, 5.0)
        motion = port.motion_at(wait_for_pose(port))
        assert motion is not None
        np.testing.assert_allclose(motion.ned_p_m, (12.0, 0.0, -5.0), atol=0.02)
    finally:
        port.close()
        autopilot.close()


def test_the_local_estimate_is_a_source_too() -> None:
    number = free_port()
    autopilot = Autopilot(number)
    port = TruthPort(WorldConfig(source="local", port=number, autopilot_port=autopilot.port))
    try:
        assert {int(autopilot.asked().param1) for _ in range(2)} == {31, 32}
        autopilot.truth(50.0, 50.0)  # not what was configured: ignored
        autopilot.send(autopilot.mav.local_position_ned_encode(0, 1.0, -2.0, -4.0, 0.5, 0.0, 0.0))
        q = [float(c) for c in quat_from_euler(0.1, 0.0, -1.0)]
        autopilot.send(autopilot.mav.attitude_quaternion_encode(0, q[0], q[1], q[2], q[3], 0.0, 0.0, 0.2))
        motion = port.motion_at(wait_for_pose(port))
        assert motion is not None
        np.testing.assert_allclose(motion.ned_p_m, (1.0, -2.0, -4.0), atol=0.05)
        np.testing.assert_allclose(euler_from_quat(motion.ned_q_body), (0.1, 0.0, -1.0), atol=1e-6)
    finally:
        port.close()
        autopilot.close()


def test_garbage_and_broken_quaternions_are_ignored() -> None:
    number = free_port()
    autopilot = Autopilot(number)
    port = TruthPort(WorldConfig(port=number, autopilot_port=autopilot.port))
    try:
        autopilot.udp.sendto(b"\xfdgarbage" * 9, autopilot.peer)
        no_attitude = [0.0] * 4
        autopilot.send(
            autopilot.mav.hil_state_quaternion_encode(0, no_attitude, 0, 0, 0, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0)
        )
        time.sleep(0.1)
        assert port.newest_ns is None
        autopilot.truth(0.0, 0.0)
        wait_for_pose(port)
    finally:
        port.close()
        autopilot.close()


def test_a_port_in_use_is_one_clear_error() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        number = other.getsockname()[1]
        text = rf"got UDP port {number} on 127\.0\.0\.1 in use, expected it free.*world\.port"
        with pytest.raises(TruthPortError, match=text):
            TruthPort(WorldConfig(port=number))
