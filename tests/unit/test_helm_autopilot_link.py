"""Helm on the simulated autopilot: real MAVSDK, real MAVLink over UDP, real time."""

from __future__ import annotations

import contextlib
import math
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import common as mavlink

from common.config import Config, ConfigError
from common.geometry.rotation import euler_from_quat
from common.messages import Command, HelmStatus, Obstacle, Obstacles, Request
from common.node import ScriptedRun
from onboard.helm.autopilot_link import AutopilotLink
from onboard.helm.node import HelmNode
from tests.machine import free_ports
from tests.unit.helm_double import SECTIONS
from tests.unit.helm_rig import HelmRig

_ROOT = Path(__file__).parents[2]
_AUTOPILOT = """
import signal, sys, threading
from common.config import Config
from simulation.autopilot.process import run
stop = threading.Event()
signal.signal(signal.SIGTERM, lambda *_: stop.set())
names = ("onboard", "ground", "truth")
ports = [int(p) for p in sys.argv[1:]]
links = {n: {"local_port": ports[2 * i], "remote_port": ports[2 * i + 1]} for i, n in enumerate(names)}
sys.exit(run(Config({"autopilot": links}, {"autopilot": "simulation.autopilot.config:AutopilotSimConfig"}), stop))
"""


class Flight(HelmRig):
    """A helm node on a simulated autopilot in a process of its own."""

    def __init__(self, ports: list[int]):
        self.ground_port, self.station_port = ports[2], ports[3]
        self.autopilot = subprocess.Popen([sys.executable, "-c", _AUTOPILOT, *map(str, ports)], cwd=_ROOT)
        super().__init__(ports[1], takeoff_height_m=3.0, obstacle_distance=True)

    def command_hold_from_the_ground(self) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ground:
            link = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
            messages = (
                link.heartbeat_encode(6, 8, 0, 0, 4),
                link.command_long_encode(1, 1, 176, 0, 1, 4, 3, 0, 0, 0, 0),
            )
            for message in messages:
                ground.sendto(message.pack(link), ("127.0.0.1", self.ground_port))

    def close(self) -> None:
        super().close()
        os.kill(self.autopilot.pid, signal.SIGCONT)
        self.autopilot.terminate()
        self.autopilot.wait(10)


@pytest.fixture(scope="module")
def flight() -> Iterator[Flight]:
    flight = Flight(free_ports(6))
    try:
        yield flight
    finally:
        flight.close()


@pytest.mark.slow
def test_takeoff_chase_yield_loss_and_landing(flight: Flight):
    """One flight through all of it, as a boot and a takeoff cost 15 s."""
    assert flight.go(25.0, flight.gate_open), flight.status
    takeoff = flight.call("takeoff")
    assert flight.go(30.0, lambda: takeoff.answer is not None)
    assert takeoff.answer and takeoff.answer.outcome == "done", takeoff.answer
    _check_state_stream(flight)
    _chase_and_stop(flight)
    _yield_to_the_ground(flight)
    _lose_and_find_the_autopilot(flight)
    _distances_reach_a_ground_station(flight)  # last: from then on the limiter wants to see
    landing = flight.call("land")
    assert flight.go(25.0, lambda: flight.state == "standby"), flight.status
    assert landing.answer and landing.answer.outcome == "done"
    assert flight.node.metrics()["malformed"] == 0


