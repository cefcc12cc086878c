"""People in the console, as text: what the operator calls them, their state, the list with a picture of each."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable, Mapping
from html import escape

import numpy as np

from common.geometry.rotation import Array
from common.messages import Covariance, Person
from ground.console.cards import card, row
from ground.console.overlay import GREEN, GREY, ORANGE, Colour
from ground.console.snapshot import PEOPLE, SEARCH, STATUS, Snapshot

COLOURS: dict[str, Colour] = {"seen": GREEN, "provisional": ORANGE, "away": (74, 168, 255), "dismissed": GREY}
"""Colour of each state, RGB."""
_WORDS = {"seen": "in sight", "provisional": "not sure yet", "away": "out of sight", "dismissed": "dismissed"}


def called(person: Person) -> str:
    """What a person is called on the page: the number, and the name that the operator gave."""
    return person.label if person.name == person.label else f"{person.label}: {person.name}"


def number_of(option: str) -> int | None:
    """Number of the person that an option of a list names, as `called` writes it; None for another option."""
    word, _, number = option.partition(":")[0].rpartition(" ")
    return int(number) if word == "person" and number.isdecimal() else None


def listed(people: Iterable[Person]) -> list[Person]:
    """Who the operator has to do with, by number: nobody who was dismissed."""
    return sorted((p for p in people if p.state != "dismissed"), key=lambda p: p.number)


def state_words(person: Person, seen_ago_s: float | None) -> str:
    """State and last sight in words.

    Args:
        person: who.
        seen_ago_s: time since the last sight, s; None while the vehicle's clock is unknown.
    """
    words = _WORDS[person.state]
    return words if person.state == "seen" or seen_ago_s is None else f"{words}, last seen {ago(seen_ago_s)}"


def ago(seconds: float) -> str:
    """A time in the past in words."""
    seconds = max(seconds, 0.0)
    return f"{seconds:.0f} s ago" if seconds < 120 else f"{seconds / 60:.0f} min ago"


def spread_m(covariance: Covariance) -> tuple[float, float, float]:
    """Horizontal 2-sigma ellipse of a covariance, m²: half axes, m, the larger first, and its direction, rad from
    north, clockwise."""
    nn, ne, _, ee, _, _ = covariance
    values, vectors = np.linalg.eigh(np.array([[nn, ne], [ne, ee]]))
    small, large = (2.0 * math.sqrt(max(float(v), 0.0)) for v in values)
    return large, small, math.atan2(vectors[1, 1], vectors[0, 1])


def ellipse(covariance: Covariance, points: int) -> Array:
    """Points (points + 1, 3) of that ellipse, NED, around its centre, m; the last is the first."""
    large, small, angle = spread_m(covariance)
    t = np.linspace(0.0, 2.0 * math.pi, points + 1)
    along, across = large * np.cos(t), small * np.sin(t)
    c, s = math.cos(angle), math.sin(angle)
    return np.stack((c * along - s * across, s * along + c * across, np.zeros_like(t)), axis=1)


def is_interrupted(view: Snapshot) -> bool:
    """Whether a search was begun and not ended, and helm does not obey it now: it can be gone on with."""
    search, status = view.search, view.status
    begun = search is not None and view.fresh(SEARCH) and search.state == "searching"
    return begun and status is not None and view.fresh(STATUS) and status.state != "search"


def search_html(view: Snapshot) -> str:
    """How far the search over the area is, or how it ended."""
    search = view.search
    if search is None or not view.fresh(SEARCH):
        return card(row("Search", '<span class="d">no word from it</span>'))
    if search.state == "idle":
        return card(row("Search", f'<span class="d">{escape(search.reason)}</span>'))
    lines, line = len(search.way_m) // 2, search.next_corner // 2 + 1
    word = '<b class="o">interrupted</b>' if is_interrupted(view) else '<b class="g">under way</b>'
    left_out = f", {search.skipped} corners left out" if search.skipped else ""
    return card(row("Search", f"{word}, line {min(line, lines)} of {lines}{left_out}"))


def people_html(view: Snapshot) -> str:
    """The list: picture, name, state, place with uncertainty, and how often each was seen."""
    if view.people is None:
        return card(
            '<div class="why">No word of people: the node `people` does not run, or nobody was looked for.</div>'
        )
    old = "" if view.fresh(PEOPLE) else '<div class="why"><b class="o">This list is old.</b></div>'
    people = listed(view.people.people)
    gone = len(view.people.people) - len(people)
    rows = "".join(_row(p, view) for p in people)
    empty = "" if people else '<div class="why">Nobody found yet.</div>'
    more = f'<div class="why">{gone} dismissed</div>' if gone else ""
    return card(f"{old}{_limits(view)}{empty}{rows}{more}")


def _limits(view: Snapshot) -> str:
    reason = view.detections.reason if view.detections is not None else ""
    return f'<div class="why">{escape(reason)}</div>' if reason else ""


def _row(person: Person, view: Snapshot) -> str:
    red, green, blue = COLOURS[person.state]
    seen_ago_s = view.ago_s(person.last_seen_ns)
    name = f"<b>{escape(person.name)}</b>" + ("" if person.name == person.label else f" <i>{escape(person.label)}</i>")
    merged = f", also {', '.join(str(n) for n in person.merged)}" if person.merged else ""
    return (
        f'<div class="man"><span class="face face{person.number}"></span><span>{name}'
        f'<small><i class="dot" style="background:rgb({red},{green},{blue})"></i>'
        f"{escape(state_words(person, seen_ago_s))}</small>"
        f"<small>{place_words(person)}</small><small>{person.pictures} pictures{merged}</small></span></div>"
    )


def place_words(person: Person) -> str:
    """Where somebody is or was, from home, with what it may be off."""
    if person.ned_p_m is None:
        return "place not known"
    north, east, _ = person.ned_p_m
    off = f" ± {spread_m(person.ned_p_cov_m2)[0]:.1f} m" if person.ned_p_cov_m2 is not None else ""
    return f"{abs(north):.1f} m {'N' if north >= 0 else 'S'}, {abs(east):.1f} m {'E' if east >= 0 else 'W'}{off}"


def faces_html(pictures: Mapping[int, bytes]) -> str:
    """Style rules with the picture of each person: apart from the list, whose ages change every second."""
    rules = "".join(
        f".or .face{number}{{background-image:url(data:image/jpeg;base64,{base64.b64encode(jpeg).decode()})}}"
        for number, jpeg in sorted(pictures.items())
    )
    return f"<style>{rules}</style>"
