"""The real thing for system tests: all processes, free ports, logs in files, ended by pid."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import psutil

from common.bus import Bus
from common.processes import load_config
from common.session import BusConfig, Side
from tests.machine import free_ports


@dataclass(frozen=True)
class External:
    """An autopilot that the tests did not start."""

    url: str
    """Where helm reaches it."""
    pose: str
    """Where the world learns its pose: `truth` or `local`, on the default port."""


class Stack:
    """Simulation, onboard side and ground side as a user starts them, on ports of their own.

    Args:
        folder: for logs and recordings.
        overrides: `section.key=value` texts on top of the ports.
        environment: additional environment variables.
        external: another autopilot than the simulated one.
        vehicle: vehicle file.
    """

    def __init__(
        self,
        folder: Path,
        overrides: Iterable[str] = (),
        environment: dict[str, str] | None = None,
        external: External | None = None,
        vehicle: str = "kite",
    ):
        self.folder = folder
        self._vehicle = vehicle
        tcp, udp = free_ports(3), free_ports(6)
        self.onboard_port, self.ground_port, self.console_port = tcp
        (
            self.autopilot_onboard,
            self.helm_port,
            self.autopilot_ground,
            self.gcs_port,
            self.autopilot_truth,
            self.world_port,
        ) = udp
        self.settings = [
            f"bus.onboard_router=tcp/127.0.0.1:{self.onboard_port}",
            f"bus.ground_router=tcp/127.0.0.1:{self.ground_port}",
            f"bus.link=tcp/127.0.0.1:{self.onboard_port}",
            f"console.port={self.console_port}",
            f"recorder.folder={folder / 'recordings'}",
            *(self._own_autopilot() if external is None else [f"helm.autopilot_url={external.url}"]),
            *overrides,
        ]
        self._sim = [] if external is None else ["--autopilot", "external", "--pose", external.pose]
        if external is not None:
            self.gcs_port = 14550
        self._environment = {**os.environ, **(environment or {})}
        self.sides: dict[str, subprocess.Popen] = {}
        self._buses: list[Bus] = []
        self.config = load_config(vehicle, self.settings)

    def _own_autopilot(self) -> list[str]:
        """Settings that put the simulated autopilot and what listens to it on ports of their own."""
        return [
            f"helm.autopilot_url=udpin://127.0.0.1:{self.helm_port}",
            f"autopilot.onboard.local_port={self.autopilot_onboard}",
            f"autopilot.onboard.remote_port={self.helm_port}",
            f"autopilot.ground.local_port={self.autopilot_ground}",
            f"autopilot.ground.remote_port={self.gcs_port}",
            f"autopilot.truth.local_port={self.autopilot_truth}",
            f"autopilot.truth.remote_port={self.world_port}",
            f"world.port={self.world_port}",
            f"world.autopilot_port={self.autopilot_truth}",
        ]

    def arguments(self) -> list[str]:
        """Command-line arguments that every process needs."""
        return ["--config", self._vehicle, *(part for text in self.settings for part in ("--set", text))]

    def start(self, side: str, *extra: str) -> subprocess.Popen:
        """Start a side (`sim`, `onboard`, `ground`), or one process (`node`)."""
        extra = (*self._sim, *extra) if side == "sim" else extra
        with (self.folder / f"{side}.log").open("ab") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", "common.cli", side, *self.arguments(), *extra],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                env=self._environment,
            )
        self.sides[side] = process
        return process

    def bus(self, side: Side = "ground", name: str = "test") -> Bus:
        """A session of the test's own."""
        bus = Bus(self.config.section(BusConfig), side, name, wait_s=20.0)
        self._buses.append(bus)
        return bus

    def pid(self, node: str) -> int | None:
        """Process identifier of a node, from the process tree of the sides; None while it is not running."""
        for side in self.sides.values():
            try:
                children = psutil.Process(side.pid).children(recursive=True)
            except psutil.NoSuchProcess:
                continue
            for child in children:
                try:
                    words = child.cmdline()
                except psutil.NoSuchProcess:
                    continue
                if "node" in words and words[words.index("node") + 1] == node:
                    return child.pid
        return None

    def kill(self, node: str, how: int = signal.SIGKILL) -> int:
        """Send a signal to a node; returns the pid that got it."""
        pid = self.pid(node)
        assert pid is not None, f"{node} is not running"
        os.kill(pid, how)
        return pid

    def end(self) -> dict[str, int]:
        """Close the test's sessions, end all sides as Ctrl-C does; returns their exit codes."""
        for bus in self._buses:
            bus.close()
        for process in self.sides.values():
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        codes = {}
        for side, process in self.sides.items():
            try:
                codes[side] = process.wait(8)
            except subprocess.TimeoutExpired:
                process.kill()
                codes[side] = process.wait()
        return codes

    def log(self, side: str) -> str:
        """What a side has written so far."""
        return (self.folder / f"{side}.log").read_text(errors="replace")

    def logs(self) -> str:
        """The end of every log, for a failed assertion."""
        return "\n".join(f"--- {s}\n{self.log(s)[-3000:]}" for s in self.sides)
