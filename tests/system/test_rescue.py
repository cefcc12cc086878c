"""Search and rescue as its operator flies it, through real processes and a real browser: the search begun on the page,
everybody found where they are, one of them picked on the page and flown up to.
"""

from __future__ import annotations

import math
import time
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser

from common.geometry.rotation import euler_from_quat, wrap_angle
from common.messages import ApproachTarget, Person
from common.truth import Truth
from simulation.demo.rescue import match
from tests.browser.view import View, chromium_started, open_view
from tests.system.console_page import ConsolePage
from tests.system.flight import Flight, Seen
from tests.system.stack import Stack

NEAR_M = 0.5
GOAL_M = 0.4
FACES_RAD = 0.3
HOLDS_S = 1.5
SOME_WAY_M = 3.0
LOW_M = 0.5
"""The middle of whoever lies or sits is lower than this above the ground, m."""


@pytest.mark.timeout(200)  # its own limits add up to that
def test_everybody_is_found_where_they_are_and_the_one_picked_on_the_page_is_flown_up_to(tmp_path: Path) -> None:
    stack = Stack(tmp_path, ("search.speed_m_s=2.0",), vehicle="osprey")
    with chromium_started() as browser:
        try:
            for side in ("onboard", "sim"):
                stack.start(side)
            stack.start("ground", "--without", "pursuit", "--without", "recorder")
            flight = Flight(stack)
            closest_m, h_min_m = Rescue(flight, browser).fly()
        finally:
            stack.end()
    assert closest_m >= h_min_m


