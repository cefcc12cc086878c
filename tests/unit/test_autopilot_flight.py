"""A flight of the simulated autopilot's process by MAVSDK, in real time, with a ground station at the same time."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.action import Action
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkMessage
from mavsdk.plugins.telemetry import Telemetry
from pymavlink.dialects.v20 import development as mavlink

from tests.machine import free_ports
from tests.unit.autopilot_rig import HOST, settings

# The process table's entry, with this one section: what the other sides configure is no concern of this test.
_PROGRAM = """
import json, signal, sys, threading
from common.config import Config
from simulation.autopilot.process import run
stop = threading.Event()
signal.signal(signal.SIGTERM, lambda *_: stop.set())
sections = {"autopilot": "simulation.autopilot.config:AutopilotSimConfig"}
sys.exit(run(Config({"autopilot": json.loads(sys.argv[1])}, sections), stop))
"""
_HOLD, _OFFBOARD, _LAND = 0x03040000, 0x00060000, 0x06040000


class Pilot:
    """MAVSDK on the companion link, as helm uses it, and a raw ground station on the other link."""

    def __init__(self, ports: list[int]):
        self.mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.COMPANION_COMPUTER))
        self.mavsdk.add_any_connection(f"udpin://{HOST}:{ports[1]}")
        system: Any = self.mavsdk.first_autopilot(10.0)
        assert system is not None, "MAVSDK found no autopilot within 10 s"
        self.system = system
        self.action, self.telemetry, self.direct = Action(system), Telemetry(system), MavlinkDirect(system)
        self.mode = -1
        self.direct.subscribe_message("HEARTBEAT", self._on_heartbeat)
        self.station = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.station.bind((HOST, ports[3]))
        self.station_to = (HOST, ports[2])

    def close(self) -> None:
        """End MAVSDK from the leaves to the root: a plugin that outlives the instance aborts the whole process."""
        for part in (self.direct, self.telemetry, self.action, self.system, self.mavsdk):
            part.destroy()
        self.station.close()

    def _on_heartbeat(self, message: Any, *_: Any) -> None:
        fields = json.loads(message.fields_json)
        if fields["autopilot"] == 12:
            self.mode = fields["custom_mode"]

    def stream(self, duration_s: float, north_m_s: float, height_m: float) -> None:
        """Setpoints at 20 Hz: horizontal velocity with held altitude."""
        fields = {
            "time_boot_ms": 0,
            "target_system": 1,
            "target_component": 1,
            "coordinate_frame": 1,
            "type_mask": 0x5E3,
            "x": 0,
            "y": 0,
            "z": -height_m,
            "vx": north_m_s,
            "vy": 0,
            "vz": 0,
            "afx": 0,
            "afy": 0,
            "afz": 0,
            "yaw": 0,
            "yaw_rate": 0,
        }
        until_s = time.monotonic() + duration_s
        while time.monotonic() < until_s:
            self.direct.send_message(MavlinkMessage("SET_POSITION_TARGET_LOCAL_NED", 0, 0, 1, 1, json.dumps(fields)))
            time.sleep(0.05)

    def offboard(self) -> None:
        """Command OFFBOARD."""
        fields = {
            "target_system": 1,
            "target_component": 1,
            "command": 176,
            "confirmation": 0,
            "param1": 1,
            "param2": 6,
            "param3": 0,
            "param4": 0,
            "param5": 0,
            "param6": 0,
            "param7": 0,
        }
        self.direct.send_message(MavlinkMessage("COMMAND_LONG", 0, 0, 1, 1, json.dumps(fields)))

    def hold_from_the_ground(self) -> None:
        """Command HOLD as a ground station."""
        command = mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1.0, 4.0, 3.0, 0.0, 0.0, 0.0, 0.0)
        self.station.sendto(command.pack(mavlink.MAVLink(None, 255, 190)), self.station_to)

    def height_m(self) -> float:
        return self.telemetry.position().relative_altitude_m

    def north_m_s(self) -> float:
        return self.telemetry.position_velocity_ned().velocity.north_m_s


@pytest.fixture
def pilot() -> Iterator[Pilot]:
    ports = free_ports(6)
    table = json.dumps(settings(ports, sign_frames=True, parameters={"COM_OBL_RC_ACT": 5}))
    process = subprocess.Popen([sys.executable, "-c", _PROGRAM, table])
    try:
        pilot = Pilot(ports)
        try:
            yield pilot
        finally:
            pilot.close()
    finally:
        process.terminate()
        assert process.wait(5.0) == 0


def wait(what: str, condition: Callable[[], bool], limit_s: float) -> None:
    until_s = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < until_s, f"not within {limit_s} s: {what}"
        time.sleep(0.02)


@pytest.mark.slow
@pytest.mark.timeout(90)
def test_mavsdk_flies_it_as_it_flies_px4(pilot: Pilot) -> None:
    telemetry = pilot.telemetry
    wait("healthy and armable", lambda: telemetry.health_all_ok() and telemetry.health().is_armable, 10.0)
    pilot.action.arm()
    pilot.action.takeoff()
    wait("climb to within 0.3 m of 2.5 m", lambda: abs(pilot.height_m() - 2.5) < 0.3, 12.0)
    wait("hold after the takeoff", lambda: pilot.mode == _HOLD, 3.0)

    pilot.stream(0.6, 0.0, 3.0)
    pilot.offboard()
    pilot.stream(3.0, 1.5, 3.0)
    assert pilot.mode == _OFFBOARD
    assert pilot.north_m_s() == pytest.approx(1.5, abs=0.35)
    assert pilot.height_m() == pytest.approx(3.0, abs=0.4)

    # silence: the last setpoint for a second, then the failsafe; the heartbeat tells up to a second later
    wait("failsafe to HOLD", lambda: pilot.mode == _HOLD, 2.3)
    pilot.stream(2.0, 0.5, 3.0)
    assert pilot.mode == _OFFBOARD, "a resumed stream re-enters OFFBOARD by itself"
    pilot.hold_from_the_ground()
    pilot.stream(2.5, 0.5, 3.0)
    assert pilot.mode == _HOLD, "HOLD from the ground station wins although the stream goes on"
    assert abs(pilot.north_m_s()) < 0.3

    pilot.action.land()
    wait("disarmed after the landing", lambda: not telemetry.armed(), 15.0)
    wait("the mode of the landing", lambda: pilot.mode == _LAND, 1.5)
    assert not telemetry.in_air()
