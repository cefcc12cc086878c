"""The real thing for system tests: all processes, free ports, logs in files, ended by pid."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil

from common.bus import Bus
from common.header import Received
from common.messages import Command, HelmStatus, Reply, Setpoint, Track
from common.processes import load_config
from common.session import BusConfig, Side
from common.truth import Truth
from simulation.demo.mission import box_of_corners
from tests.machine import free_ports


class Seen:
    """The newest message and the history of a topic."""

    def __init__(self, bus: Bus, topic: str):
        self.all: list[Received[Any]] = []
        bus.subscribe(topic, self.all.append)

    @property
    def last(self) -> Any:
        """Newest message, or None."""
        return self.all[-1].message if self.all else None

    def since(self, t_ns: int) -> list[Received[Any]]:
        """Messages received after a time."""
        return [r for r in list(self.all) if r.received_ns >= t_ns]


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


class Flight:
    """An operator's hand and eyes in a test: commands, and what the vehicle really does."""

    def __init__(self, stack: Stack):
        self.stack = stack
        self.bus = stack.bus()
        self.status = Seen(self.bus, "helm/status")
        self.truth = Seen(self.bus, "truth")
        self.track = Seen(self.bus, "pursuit/track")
        self.setpoints = Seen(self.bus, "helm/setpoint")
        self.world = Seen(self.bus, "health/world")
        self.link: Link | None = None
        """The radio, when the flight was made with one."""

    def wait(self, what: str, condition: Callable[[], bool], limit_s: float) -> float:
        """Wait for a condition; returns the seconds it took, fails with the logs when it does not come."""
        start = time.monotonic()
        while not condition():
            if time.monotonic() - start > limit_s:
                raise AssertionError(f"no {what} within {limit_s:.0f} s; helm {self.status.last}; {self.stack.logs()}")
            time.sleep(0.02)
        return time.monotonic() - start

    def do(self, command: str, argument: Command | None = None) -> Reply:
        """Give a command and return the reply."""
        return self.bus.query(command, argument or Command(operator="test"))

    def must(self, command: str, argument: Command | None = None) -> None:
        """Give a command that has to work."""
        reply = self.do(command, argument)
        assert reply.outcome == "done", f"{command}: {reply}; {self.stack.logs()}"

    @property
    def state(self) -> str:
        """Helm's state."""
        status: HelmStatus | None = self.status.last
        return status.state if status else ""

    @property
    def height_m(self) -> float:
        """True height, m."""
        truth: Truth | None = self.truth.last
        return -truth.ned_p_m[2] if truth else 0.0

    @property
    def speed_m_s(self) -> float:
        """True horizontal speed, m/s."""
        truth: Truth | None = self.truth.last
        return (truth.ned_v_m_s[0] ** 2 + truth.ned_v_m_s[1] ** 2) ** 0.5 if truth else 0.0

    @property
    def error_m(self) -> float:
        """True horizontal distance to the car, m."""
        truth: Truth = self.truth.last
        return (
            (truth.ned_p_m[0] - truth.target_ned_p_m[0]) ** 2 + (truth.ned_p_m[1] - truth.target_ned_p_m[1]) ** 2
        ) ** 0.5

    def ready(self) -> None:
        """Wait until the preflight gate is open."""
        self.wait(
            "open preflight gate",
            lambda: (
                self.state == "standby"
                and bool(self.status.last.preflight)
                and all(i.ok for i in self.status.last.preflight)
            ),
            60,
        )

    def take_off(self, height_m: float = 5.0) -> None:
        """Take off and wait for the hover."""
        self.ready()
        self.must("helm/do/takeoff", Command(height_m=height_m, operator="test"))
        self.wait("hover after takeoff", lambda: self.state == "hold" and self.height_m > height_m - 0.7, 30)

    def select(self) -> None:
        """Draw the box around the car, from the truth."""
        self.wait("view of the car", lambda: self.truth.last is not None and self.truth.last.target_visible, 20)
        newest = self.truth.all[-1]
        box, angle = box_of_corners(newest.message.target_corners_px, newest.message)
        self.must("pursuit/do/select", Command(box_px=box, angle_rad=angle, capture_ns=newest.header.capture_ns))

    def chase(self) -> None:
        """Choose the car and chase it."""
        self.select()
        self.wait("track", lambda: self.tracking, 5)
        self.must("helm/do/chase")
        self.wait("chase", lambda: self.state == "pursuit" and self.tracking, 5)

    def pursuit_answers(self) -> bool:
        """Whether a live tracker publishes again."""
        return bool(self.track.since(time.monotonic_ns() - 300_000_000))

    @property
    def tracking(self) -> bool:
        """Whether the tracker holds the target."""
        track: Track | None = self.track.last
        return track is not None and track.state == "tracking" and self.pursuit_answers()

    def land(self) -> None:
        """Land and wait for the motors to stop."""
        self.must("helm/do/land")
        self.wait("landing", lambda: not self.status.last.armed, 40)

    def check_machine(self) -> None:
        """Fail as `machine too slow`, not as a flight fault, when the world could not render in time."""
        late = self.world.last.metrics["late_fraction"] if self.world.last else 0.0
        assert late <= 0.02, f"machine too slow: {late:.1%} of the world's frames were late"

    def sent_speeds_m_s(self, since_ns: int) -> list[float]:
        """Horizontal speeds that helm asked of the autopilot since a time."""
        out = []
        for received in self.setpoints.since(since_ns):
            setpoint: Setpoint = received.message
            out.append((setpoint.ned_v_m_s[0] ** 2 + setpoint.ned_v_m_s[1] ** 2) ** 0.5)
        return out


class Link:
    """A radio between ground and vehicle: a TCP relay that can be cut and joined again.

    Args:
        target: port of the vehicle's router.
    """

    def __init__(self, target: int):
        self._target = target
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self._joined = threading.Event()
        self._joined.set()
        self._sockets: list[socket.socket] = []
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self) -> None:
        """Stop carrying anything: bytes are held back, as when a radio loses the other side."""
        self._joined.clear()

    def join(self) -> None:
        """Carry again."""
        self._joined.set()

    def close(self) -> None:
        """End the relay."""
        self._joined.set()
        self._listener.close()
        for s in self._sockets:
            s.close()

    def _accept(self) -> None:
        while True:
            try:
                inner, _ = self._listener.accept()
            except OSError:
                return  # closed
            try:
                outer = socket.create_connection(("127.0.0.1", self._target)) if self._joined.is_set() else None
            except OSError:
                outer = None  # the vehicle's router is not there yet
            if outer is None:
                inner.close()
                continue
            self._sockets += [inner, outer]
            for source, sink in ((inner, outer), (outer, inner)):
                source.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                threading.Thread(target=self._carry, args=(source, sink), daemon=True).start()

    def _carry(self, source: socket.socket, sink: socket.socket) -> None:
        try:
            while data := source.recv(65536):
                self._joined.wait()
                sink.sendall(data)
        except OSError:
            pass
        finally:
            source.close()
            sink.close()
