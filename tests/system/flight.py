"""An operator's hand and eyes in a system test."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from common.bus import Bus
from common.header import Received
from common.messages import Command, HelmStatus, Reply, Setpoint, Track
from common.truth import Truth
from simulation.demo.mission import box_of_corners
from tests.system.radio import Link
from tests.system.stack import Stack

LANDS_FAST = "helm.parameters.MPC_LAND_SPEED=1.5"
"""Setting of a vehicle that comes down twice as fast as by default, m/s: a test that lands waits for it."""


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
