"""The operator's stand-in: takes off, draws the box around the car, starts the chase, lands.

It gives the same commands as the console and the command line. A person sees the car and draws a box around it; the
stand-in takes that box from the simulator's truth, once, and the tracker knows nothing else of the truth.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable

import cv2
import numpy as np

from common.bus import Bus
from common.header import Received
from common.messages import Command, Health, HelmStatus, Reply, Track
from common.truth import Truth
from simulation.demo.report import ChaseRecorder

log = logging.getLogger(__name__)

_READY_S = 60.0
_LANDED_S = 60.0
_HEIGHT_M = 5.0
_LINE_EVERY_S = 10.0


class MissionFailed(RuntimeError):
    """A step of the mission did not work; the text says which, and what was answered."""


class Mission:
    """Flies one chase by commands.

    Args:
        bus: a session of the ground side.
        stop: ends the mission.
        duration_s: length of the chase, s; None for until told to stop.
    """

    def __init__(self, bus: Bus, stop: threading.Event, duration_s: float | None):
        self._bus = bus
        self._stop = stop
        self._duration_s = duration_s
        self.recorder = ChaseRecorder()
        self.late_fraction = 0.0
        """Share of the world's frames that came late."""
        self.completed = False
        """Whether the chase lasted as long as asked."""
        self.on_chase: Callable[[], None] = lambda: None
        """Called when the chase begins."""
        self._status: HelmStatus | None = None
        self._truth: Received[Truth] | None = None
        self._track: Track | None = None

    def fly(self) -> None:
        """The whole mission.

        Raises:
            MissionFailed: a command was refused or failed, or the vehicle never got ready.
        """
        self._listen()
        self._await("the vehicle to be ready to arm", self._ready, _READY_S, self._why_not_ready)
        if self._stop.is_set():
            return
        self._command("helm/do/takeoff", Command(height_m=_HEIGHT_M, operator="demo"))
        self._await("a view of the car", self._car_in_view, 30.0)
        self._select()
        self._await("the tracker", lambda: self._track is not None and self._track.state == "tracking", 5.0)
        self._command("helm/do/chase")
        self.on_chase()
        self.recorder.active = True
        self._watch_chase()
        self.recorder.active = False
        if not self._stop.is_set():
            self._command("helm/do/land")
            self._await("the landing", lambda: self._status is not None and not self._status.armed, _LANDED_S)

    def _listen(self) -> None:
        self._bus.subscribe("helm/status", self._on_status)
        self._bus.subscribe("truth", self._on_truth)
        self._bus.subscribe("pursuit/track", self._on_track)
        self._bus.subscribe("helm/setpoint", self.recorder.on_setpoint)
        self._bus.subscribe("health/world", self._on_world)

    def _on_status(self, received: Received[HelmStatus]) -> None:
        if self._status is None or self._status.state != received.message.state:
            log.info("helm: %s (%s)", received.message.state, received.message.reason)
        self._status = received.message
        self.recorder.on_status(received)

    def _on_truth(self, received: Received[Truth]) -> None:
        self._truth = received
        self.recorder.on_truth(received)

    def _on_track(self, received: Received[Track]) -> None:
        if self._track is not None and self._track.state != received.message.state:
            log.info("tracker: %s", received.message.state)
        self._track = received.message
        self.recorder.on_track(received)

    def _on_world(self, received: Received[Health]) -> None:
        self.late_fraction = received.message.metrics.get("late_fraction", 0.0)

    def _ready(self) -> bool:
        status = self._status
        return (
            status is not None
            and status.state == "standby"
            and bool(status.preflight)
            and all(item.ok for item in status.preflight)
        )

    def _why_not_ready(self) -> str:
        if self._status is None:
            return "no status from helm"
        open_items = "; ".join(f"{i.name}: {i.detail}" for i in self._status.preflight if not i.ok)
        return f"helm is {self._status.state} ({self._status.reason}) {open_items}"

    def _car_in_view(self) -> bool:
        return self._truth is not None and self._truth.message.target_visible

    def _await(
        self, what: str, condition: Callable[[], bool], limit_s: float, explain: Callable[[], str] = lambda: ""
    ) -> None:
        deadline = time.monotonic() + limit_s
        while not condition():
            if self._stop.wait(0.05):
                return
            if time.monotonic() > deadline:
                raise MissionFailed(f"waited {limit_s:.0f} s for {what}, in vain. {explain()}")

    def _command(self, name: str, command: Command | None = None) -> Reply:
        reply = self._bus.query(name, command or Command(operator="demo"))
        log.info("%s: %s %s", name, reply.outcome, reply.reason)
        if reply.outcome != "done" and not self._stop.is_set():
            raise MissionFailed(f"{name}: {reply.outcome}: {reply.reason}")
        return reply

    def _select(self) -> None:
        """Draw the box around the car in the newest picture."""
        if self._truth is None or not self._truth.message.target_corners_px:
            return
        box, angle_rad = box_of_corners(self._truth.message.target_corners_px, self._truth.message)
        self._command(
            "pursuit/do/select",
            Command(box_px=box, angle_rad=angle_rad, capture_ns=self._truth.header.capture_ns, operator="demo"),
        )
        self.recorder.selections += 1

    def _watch_chase(self) -> None:
        start = time.monotonic()
        next_line = start + _LINE_EVERY_S
        while not self._stop.wait(0.1):
            now = time.monotonic()
            if self._duration_s is not None and now - start >= self._duration_s:
                self.completed = True
                return
            if now >= next_line:
                next_line += _LINE_EVERY_S
                self._say(now - start)

    def _say(self, elapsed_s: float) -> None:
        if self._truth is None or self._track is None or self._status is None:
            return
        truth = self._truth.message
        error_m = math.dist(truth.ned_p_m[:2], truth.target_ned_p_m[:2])
        log.info(
            "%4.0f s: %.2f m from the car, %s, helm %s, height %.1f m",
            elapsed_s,
            error_m,
            self._track.state,
            self._status.state,
            -truth.ned_p_m[2],
        )


def box_of_corners(
    corners_px: tuple[tuple[float, float], ...], truth: Truth
) -> tuple[tuple[float, float, float, float], float]:
    """Rectangle around the corners as (x, y, width, height) and its rotation.

    The rectangle's own y axis is the car's long axis, its rotation the car's heading against the picture's top.

    Args:
        corners_px: four corners in order, px.
        truth: for the heading of car and vehicle.
    """
    points = np.array(corners_px, np.float32)
    (cx, cy), (a, b), _ = cv2.minAreaRect(points)
    short, long = sorted((a, b))
    w, x, y, z = truth.ned_q_body
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    angle_rad = math.remainder(truth.target_heading_rad - yaw, 2 * math.pi)
    return (cx - short / 2, cy - long / 2, short, long), angle_rad
