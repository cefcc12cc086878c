"""The checks' vehicle for tests: the simulated autopilot in simulated time, behind a proxy that can make it deviate."""

from __future__ import annotations

import socket
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from common.config import build
from simulation.autopilot.config import AutopilotSimConfig
from simulation.autopilot.process import AutopilotProcess
from simulation.conformance.client import Client
from simulation.conformance.vehicle import Vehicle
from tests.machine import free_ports
from tests.unit.autopilot_rig import HOST, settings

Change = Callable[[Any], Any]
"""Takes a message; returns what passes: the message, changed or not, or None."""


class ProxiedWire:
    """A wire whose waiting turns the autopilot's cycles; `up` and `down` change what passes."""

    def __init__(self, **changes: Any):
        config = build(AutopilotSimConfig, settings(free_ports(6), **changes), "test")
        self.autopilot = AutopilotProcess(config)
        self.up: Change | None = None
        self.down: Change | None = None
        self.skip = 0
        """Of so many frames from the autopilot, one is lost."""
        self._t_s, self._period_s, self._count = 0.0, 1.0 / config.rate_hz, 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((HOST, config.onboard.remote_port))
        self._socket.setblocking(False)
        self._to = (HOST, config.onboard.local_port)

    def now_s(self) -> float:
        return self._t_s

    def send(self, frame: bytes) -> None:
        passed = frame if self.up is None else _changed(frame, self.up)
        if passed:
            self._socket.sendto(passed, self._to)

    def receive(self, until_s: float) -> list[bytes]:
        out: list[bytes] = []
        while not out and self._t_s < until_s:
            self.autopilot.cycle()
            self._t_s += self._period_s
            out = self._arrived()
        return out

    def _arrived(self) -> list[bytes]:
        out: list[bytes] = []
        while True:
            try:
                frame = self._socket.recv(4096)
            except BlockingIOError:
                return out
            self._count += 1
            if self.skip and self._count % self.skip == 0:
                continue
            passed = frame if self.down is None else _changed(frame, self.down)
            if passed:
                out.append(passed)

    def close(self) -> None:
        self.autopilot.close()
        self._socket.close()


def _changed(frame: bytes, change: Change) -> bytes:
    """A frame after a change; one that is let through unchanged keeps its bytes."""
    parser = mavlink.MAVLink(None)
    messages = parser.parse_buffer(frame) or []
    if not messages:
        return frame
    message: Any = messages[0]
    before = message.to_dict()
    passed = change(message)
    if passed is None:
        return b""
    if passed.to_dict() == before:
        return frame
    sender = mavlink.MAVLink(None, message.get_srcSystem(), message.get_srcComponent())
    return passed.pack(sender)


class ConformanceRig:
    """Wire, client and vehicle."""

    def __init__(self, **changes: Any):
        self.wire = ProxiedWire(**changes)
        self.client = Client(self.wire)
        self.vehicle = Vehicle(self.client)
        assert self.client.run(8.0, lambda: self.client.target is not None)

    def close(self) -> None:
        self.wire.close()