class Rescue:
    """An operator at the page, and the truth to compare with.

    Args:
        flight: the vehicle, on the ground.
        browser: where the page is opened.
    """

    def __init__(self, flight: Flight, browser: Browser):
        self._flight, self._browser = flight, browser
        bus = flight.bus
        self._roll, self._seen = Seen(bus, "people/tracks"), Seen(bus, "people/detections")
        self._search, self._target = Seen(bus, "search/status"), Seen(bus, "approach/target")
        self._pictures, self._limiter = Seen(bus, "people/pictures"), Seen(bus, "helm/limiter")

    def fly(self) -> tuple[float, float]:
        """The whole rescue; the least true distance to anything in it, and the limiter's h_min, m."""
        flight = self._flight
        flight.take_off(5.0)
        airborne_ns = time.monotonic_ns()
        self._search_area()
        believed = self._found()
        view = open_view(self._browser, f"http://127.0.0.1:{self._flight.stack.console_port}")
        self._approach(view, believed)
        truths: list[Truth] = [r.message for r in flight.truth.since(airborne_ns)]
        closest_m, nearest = min((o.distance_m, o.label) for truth in truths for o in truth.obstacles)
        print(f"closest {closest_m:.2f} m, to {nearest}")
        return closest_m, self._limiter.last.h_min_m

    def _search_area(self) -> None:
        """By the page's button; no browser looks while it is flown: one with software GL takes a core for itself."""
        flight, search = self._flight, self._search
        with ConsolePage(flight.stack.console_port) as page:
            page.press("Search area")
        flight.wait(
            "beginning of the search", lambda: search.last.state == "searching" and flight.state == "search", 10
        )
        begun_ns = time.monotonic_ns()
        took_s = flight.wait("end of the search", lambda: search.last.state == "idle", 60)
        assert search.last.reason == "flown to its end"
        looked = [r.received_ns for r in self._seen.since(begun_ns)]
        rate_hz = (len(looked) - 1) / ((looked[-1] - looked[0]) / 1e9)
        print(f"search {took_s:.0f} s, people at {rate_hz:.1f} Hz")
        flight.check_machine()  # now: a browser with software GL would be the reason later
        assert rate_hz >= 10.0, "pictures searched a second, of the camera's fifteen"

    def _found(self) -> list[Person]:
        """Everybody, once each, where they are."""
        believed: list[Person] = [p for p in self._roll.last.people if p.state in ("seen", "away")]
        errors = self._errors_m({p.number for p in believed})
        on_map = {p.label: self._map_error_m(p) for p in believed}
        there = {o.label for o in self._flight.truth.last.obstacles if o.label.startswith("person")}
        told = {who: f"{np.mean(all_m):.2f}, {max(all_m):.2f}, {len(all_m)}" for who, all_m in errors.items()}
        places = ", ".join(f"{who} {error_m:.2f}" for who, error_m in on_map.items())
        print(f"errors on the map, m: {places}; mean, largest, number of the looks: {told}")
        assert set(errors) == there, f"found {sorted(errors)}; {_told(believed)}"
        assert len(believed) == len(there), f"nobody twice, nobody who is not there: {_told(believed)}"
        assert max(on_map.values()) <= NEAR_M
        assert max(sum(values) / len(values) for values in errors.values()) <= NEAR_M
        return believed

    def _approach(self, view: View, believed: list[Person]) -> None:
        """Pick the nearest of those who lie or sit some way off, and see them flown up to."""
        flight, target = self._flight, self._target
        low = {p.label: p.ned_p_m for p in believed if p.ned_p_m is not None and p.ned_p_m[2] > -LOW_M}
        away_m = {name: math.dist(place[:2], flight.truth.last.ned_p_m[:2]) for name, place in low.items()}
        label = min((name for name in low if away_m[name] > SOME_WAY_M), key=lambda name: away_m[name])
        view.page.get_by_role("tab", name="People").click()
        view.choose("Person", label)
        view.button("Approach this one")
        flight.wait("approach", lambda: flight.state == "approach", 10)
        begun_ns = time.monotonic_ns()
        flight.wait("a hold before them", lambda: self._holds(label), 40)
        held_ns = time.monotonic_ns() - round(HOLDS_S * 1e9)
        # One goes out a second, of those first of whom none did.
        numbers = {p.number for p in believed}
        flight.wait("a picture of each", lambda: {p.message.number for p in self._pictures.all} >= numbers, 8)

        truths: list[Truth] = [r.message for r in flight.truth.since(held_ns)]
        who = match({0: low[label]}, _people(truths[-1]))[0].label
        distances = [o.distance_m for truth in truths for o in truth.obstacles if o.label == who]
        off_rad = _off_nose_rad([r.message for r in flight.truth.since(begun_ns)], who)
        goal_m = target.last.goal_m
        print(
            f"approach: {away_m[label]:.1f} m to {label}; holds {min(distances):.2f} to {max(distances):.2f} m from "
            f"them in truth, flew up to where they are on the map {off_rad:.2f} rad off the nose or less"
        )
        assert all(abs(d - goal_m) < GOAL_M + NEAR_M for d in distances), "in truth as well"
        assert -truths[-1].ned_p_m[2] < 4.5, "it sank towards the person"
        assert off_rad < FACES_RAD, "it faces whom it flies up to"

    def _holds(self, label: str) -> bool:
        """Whether the vehicle has been where it should be for a while: it sinks a little further than it is asked to,
        and does not climb again while the limiter lets it be so near.
        """
        told: list[ApproachTarget] = [r.message for r in self._target.since(time.monotonic_ns() - round(HOLDS_S * 1e9))]
        nearest_m = self._limiter.last.h_desired_m
        return len(told) > 5 and all(
            t.state == "tracking" and t.label == label and nearest_m <= t.distance_m < t.goal_m + GOAL_M for t in told
        )

    def _errors_m(self, believed: set[int]) -> dict[str, list[float]]:
        """Horizontal errors of whoever is reported, by the person of the scene that they are, picture by picture."""
        errors: dict[str, list[float]] = {}
        claims: dict[int, set[str]] = {}
        for received in self._seen.all:
            truth = self._truth_at(received.header.capture_ns)
            found = {p.number: p.ned_p_m for p in received.message.people if p.number in believed and p.ned_p_m}
            if truth is None or not found:
                continue
            for number, matched in match(found, _people(truth)).items():
                if matched.label:
                    claims.setdefault(number, set()).add(matched.label)
                    errors.setdefault(matched.label, []).append(matched.error_m)
        assert all(len(who) == 1 for who in claims.values()), f"one number, one person: {claims}"
        return errors

    def _map_error_m(self, person: Person) -> float:
        """Horizontal error of a place on the map, at the time of the last sight, m; infinite for nobody's."""
        truth = self._truth_at(person.last_seen_ns)
        if truth is None or person.ned_p_m is None:
            return math.inf
        return match({person.number: person.ned_p_m}, _people(truth))[person.number].error_m

    def _truth_at(self, t_ns: int) -> Truth | None:
        nearest = min(self._flight.truth.all, key=lambda received: abs(received.header.capture_ns - t_ns))
        return nearest.message if abs(nearest.header.capture_ns - t_ns) <= 150_000_000 else None


def _people(truth: Truth) -> dict[str, tuple[float, float, float]]:
    return {o.label: o.ned_p_m for o in truth.obstacles if o.label.startswith("person")}


def _off_nose_rad(truths: list[Truth], who: str) -> float:
    """Greatest angle between nose and somebody, horizontally, rad, between two metres and one from them.

    Beside what a place on the map explains that is as wrong as it may be: the nose is turned to that place.
    """
    angles = []
    for truth in truths:
        place = _people(truth)[who]
        north, east = place[0] - truth.ned_p_m[0], place[1] - truth.ned_p_m[1]
        level_m = math.hypot(north, east)
        if 1.0 < level_m < 2.0:
            off_rad = abs(wrap_angle(math.atan2(east, north) - euler_from_quat(truth.ned_q_body)[2]))
            angles.append(max(0.0, off_rad - math.asin(NEAR_M / level_m)))
    return max(angles)


def _told(people: list[Person]) -> str:
    """Who was reported, for a failed assertion."""
    return ", ".join(f"{p.name} {p.state} at {p.ned_p_m} in {p.pictures} pictures" for p in people)
