"""A helm node with its real link, stepped in real time: for tests that fly it on something that speaks MAVLink."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from common.config import Config
from common.messages import Command, HelmStatus, Request, Setpoint, Track, VehicleState
from common.node import CommandCall, ScriptedRun
from onboard.helm.node import HelmNode
from tests.unit.helm_double import INFO, SECTIONS


class HelmRig:
    """A helm node that listens on a UDP port of 127.0.0.1, and what it has said.

    Args:
        port: where the autopilot sends to.
        helm: settings of `[helm]`.
    """

    def __init__(self, port: int, **helm: Any):
        self._config = Config({"helm": {"autopilot_url": f"udpin://127.0.0.1:{port}", **helm}}, SECTIONS)
        self.states: list[tuple[int, int, VehicleState]] = []
        self.setpoint_times: list[float] = []
        self.status: HelmStatus | None = None
        self.request: Request | None = None
        self._begin()

    def _begin(self) -> None:
        self.node = HelmNode(self._config, "helm")
        self.run = ScriptedRun(self.node)

    def restart(self) -> None:
        """Stop helm as a supervisor does, and start another."""
        self.node.close()
        self.status = None
        self._begin()

    @property
    def state(self) -> str:
        return self.node.flight.state.value

    @property
    def vehicle(self) -> VehicleState:
        """Newest state on the bus."""
        return self.states[-1][2]

    def step(self) -> None:
        t_ns = time.monotonic_ns()
        self.run.feed("camera/down/info", INFO, t_ns)
        if self.request is not None:
            self.run.feed("helm/request/pursuit", self.request, t_ns)
            self.run.feed("pursuit/track", Track(state="tracking"), t_ns)
        for output in self.run.step(time.monotonic_ns()):
            if isinstance(output.message, VehicleState) and output.capture_ns is not None:
                self.states.append((time.monotonic_ns(), output.capture_ns, output.message))
            elif isinstance(output.message, Setpoint):
                self.setpoint_times.append(time.monotonic())
            elif isinstance(output.message, HelmStatus):
                self.status = output.message
        time.sleep(max(0.0, 0.02 - (time.monotonic_ns() - t_ns) / 1e9))

    def go(self, seconds: float, until: Callable[[], bool] | None = None) -> bool:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.step()
            if until is not None and until():
                return True
        return until is None

    def call(self, name: str) -> CommandCall:
        call, _ = self.run.call(f"helm/do/{name}", Command(), time.monotonic_ns())
        return call

    def gate_open(self) -> bool:
        return self.status is not None and bool(self.status.preflight) and all(i.ok for i in self.status.preflight)

    def close(self) -> None:
        self.node.close()
