"""What every demonstration's stand-in for the operator does: listens, waits, gives commands, holds the stick."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

from common.bus import Bus
from common.header import Received
from common.messages import Command, Health, HelmStatus, Reply, Request, VehicleState
from common.truth import Truth

log = logging.getLogger(__name__)

_READY_S = 60.0
_LANDED_S = 60.0
_STICK_PERIOD_S = 0.05
_TIMES, _AGAIN_S = 4, 0.5


class MissionFailed(RuntimeError):
    """A step of the mission did not work; the text says which, and what was answered."""


def insist(step: Callable[[], object], stop: threading.Event) -> None:
    """Do what a machine that stands still for a moment may have refused; up to four times, as an operator would.

    Args:
        step: to be done once.
        stop: ends the attempts.

    Raises:
        MissionFailed: it was refused each time.
    """
    for tries_left in reversed(range(_TIMES)):
        try:
            step()
        except MissionFailed:
            if not tries_left or stop.wait(_AGAIN_S):
                raise
        else:
            return


class Operator:
    """Gives the same commands as the console and the command line.

    Args:
        bus: a session of the ground side.
        stop: ends the mission.
    """

    def __init__(self, bus: Bus, stop: threading.Event):
        self.bus = bus
        self.stop = stop
        self.late_fraction = 0.0
        """Share of the world's frames that came late."""
        self.completed = False
        """Whether the mission was flown to its end."""
        self.status: HelmStatus | None = None
        self.truth: Received[Truth] | None = None
        self._state: Received[VehicleState] | None = None

    def listen(self) -> None:
        """Begin to hear helm and the world."""
        self.bus.subscribe("helm/status", self.on_status)
        self.bus.subscribe("helm/state", self._on_state)
        self.bus.subscribe("truth", self.on_truth)
        self.bus.subscribe("health/world", self._on_world)

    def on_status(self, received: Received[HelmStatus]) -> None:
        """Helm spoke."""
        if self.status is None or self.status.state != received.message.state:
            log.info("helm: %s (%s)", received.message.state, received.message.reason)
        self.status = received.message

    def on_truth(self, received: Received[Truth]) -> None:
        """The world spoke."""
        self.truth = received

    def _on_state(self, received: Received[VehicleState]) -> None:
        self._state = received

    def _on_world(self, received: Received[Health]) -> None:
        self.late_fraction = received.message.metrics.get("late_fraction", 0.0)

    def wait(
        self, what: str, condition: Callable[[], bool], limit_s: float, explain: Callable[[], str] = lambda: ""
    ) -> None:
        """Wait for a condition, or for the order to stop.

        Raises:
            MissionFailed: it did not come true in time.
        """
        deadline = time.monotonic() + limit_s
        while not condition():
            if self.stop.wait(0.05):
                return
            if time.monotonic() > deadline:
                raise MissionFailed(f"waited {limit_s:.0f} s for {what}, in vain. {explain()}")

    def command(self, name: str, command: Command | None = None) -> Reply:
        """Give a command that has to work.

        Raises:
            MissionFailed: it was refused or failed.
        """
        reply = self.bus.query(name, command or Command(operator="demo"))
        log.info("%s: %s %s", name, reply.outcome, reply.reason)
        if reply.outcome != "done" and not self.stop.is_set():
            raise MissionFailed(f"{name}: {reply.outcome}: {reply.reason}")
        return reply

    def take_off(self, height_m: float) -> None:
        """Wait for the gate to open, and take off.

        Raises:
            MissionFailed: it did not open, or the vehicle did not climb.
        """

        def step() -> None:
            self.wait("the vehicle to be ready to arm", self._ready, _READY_S, self._why_not_ready)
            if not self.stop.is_set():
                self.command("helm/do/takeoff", Command(height_m=height_m, operator="demo"))

        insist(step, self.stop)  # the gate may close again between the two

    def wait_for_landing(self) -> None:
        """Wait until the motors stand still.

        Raises:
            MissionFailed: they do not.
        """
        self.wait("the landing", lambda: self.status is not None and not self.status.armed, _LANDED_S)

    def push(
        self, forward_m_s: float, limit_s: float, until: Callable[[], bool] = lambda: False, turn_rad_s: float = 0.0
    ) -> float:
        """Hold the stick until a condition comes true, the time is over, or the order to stop; then let go.

        Returns:
            How long it was held, s.
        """
        request = Request(frame="heading", vector=(forward_m_s, 0.0, 0.0), yaw_rate_rad_s=turn_rad_s)
        start = time.monotonic()
        while not until() and time.monotonic() - start < limit_s:
            self._ask(request)
            if self.stop.wait(_STICK_PERIOD_S):
                break
        self._ask(Request(frame="heading", vector=(0.0, 0.0, 0.0)))
        return time.monotonic() - start

    def _ask(self, request: Request) -> None:
        if self._state is not None:
            self.bus.publish("helm/request/operator", request, self._state.header.capture_ns)

    def _ready(self) -> bool:
        status = self.status
        return (
            status is not None
            and status.state == "standby"
            and bool(status.preflight)
            and all(item.ok for item in status.preflight)
        )

    def _why_not_ready(self) -> str:
        if self.status is None:
            return "no status from helm"
        open_items = "; ".join(f"{i.name}: {i.detail}" for i in self.status.preflight if not i.ok)
        return f"helm is {self.status.state} ({self.status.reason}) {open_items}"
