"""The roll of people: names, and what the operator says of them."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping
from types import MappingProxyType

from common.geometry.rotation import Array, as_vec3
from common.messages import Command, Covariance, People, Person, Reply, person_label
from onboard.people.identity import Track
from onboard.people.pipeline import PeoplePipeline

_LABEL = re.compile(r"person (\d+)")
_LONGEST_NAME = 40


class OrderRefused(ValueError):
    """An order that cannot be obeyed; the text says why."""


class Roll:
    """Names of the people of a pipeline, and the operator's orders about them.

    Args:
        pipeline: who was found.
    """

    def __init__(self, pipeline: PeoplePipeline):
        self._pipeline = pipeline
        self._names: dict[int, str] = {}

    def obey(self, order: str, command: Command) -> Reply:
        """Rename, merge or dismiss somebody.

        Args:
            order: `people/do/rename`, `people/do/merge` or `people/do/dismiss`.
            command: `label`, and `name` or `into`.
        """
        try:
            return Reply(outcome="done", reason=_ORDERS[order](self, command))
        except OrderRefused as refused:
            return Reply(outcome="refused", reason=str(refused))

    def people(self, shown: Collection[int], t_ns: int) -> People:
        """Everybody.

        Args:
            shown: numbers of those who are in the newest picture.
            t_ns: now, for velocities.
        """
        tracks = sorted(self._pipeline.tracks, key=lambda track: track.number)
        return People(people=tuple(self._person(track, track.number in shown, t_ns) for track in tracks))

    def name(self, number: int) -> str:
        """What the operator calls a person, or called somebody who turned out to be that person."""
        others = next((track.merged for track in self._pipeline.tracks if track.number == number), ())
        return next((self._names[n] for n in (number, *others) if n in self._names), person_label(number))

    def _person(self, track: Track, shown: bool, t_ns: int) -> Person:
        state = "seen" if shown else "away"
        return Person(
            number=track.number,
            name=self.name(track.number),
            state="dismissed" if track.dismissed else state if track.confirmed else "provisional",
            ned_p_m=None if track.ned_p_m is None else as_vec3(track.ned_p_m),
            ned_p_cov_m2=None if track.ned_p_cov_m2 is None else triangle(track.ned_p_cov_m2),
            ned_v_m_s=as_vec3(self._pipeline.walks.ned_v_m_s(track.number, t_ns)),
            first_seen_ns=track.first_ns,
            last_seen_ns=track.seen_ns,
            pictures=track.hits,
            merged=track.merged,
        )

    def _rename(self, command: Command) -> str:
        number, name = self._number("label", command.label), " ".join(command.name.split())
        if not name or len(name) > _LONGEST_NAME or not name.isprintable():
            raise OrderRefused(f"name: got {command.name!r}, expected 1 to {_LONGEST_NAME} printable characters")
        others = {self.name(track.number) for track in self._pipeline.tracks if track.number != number}
        if name in others or (_LABEL.fullmatch(name) and name != person_label(number)):
            raise OrderRefused(f"name: got {name!r}, which is somebody else's; expected one of its own")
        before = self.name(number)
        self._names[number] = name
        return f"{before} is called {name} now"

    def _merge(self, command: Command) -> str:
        number, into = self._number("label", command.label), self._number("into", command.into)
        if number == into:
            raise OrderRefused(f"label and into: got {person_label(number)} twice, expected two people")
        gone = self.name(number)
        self._pipeline.merge(number, into)
        return f"{gone} and {person_label(into)} are one person, {self.name(into)}"

    def _dismiss(self, command: Command) -> str:
        number = self._number("label", command.label)
        self._pipeline.tracker.dismiss(number)
        return f"{self.name(number)} counts as nobody from now on"

    def _number(self, field: str, label: str) -> int:
        """Number of the person of a label or name."""
        for track in self._pipeline.tracks:
            if label in (person_label(track.number), self.name(track.number)):
                return track.number
        known = ", ".join(self.name(track.number) for track in self._pipeline.tracks) or "nobody was found yet"
        for track in self._pipeline.tracks:
            if label in map(person_label, track.merged):
                raise OrderRefused(f"{field}: {label} is one with {person_label(track.number)}")
        raise OrderRefused(f"{field}: got {label!r}, which is nobody; expected one of: {known}")


_ORDERS: Mapping[str, Callable[[Roll, Command], str]] = MappingProxyType(
    {"people/do/rename": Roll._rename, "people/do/merge": Roll._merge, "people/do/dismiss": Roll._dismiss}
)
ORDERS = tuple(_ORDERS)
"""Commands that the roll obeys."""


def triangle(covariance: Array) -> Covariance:
    """Upper triangle of a symmetric (3, 3) matrix as messages carry it."""
    (a, b, c), (_, d, e), (_, _, f) = covariance.tolist()
    return (a, b, c, d, e, f)
