"""The demonstration of limiter and approach: stick forward at a barrel, a stop before it, an approach, the way home."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Mapping

from common.bus import Bus
from common.header import Received
from common.messages import ApproachTarget, Command, LimiterStatus
from common.truth import Truth
from simulation.demo.operator import MissionFailed, Operator
from simulation.demo.report import Criteria

log = logging.getLogger(__name__)

_HEIGHT_M = 2.0
_STICK_M_S = 2.1
_STILL_M_S = 0.15
_STILL_S = 1.0
_NEARER_M = 0.03
_NEAR_M = 0.5  # a stop this far beyond h_desired is no stop before the barrel
_GOAL_M = 0.3


def faults(figures: Mapping[str, float], closest_to: str, h_min_m: float, h_desired_m: float) -> list[str]:
    """What was wrong with a flight; empty when it went well.

    Args:
        figures: true distances: `closest_m` of the whole flight, `stick_stop_m` and `approach_m` at the two stops.
        closest_to: what it came closest to.
        h_min_m: the limiter's least distance.
        h_desired_m: where the limiter stops the vehicle.
    """
    found = []
    if not figures["closest_m"] >= h_min_m:
        found.append(f"came to {figures['closest_m']:.2f} m of {closest_to}, expected {h_min_m:g} or more")
    for name in ("stick_stop_m", "approach_m"):
        stop_m = figures.get(name, math.nan)
        if not stop_m <= h_desired_m + _NEAR_M:
            found.append(f"{name} {stop_m:.2f}, expected {h_desired_m + _NEAR_M:g} or less")
    return found


class ApproachMission(Operator):
    """Flies at a barrel by the stick, then up to it by the approach, and home.

    Args:
        bus: a session of the ground side.
        stop: ends the mission.
        hand_over_s: for how long the stick is left to the operator before the way home, s; None for until told to stop.
    """

    goal = "stopped where it should", "did not stop where it should"
    """What to say of a mission that went well, or not."""

    def __init__(self, bus: Bus, stop: threading.Event, hand_over_s: float | None):
        super().__init__(bus, stop)
        self._hand_over_s = hand_over_s
        self._limiter: LimiterStatus | None = None
        self._target: ApproachTarget | None = None
        self._moved_s = 0.0
        self._least_m = math.inf
        self._nearer_s = 0.0
        self._closest: tuple[float, str] = (math.inf, "nothing")
        self._watching = False
        self._zones: list[str] = []
        self._figures: dict[str, float] = {}

    def fly(self) -> None:
        """The whole mission.

        Raises:
            MissionFailed: a command was refused or failed, or the vehicle did not get where it should.
        """
        self.listen()
        self.bus.subscribe("helm/limiter", self._on_limiter)
        self.bus.subscribe("approach/target", self._on_target)
        self.take_off(_HEIGHT_M)
        self.wait("the limiter's word of something near", lambda: self._limiter is not None, 5.0)
        self._watching = True
        self._stick_forward()
        self._approach()
        self._hand_over()
        self._go_home()
        self.completed = not self.stop.is_set()

    def judge(self, criteria: Criteria) -> tuple[dict[str, float], list[str]]:
        """Figures of the flight, and what was wrong with it."""
        figures = {"closest_m": self._closest[0]} | self._figures
        status = self._limiter
        if status is None:
            return figures, ["the limiter said nothing"]
        return figures, faults(figures, self._closest[1], status.h_min_m, status.h_desired_m)

    def on_truth(self, received: Received[Truth]) -> None:
        """The world spoke: how near is it, truly."""
        super().on_truth(received)
        truth = received.message
        if math.hypot(*truth.ned_v_m_s) > _STILL_M_S:
            self._moved_s = time.monotonic()
        if (distance_m := self._distance_m()) < self._least_m - _NEARER_M:
            self._least_m, self._nearer_s = distance_m, time.monotonic()
        if self._watching:
            for thing in truth.obstacles:
                self._closest = min(self._closest, (thing.distance_m, thing.label))

    def _on_limiter(self, received: Received[LimiterStatus]) -> None:
        status = received.message
        if self._watching and (not self._zones or self._zones[-1] != status.zone):
            self._zones.append(status.zone)
            log.info("limiter: %s, %.1f m, %s", status.zone, status.distance_m, status.why)
        self._limiter = status

    def _on_target(self, received: Received[ApproachTarget]) -> None:
        self._target = received.message

    @property
    def _still(self) -> bool:
        return time.monotonic() - self._moved_s > _STILL_S

    @property
    def _stopped(self) -> bool:
        """Whether the limiter lets it no nearer. Not standstill: held on, it slides round what is slender."""
        status = self._limiter
        near = status is not None and self._distance_m() <= status.h_desired_m + _NEAR_M
        return near and time.monotonic() - self._nearer_s > _STILL_S

    def _distance_m(self) -> float:
        """True distance of the nearest thing, m."""
        things = () if self.truth is None else self.truth.message.obstacles
        return min((thing.distance_m for thing in things), default=math.nan)

    def _stick_forward(self) -> None:
        log.info("stick forward at %.1f m/s, and held there", _STICK_M_S)
        self._least_m = math.inf
        held_s = self.push(_STICK_M_S, 25.0, until=lambda: self._stopped)
        self._figures["stick_stop_m"] = self._distance_m()
        log.info(
            "stick still forward after %.0f s: is %.2f m before it; closest so far %.2f m",
            held_s,
            self._distance_m(),
            self._closest[0],
        )

    def _approach(self) -> None:
        if self.stop.is_set():
            return
        log.info("back a little, then up to it again by the approach")
        self.push(-0.6, 4.0)
        self.wait("standstill", lambda: self._still, 10.0)
        self.command("approach/do/select", Command(operator="demo"))
        self.command("helm/do/approach")
        self.wait("the end of the approach", self._arrived, 30.0, self._where)
        self._figures["approach_m"] = self._distance_m()
        log.info("stands %.2f m before it, facing it", self._distance_m())
        if not self.stop.is_set():
            self.command("helm/do/hold")

    def _arrived(self) -> bool:
        target = self._target
        return (
            self._still
            and target is not None
            and target.state == "tracking"
            and abs(target.distance_m - target.goal_m) < _GOAL_M
        )

    def _where(self) -> str:
        return f"approach {self._target}, helm {None if self.status is None else self.status.reason}"

    def _hand_over(self) -> None:
        if self._hand_over_s == 0.0 or self.stop.is_set():
            return
        log.info("the stick is yours: take it on the console (lower left), W is forward; watch the ring")
        self.stop.wait(self._hand_over_s)

    def _go_home(self) -> None:
        if self.stop.is_set():
            return
        if self.status is not None and self.status.state not in ("hold", "operator", "approach", "pursuit"):
            raise MissionFailed(f"helm is {self.status.state} ({self.status.reason}), not in the air in its hands")
        self.command("helm/do/return")
        self.wait_for_landing()
