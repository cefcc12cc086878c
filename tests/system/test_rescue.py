"""Search and rescue through real processes: everybody in the area is found where they are, and flown up to."""

from __future__ import annotations

import math
import time
from pathlib import Path

from common.messages import Command, Person
from common.truth import Truth
from simulation.demo.rescue import match
from tests.system.stack import Flight, Seen, Stack

NEAR_M = 0.5


def test_everybody_is_found_where_they_are_and_one_is_flown_up_to(tmp_path: Path) -> None:
    stack = Stack(tmp_path, ("search.speed_m_s=2.0",), vehicle="osprey")
    try:
        stack.start("onboard")
        stack.start("sim")
        stack.start("ground", "--without", "console", "--without", "pursuit", "--without", "recorder")
        _fly(Flight(stack))
    finally:
        stack.end()


def _fly(flight: Flight) -> None:
    roll, seen = Seen(flight.bus, "people/tracks"), Seen(flight.bus, "people/detections")
    search, target = Seen(flight.bus, "search/status"), Seen(flight.bus, "approach/target")
    pictures, limiter = Seen(flight.bus, "people/pictures"), Seen(flight.bus, "helm/limiter")
    flight.take_off(5.0)
    airborne_ns = time.monotonic_ns()
    flight.must("search/do/start")
    flight.must("helm/do/search")
    flight.wait("beginning of the search", lambda: search.last is not None and search.last.state == "searching", 5)
    took_s = flight.wait("end of the search", lambda: search.last.state == "idle", 60)
    assert search.last.reason == "flown to its end"

    believed = [p for p in roll.last.people if p.state in ("seen", "away")]
    errors = _errors_m(flight, seen, {p.number for p in believed})
    there = {o.label for o in flight.truth.last.obstacles if o.label.startswith("person")}
    told = {who: f"{max(values):.2f} of {len(values)}" for who, values in errors.items()}
    rate_hz = (len(seen.all) - 1) / ((seen.all[-1].received_ns - seen.all[0].received_ns) / 1e9)
    print(f"search {took_s:.0f} s, people at {rate_hz:.1f} Hz, largest errors {told}")
    assert set(errors) == there, f"found {sorted(errors)}; {_told(believed)}"
    assert max(sum(values) / len(values) for values in errors.values()) <= NEAR_M
    assert len(believed) == len(there), f"nobody twice, nobody who is not there: {_told(believed)}"
    # One goes out a second, of those first of whom none did: whoever was found last is still to come.
    numbers = {p.number for p in believed}
    flight.wait("a picture of each", lambda: {p.message.number for p in pictures.all} >= numbers, 8)

    chosen: Person = believed[0]
    flight.must("approach/do/select", Command(label=chosen.label, operator="test"))
    flight.must("helm/do/approach")
    flight.wait(
        "end of the approach",
        lambda: target.last.state == "tracking" and abs(target.last.distance_m - target.last.goal_m) < 0.4,
        30,
    )
    truths: list[Truth] = [r.message for r in flight.truth.since(airborne_ns)]
    closest_m = min(o.distance_m for truth in truths for o in truth.obstacles)
    print(f"approach: {target.last.distance_m:.2f} m from {chosen.label}; closest {closest_m:.2f} m")
    assert closest_m >= limiter.last.h_min_m
    assert -truths[-1].ned_p_m[2] < 4.5, "it sank towards the person"
    flight.check_machine()


def _errors_m(flight: Flight, seen: Seen, believed: set[int]) -> dict[str, list[float]]:
    """Horizontal errors of whoever is reported, by the person of the scene that they are, picture by picture."""
    truths = [(r.header.capture_ns, r.message) for r in flight.truth.all]
    errors: dict[str, list[float]] = {}
    claims: dict[int, set[str]] = {}
    for received in seen.all:
        stamp_ns, truth = min(truths, key=lambda entry: abs(entry[0] - received.header.capture_ns))
        if abs(stamp_ns - received.header.capture_ns) > 150_000_000:
            continue
        there = {o.label: o.ned_p_m for o in truth.obstacles if o.label.startswith("person")}
        found = {p.number: p.ned_p_m for p in received.message.people if p.number in believed and p.ned_p_m}
        for number, matched in match(found, there).items():
            if matched.label:
                claims.setdefault(number, set()).add(matched.label)
                errors.setdefault(matched.label, []).append(matched.error_m)
    assert all(len(who) == 1 for who in claims.values()), f"one number, one person: {claims}"
    assert all(math.isfinite(e) for values in errors.values() for e in values)
    return errors


def _told(people: list[Person]) -> str:
    """Who was reported, for a failed assertion."""
    return ", ".join(f"{p.name} {p.state} at {p.ned_p_m} in {p.pictures} pictures" for p in people)