def _check_state_stream(flight: Flight) -> None:
    start = len(flight.states)
    flight.go(2.0)
    fresh = flight.states[start:]
    assert len(fresh) > 80
    ages_ms = [(seen - capture) / 1e6 for seen, capture, _ in fresh]
    assert min(ages_ms) >= 0.0
    assert sorted(ages_ms)[len(ages_ms) // 2] < 40.0


def _distances_reach_a_ground_station(flight: Flight) -> None:
    """From an obstacle on the bus through helm's link and the autopilot to a ground station's socket."""
    seen = Obstacles(obstacles=(Obstacle(distance_m=2.5, ned_direction=(0.0, 1.0, 0.0)),))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.bind(("127.0.0.1", flight.station_port))
        station.setblocking(False)
        heartbeat = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        station.sendto(heartbeat.heartbeat_encode(6, 8, 0, 0, 4).pack(heartbeat), ("127.0.0.1", flight.ground_port))
        for _ in range(10):
            flight.run.feed("obstacles/depth", seen, time.monotonic_ns())
            flight.go(0.1)
        parser = mavlink.MAVLink(None)
        parser.robust_parsing = True
        messages = []
        with contextlib.suppress(BlockingIOError):
            while True:
                messages += parser.parse_buffer(station.recv(2048)) or []
    told = [m for m in messages if m.get_type() == "OBSTACLE_DISTANCE"]
    assert len(told) >= 5
    _, _, state = flight.states[-1]
    yaw_deg = math.degrees(euler_from_quat(state.ned_q_body)[2])
    # Not exactly 2.50 m: the map carries the point to now, by how the vehicle has drifted since.
    (near,) = (i for i, d in enumerate(told[-1].distances) if abs(d - 250) <= 15)
    assert abs(math.remainder(near * 5.0 + told[-1].angle_offset + yaw_deg - 90.0, 360.0)) <= 5.0, "due east"


def _chase_and_stop(flight: Flight) -> None:
    flight.request = Request(frame="ned", vector=(1.2, 0.0, 0.0))
    flight.step()
    assert flight.call("chase").answer
    flight.go(3.0)
    _, _, state = flight.states[-1]
    assert state.ned_v_m_s[0] == pytest.approx(1.2, abs=0.4)
    flight.request = None
    flight.go(4.0)
    _, _, state = flight.states[-1]
    assert math.hypot(*state.ned_v_m_s[:2]) < 0.3
    assert -state.ned_p_m[2] == pytest.approx(3.0, abs=0.5)


def _yield_to_the_ground(flight: Flight) -> None:
    flight.command_hold_from_the_ground()
    asked = time.monotonic()
    assert flight.go(2.5, lambda: flight.state == "yielded")
    assert time.monotonic() - asked < 1.5
    last = flight.setpoint_times[-1]
    flight.go(2.0)
    assert flight.setpoint_times[-1] == last
    assert flight.status and flight.status.mode == "HOLD"
    engaged = flight.call("engage")
    assert flight.go(5.0, lambda: engaged.answer is not None)
    assert engaged.answer and engaged.answer.outcome == "done", engaged.answer


def _lose_and_find_the_autopilot(flight: Flight) -> None:
    os.kill(flight.autopilot.pid, signal.SIGSTOP)
    assert flight.go(2.0, lambda: flight.state == "failsafe")
    assert flight.go(4.0, lambda: flight.state == "disconnected")
    assert flight.status and "no word from the autopilot" in flight.node.flight.machine.reason
    os.kill(flight.autopilot.pid, signal.SIGCONT)
    assert flight.go(6.0, lambda: flight.state == "yielded"), flight.status
    engaged = flight.call("engage")
    assert flight.go(6.0, lambda: engaged.answer is not None)
    assert engaged.answer and engaged.answer.outcome == "done", engaged.answer


def test_an_address_that_cannot_be_opened_is_said_at_once():
    with pytest.raises(ConfigError, match=r"udpin://192\.0\.2\.1:24991 cannot be opened .*check host"):
        AutopilotLink("udpin://192.0.2.1:24991")


def test_without_an_autopilot_helm_goes_on_and_ends_quickly():
    port = free_ports(1)[0]
    node = HelmNode(Config({"helm": {"autopilot_url": f"udpin://127.0.0.1:{port}"}}, SECTIONS), "helm")
    run = ScriptedRun(node)
    outputs = run.step(time.monotonic_ns())
    status = next(o.message for o in outputs if isinstance(o.message, HelmStatus))
    assert status.state == "disconnected" and str(port) in status.reason
    call, _ = run.call("helm/do/takeoff", Command(), time.monotonic_ns())
    assert call.answer and call.answer.outcome == "refused"
    start = time.monotonic()
    node.close()
    assert time.monotonic() - start < 3.0


@pytest.mark.parametrize(
    ("url", "why"),
    [
        ("serial:///dev/no-such-line:57600", "No such file or directory"),
        ("serial:///dev/null:57600", "ioctl"),
        ("tcpin://203.0.113.9:5760", "Cannot assign requested address"),
    ],
)
def test_a_link_that_cannot_be_opened_is_refused_with_the_reason(url: str, why: str) -> None:
    with pytest.raises(ConfigError, match=rf"helm\.autopilot_url: {url} cannot be opened \(.*{why}.*\); check host"):
        AutopilotLink(url)


def test_an_error_that_repeats_is_said_once(caplog: pytest.LogCaptureFixture) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    with caplog.at_level("WARNING"):
        link = AutopilotLink(f"tcpout://127.0.0.1:{port}")
        time.sleep(2.5)  # MAVSDK tries again each second
        link.close(hold=False)
    assert [r.getMessage() for r in caplog.records] == ["MAVSDK: Connect error: Connection refused"]
