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
from common.messages import Command, HelmStatus, Track
from common.truth import Truth
from simulation.demo.operator import MissionFailed, Operator, insist
from simulation.demo.report import ChaseRecorder, Criteria

log = logging.getLogger(__name__)

_HEIGHT_M = 5.0
_LINE_EVERY_S = 10.0


class ChaseMission(Operator):
    """Flies one chase by commands.

    Args:
        bus: a session of the ground side.
        stop: ends the mission.
        duration_s: length of the chase, s; None for until told to stop.
    """

    goal = "chase held", "chase did not hold"
    """What to say of a mission that went well, or not."""

    def __init__(self, bus: Bus, stop: threading.Event, duration_s: float | None):
        super().__init__(bus, stop)
        self._duration_s = duration_s
        self.recorder = ChaseRecorder()
        self.on_chase: Callable[[], None] = lambda: None
        """Called when the chase begins."""
        self._track: Track | None = None

    def fly(self) -> None:
        """The whole mission.

        Raises:
            MissionFailed: a command was refused or failed, or the vehicle never got ready.
        """
        self.listen()
        self.bus.subscribe("pursuit/track", self._on_track)
        self.bus.subscribe("helm/setpoint", self.recorder.on_setpoint)
        self.take_off(_HEIGHT_M)
        if self.stop.is_set():
            return
        self.wait("a view of the car", self._car_in_view, 30.0)
        self._select()
        self.wait("the tracker", lambda: self._track is not None and self._track.state == "tracking", 5.0)
        self.command("helm/do/chase")
        self.on_chase()
        self.recorder.active = True
        self._watch_chase()
        self.recorder.active = False
        if not self.stop.is_set():
            self.command("helm/do/land")
            self.wait_for_landing()

    def judge(self, criteria: Criteria) -> tuple[dict[str, float], list[str]]:
        """Figures of the flight, and what was wrong with it."""
        return self.recorder.summary(), self.recorder.faults(criteria)

    def on_status(self, received: Received[HelmStatus]) -> None:
        """Helm spoke."""
        super().on_status(received)
        self.recorder.on_status(received)

    def on_truth(self, received: Received[Truth]) -> None:
        """The world spoke."""
        super().on_truth(received)
        self.recorder.on_truth(received)

    def _on_track(self, received: Received[Track]) -> None:
        if self._track is not None and self._track.state != received.message.state:
            log.info("tracker: %s", received.message.state)
        self._track = received.message
        self.recorder.on_track(received)

    def _car_in_view(self) -> bool:
        return self.truth is not None and self.truth.message.target_visible

    def _select(self) -> None:
        """Draw the box around the car in the newest picture.

        Raises:
            MissionFailed: it was refused, on later pictures too: a machine that stood still keeps none of that time.
        """
        insist(self._draw, self.stop)
        self.recorder.selections += 1

    def _draw(self) -> None:
        if self.truth is None or not self.truth.message.target_corners_px:
            raise MissionFailed("the car is out of view: there is nothing to draw a box around")
        box, angle_rad = box_of_corners(self.truth.message.target_corners_px, self.truth.message)
        self.command(
            "pursuit/do/select",
            Command(box_px=box, angle_rad=angle_rad, capture_ns=self.truth.header.capture_ns, operator="demo"),
        )

    def _watch_chase(self) -> None:
        start = time.monotonic()
        next_line = start + _LINE_EVERY_S
        while not self.stop.wait(0.1):
            now = time.monotonic()
            if self._duration_s is not None and now - start >= self._duration_s:
                self.completed = True
                return
            if now >= next_line:
                next_line += _LINE_EVERY_S
                self._say(now - start)

    def _say(self, elapsed_s: float) -> None:
        if self.truth is None or self._track is None or self.status is None:
            return
        truth = self.truth.message
        error_m = math.dist(truth.ned_p_m[:2], truth.target_ned_p_m[:2])
        log.info(
            "%4.0f s: %.2f m from the car, %s, helm %s, height %.1f m",
            elapsed_s,
            error_m,
            self._track.state,
            self.status.state,
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
