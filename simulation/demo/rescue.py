"""The demonstration of search and rescue: over the area line by line, people found, one picked and flown up to."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from common.bus import Bus
from common.header import Received
from common.messages import (
    ApproachTarget,
    Command,
    LimiterStatus,
    People,
    PeopleDetections,
    Person,
    SearchStatus,
)
from common.truth import Truth
from simulation.demo.operator import MissionFailed, Operator
from simulation.demo.report import Criteria

log = logging.getLogger(__name__)

_HEIGHT_M = 5.0
_SEARCH_S = 180.0
_PICK_S = 240.0
_APPROACH_S = 40.0
_HOLD_S = 2.0
_GOAL_M = 0.4
_NEAR_M = 0.5
"""How near to somebody they have to be reported, m: in the mean of all pictures, and on the map in the end."""
_SAME_M = 1.5
"""Who is reported this near to a person of the scene is that person, m; how near is judged after that."""
_FAR_M = 1e3
_WITHIN_NS = 150_000_000


@dataclass(frozen=True)
class Match:
    """Whom a reported person is, in truth."""

    label: str
    """In the scenario; empty for nobody."""
    error_m: float
    """Horizontal distance, m; infinite for nobody."""


def match(found: Mapping[int, Sequence[float]], there: Mapping[str, Sequence[float]]) -> dict[int, Match]:
    """Who is who: the assignment of the least distances, none farther than a metre and a half.

    Args:
        found: north and east, m, of each reported person.
        there: north and east, m, of each person in the scene.
    """
    numbers, labels = list(found), list(there)
    result = dict.fromkeys(numbers, Match("", math.inf))
    if not numbers or not labels:
        return result
    apart = np.array([[math.dist(found[n][:2], there[name][:2]) for name in labels] for n in numbers])
    for row, column in zip(*linear_sum_assignment(np.where(apart <= _SAME_M, apart, _FAR_M)), strict=True):
        if apart[row, column] <= _SAME_M:
            result[numbers[row]] = Match(labels[column], float(apart[row, column]))
    return result


class RescueMission(Operator):
    """Searches the area, picks somebody, flies up to them, and home.

    Args:
        bus: a session of the ground side.
        stop: ends the mission.
        headless: whether the first person that was found is picked; otherwise the operator picks.
    """

    goal = "everybody found, and flown up to one", "not everybody found"
    """What to say of a mission that went well, or not."""

    def __init__(self, bus: Bus, stop: threading.Event, headless: bool):
        super().__init__(bus, stop)
        self._headless = headless
        self._roll: tuple[Person, ...] = ()
        self._search: SearchStatus | None = None
        self._target: ApproachTarget | None = None
        self._limiter: LimiterStatus | None = None
        self._truths: list[Received[Truth]] = []
        self._errors: dict[str, list[float]] = {}
        """Position errors of each person of the scene, m, picture by picture while they were seen."""
        self._map_errors: dict[int, float] = {}
        """Of the place on the map of each reported number, m, when they were last seen."""
        self._claims: dict[int, set[str]] = {}
        """Whom each reported number was, over time."""
        self._closest_m = math.inf
        self._looks: list[int] = []
        self._figures: dict[str, float] = {}
        self._watching = False

    def fly(self) -> None:
        """The whole mission.

        Raises:
            MissionFailed: a command was refused or failed, or the vehicle did not get where it should.
        """
        self.listen()
        self.bus.subscribe("people/tracks", self._on_roll)
        self.bus.subscribe("people/detections", self._on_detections)
        self.bus.subscribe("search/status", self._on_search)
        self.bus.subscribe("approach/target", self._on_target)
        self.bus.subscribe("helm/limiter", self._on_limiter)
        self.take_off(_HEIGHT_M)
        self._watching = True
        self._fly_search()
        self._tell()
        self._approach()
        if not self.stop.is_set():
            self.command("helm/do/return")
            self.wait_for_landing()
        self.completed = not self.stop.is_set()

    def judge(self, criteria: Criteria) -> tuple[dict[str, float], list[str]]:
        """Figures of the flight, and what was wrong with it."""
        there = self._there(self.truth.message) if self.truth is not None else {}
        errors = [float(np.mean(self._errors[name])) for name in there if name in self._errors]
        believed = [p for p in self._roll if p.state in ("seen", "away")]
        strangers = [p for p in believed if not self._claims.get(p.number)]
        doubles = [p for p in believed if len(self._claims.get(p.number, ())) > 1]
        on_map = [self._map_errors.get(p.number, math.inf) for p in believed if p not in strangers]
        figures = {
            "people_in_scene": float(len(there)),
            "people_found": float(len(errors)),
            "people_reported": float(len(believed)),
            "false_people": float(len(strangers)),
            "position_error_mean_m": float(np.mean(errors)) if errors else math.nan,
            "position_error_max_m": max(errors, default=math.nan),
            "map_error_max_m": max(on_map, default=math.nan),
            "closest_m": self._closest_m,
            "people_rate_hz": self._rate_hz(),
            **self._figures,
        }
        faults = []
        missing = sorted(set(there) - set(self._errors))
        if missing:
            faults.append(f"did not find {', '.join(missing)}")
        if strangers:
            faults.append(f"reported people where nobody is: {', '.join(p.name for p in strangers)}")
        if doubles:
            faults.append(f"one number for several people: {', '.join(p.name for p in doubles)}")
        for name in ("position_error_max_m", "map_error_max_m"):
            if figures[name] > _NEAR_M:
                faults.append(f"{name} {figures[name]:.2f}, expected {_NEAR_M:g} or less")
        h_min_m = self._limiter.h_min_m if self._limiter is not None else math.nan
        if not self._closest_m >= h_min_m:
            faults.append(f"came to {self._closest_m:.2f} m of somebody or something, expected {h_min_m:g} or more")
        if "approach_m" not in figures:
            faults.append("nobody was flown up to")
        return figures, faults

    def on_truth(self, received: Received[Truth]) -> None:
        """The world spoke: keep what is of late, and how near everything is."""
        super().on_truth(received)
        self._truths = [*self._truths[-40:], received]
        if self._watching:
            self._closest_m = min([self._closest_m, *(o.distance_m for o in received.message.obstacles)])

    def _on_roll(self, received: Received[People]) -> None:
        for person in received.message.people:
            known = {p.number for p in self._roll if p.state != "provisional"}
            if person.state == "seen" and person.number not in known:
                log.info("found %s at %s", person.name, _place(person))
        self._roll = received.message.people
        for person in self._roll:
            truth = self._truth_at(person.last_seen_ns)
            if person.state == "seen" and person.ned_p_m is not None and truth is not None:
                found = match({person.number: person.ned_p_m}, self._there(truth))
                self._map_errors[person.number] = found[person.number].error_m

    def _on_detections(self, received: Received[PeopleDetections]) -> None:
        """Compare the places of who is seen with the truth of the picture's time."""
        self._looks.append(received.header.capture_ns)
        truth = self._truth_at(received.header.capture_ns)
        believed = {p.number for p in self._roll if p.state in ("seen", "away")}
        found = {p.number: p.ned_p_m for p in received.message.people if p.ned_p_m and p.number in believed}
        if truth is None:
            return
        for number, matched in match(found, self._there(truth)).items():
            if matched.label:
                self._claims.setdefault(number, set()).add(matched.label)
                self._errors.setdefault(matched.label, []).append(matched.error_m)

    def _on_search(self, received: Received[SearchStatus]) -> None:
        self._search = received.message

    def _on_target(self, received: Received[ApproachTarget]) -> None:
        self._target = received.message

    def _on_limiter(self, received: Received[LimiterStatus]) -> None:
        self._limiter = received.message

    @staticmethod
    def _there(truth: Truth) -> dict[str, Sequence[float]]:
        return {o.label: o.ned_p_m for o in truth.obstacles if o.label.startswith("person")}

    def _truth_at(self, t_ns: int) -> Truth | None:
        nearest = min(self._truths, key=lambda r: abs(r.header.capture_ns - t_ns), default=None)
        if nearest is None or abs(nearest.header.capture_ns - t_ns) > _WITHIN_NS:
            return None
        return nearest.message

    def _rate_hz(self) -> float:
        if len(self._looks) < 2:
            return math.nan
        return (len(self._looks) - 1) / ((self._looks[-1] - self._looks[0]) / 1e9)

    def _fly_search(self) -> None:
        start = time.monotonic()
        self.command("search/do/start")
        self.command("helm/do/search")
        self.wait("the beginning of the search", lambda: self._search is not None and self._search.state != "idle", 5.0)
        self.wait("the end of the search", lambda: self._over, _SEARCH_S, self._how_far)
        self._figures["search_s"] = time.monotonic() - start
        log.info("searched for %.0f s: %s", self._figures["search_s"], self._search.reason if self._search else "")
        if not self.stop.is_set():
            self.command("helm/do/hold")

    @property
    def _over(self) -> bool:
        return self._search is not None and self._search.state == "idle"

    @property
    def _chosen(self) -> bool:
        return self._target is not None and self._target.state != "idle"

    def _arrived(self) -> bool:
        target = self._target
        return target is not None and target.state == "tracking" and abs(target.distance_m - target.goal_m) < _GOAL_M

    def _how_far(self) -> str:
        return f"search {self._search}, helm {None if self.status is None else self.status.reason}"

    def _tell(self) -> None:
        for person in self._roll:
            if person.state in ("seen", "away"):
                log.info("%s: %s, in %d pictures, %s", person.name, _place(person), person.pictures, person.state)

    def _approach(self) -> None:
        """Fly up to the person that the operator picks; without one, to the first that was found."""
        if self.stop.is_set():
            return
        believed = [p for p in self._roll if p.state in ("seen", "away") and p.ned_p_m is not None]
        if not believed:
            raise MissionFailed("nobody was found, so there is nobody to fly up to")
        if self._headless:
            self.command("approach/do/select", Command(label=believed[0].label, operator="demo"))
            self.command("helm/do/approach")
        else:
            log.info("pick somebody on the console, or: outrider do approach-select --label 'person N'")
            self.wait("the operator's choice", lambda: self._chosen, _PICK_S)
            self.wait("the approach", lambda: self.status is not None and self.status.state == "approach", _PICK_S)
        self.wait("the end of the approach", self._arrived, _APPROACH_S, lambda: f"approach {self._target}")
        if self.stop.wait(_HOLD_S) or self._target is None:
            return
        self._figures["approach_m"] = self._target.distance_m
        log.info("holds %.2f m above %s", self._target.distance_m, self._target.label)
        self.command("helm/do/hold")


def _place(person: Person) -> str:
    if person.ned_p_m is None:
        return "a place that is not known"
    return f"{person.ned_p_m[0]:.1f} m north, {person.ned_p_m[1]:.1f} m east"
