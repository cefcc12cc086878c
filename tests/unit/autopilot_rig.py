"""Clients of the simulated autopilot for its tests: peers on real UDP sockets, and a rig in simulated time."""

from __future__ import annotations

import math
import socket
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from common.config import build
from simulation.autopilot.config import AutopilotSimConfig, LinkConfig
from simulation.autopilot.process import AutopilotProcess
from tests.machine import free_ports

HOST = "127.0.0.1"
GROUND_STATION, COMPANION = 6, 18


def settings(ports: list[int], **changes: Any) -> dict[str, Any]:
    """The table of the section, with these six ports."""
    pairs = zip(("onboard", "ground", "truth"), ports[0::2], ports[1::2], strict=True)
    return {n: {"local_port": a, "remote_port": b} for n, a, b in pairs} | changes


class Peer:
    """A MAVLink client on one of the autopilot's links."""

    def __init__(self, link: LinkConfig, system: int, kind: int):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind((HOST, link.remote_port))
        self.socket.setblocking(False)
        self.to, self.kind = (HOST, link.local_port), kind
        self.mav = mavlink.MAVLink(None, system, 190)
        self.inbox: list[tuple[float, Any]] = []
        self.datagrams = 0

    def send(self, message: Any) -> None:
        self.socket.sendto(message.pack(self.mav), self.to)

    def heartbeat(self) -> None:
        self.send(mavlink.MAVLink_heartbeat_message(self.kind, 8, 0, 0, 0, 3))

    def command(self, command: int, *values: float, target: int = 1) -> None:
        padded = [*values, *([math.nan] * (7 - len(values)))]
        self.send(mavlink.MAVLink_command_long_message(target, 1, command, 0, *padded[:7]))

    def setpoint(self, mask: int, frame: int = 1, **fields: float) -> None:
        names = ("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate")
        self.send(
            mavlink.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, frame, mask, *(fields.get(n, 0.0) for n in names)
            )
        )

    def attitude(self, mask: int = 0, q: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0), **fields: float) -> None:
        names = ("body_roll_rate", "body_pitch_rate", "body_yaw_rate", "thrust")
        values = (fields.get(n, 0.0) for n in names)
        self.send(mavlink.MAVLink_set_attitude_target_message(0, 1, 1, mask, q, *values))

    def sticks(self, pitch: float = 0.0, roll: float = 0.0, throttle: float = 0.0, yaw: float = 0.0) -> None:
        """A joystick's positions, −1 to 1 each, the throttle's middle at 0."""
        x, y, r = (round(1000 * axis) for axis in (pitch, roll, yaw))
        self.send(mavlink.MAVLink_manual_control_message(1, x, y, round(500 * (throttle + 1.0)), r, 0))

    def collect(self, t_s: float) -> None:
        while True:
            try:
                datagram = self.socket.recv(4096)
            except BlockingIOError:
                return
            self.datagrams += 1
            for message in mavlink.MAVLink(None).parse_buffer(datagram) or []:
                self.inbox.append((t_s, message))

    def got(self, name: str) -> list[Any]:
        return [m for _, m in self.inbox if m.get_type() == name]

    def acks(self, command: int) -> list[int]:
        return [m.result for m in self.got("COMMAND_ACK") if m.command == command]


class Rig:
    """An autopilot whose cycles the test turns, with a companion, a ground station and a truth reader."""

    def __init__(self, **changes: Any):
        config = build(AutopilotSimConfig, settings(free_ports(6), **changes), "test")
        self.autopilot = AutopilotProcess(config)
        self.vehicle = self.autopilot.vehicle
        self.companion = Peer(config.onboard, 1, COMPANION)
        self.station = Peer(config.ground, 255, GROUND_STATION)
        self.truth = Peer(config.truth, 245, COMPANION)
        self.t_s = 0.0
        """Time since the rig began, s: it goes on through a reboot."""
        self.peers = (self.companion, self.station, self.truth)

    def run(self, duration_s: float) -> None:
        for _ in range(round(duration_s / self.vehicle.dt_s)):
            self.autopilot.cycle()
            self.t_s += self.vehicle.dt_s
            for peer in self.peers:
                peer.collect(self.t_s)

    def take_off(self) -> None:
        self.run(4.6)
        self.companion.command(400, 1.0)
        self.companion.command(22)
        self.run(9.0)

    def close(self) -> None:
        self.autopilot.close()
        for peer in self.peers:
            peer.socket.close()
