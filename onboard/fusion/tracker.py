"""HAB-DF over pictures: several trackers of different kinds as one (Echeverri 2016, chapter 4)."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from common.config import Config, Section
from common.tracking.base import (
    Box,
    Expectation,
    Placeable,
    Tracker,
    TrackResult,
    TrackState,
    check_box,
    check_frame,
    upright_box,
)
from onboard.fusion.center import Fused, Fusion
from onboard.fusion.config import FusionConfig, HabDfConfig
from onboard.fusion.source import Measurement, Source

_LEAST_SIDE_PX = 6.0
_STATES: Mapping[str, TrackState] = {
    "waiting": "lost",
    "tracking": "tracking",
    "predicted": "predicted",
    "lost": "lost",
}


class Character(Section, frozen=True, kw_only=True):
    """What is known of a kind of tracker beforehand: Γ of eq. 4.8, and what its word is worth."""

    place: float = 0.1
    """Standard deviation of its centre, target sizes."""
    size: float = 0.15
    """Standard deviation of its height and width, target sizes."""
    vouches: float = 1.0
    """`Source.vouches`."""


CHARACTERS = {
    "dsst": Character(place=0.03, size=0.05),
    "cmt": Character(place=0.06, size=0.1),
    "particle_filter": Character(place=0.1, size=0.2, vouches=0.4),
    "struck": Character(place=0.05, size=0.1),
    "mil": Character(place=0.15, size=0.4, vouches=0.2),
}
"""By name; another tracker has the defaults. From each one's error while it has the target, on a face, a pedestrian and
a car. The colour filter and MIL also follow what is not the target, so neither alone shows that it is seen."""


class HabDfTracker:
    """Several trackers, fused. See `common.tracking.base.Tracker`.

    Args:
        members: trackers by name.
        config: parameters of the fusion.
    """

    config_type = HabDfConfig

    def __init__(self, members: Mapping[str, Tracker], config: FusionConfig):
        self.members = dict(members)
        self.answers: dict[str, TrackResult] = {}
        """What each member said last."""
        self.fused: Fused | None = None
        """What came of it."""
        self._config = config
        self._fusion: Fusion | None = None
        self._size = (1.0, 1.0)

    @classmethod
    def make(cls, config: Config, rng: np.random.Generator) -> HabDfTracker:
        """One with the members that the configuration names, each with its own section and randomness.

        Raises:
            ConfigError: unknown member.
        """
        from common.tracking.registry import make_tracker  # the registry names this class

        names = config.section(HabDfConfig).members
        members = {
            name: make_tracker(name, config, child) for name, child in zip(names, rng.spawn(len(names)), strict=True)
        }
        return cls(members, config.section(FusionConfig))

    def init(self, frame: np.ndarray, box: Box, angle_rad: float = 0.0, t_ns: int | None = None) -> None:
        """Start every member on the target."""
        check_frame(frame)
        check_box(frame, box, angle_rad)
        for member in self.members.values():
            member.init(frame, box, angle_rad, t_ns)
        self._fusion = Fusion([_source(name) for name in self.members], self._config)
        self._set_unit(box[2], box[3])
        self.answers, self.fused = {}, None

    def expect(self, expectation: Expectation) -> None:
        """Pass it on to every member."""
        for member in self.members.values():
            member.expect(expectation)

    def update(self, frame: np.ndarray, t_ns: int) -> TrackResult:
        """Ask every member, fuse their answers, and put those that have drifted back on the fused one."""
        if self._fusion is None:
            raise ValueError("hab-df: update before init; select a target first")
        self.answers = {name: member.update(frame, t_ns) for name, member in self.members.items()}
        self.fused = self._fusion.step([_measurement(n, r, t_ns) for n, r in self.answers.items()], t_ns)
        if self.fused.state == "waiting":
            return next(iter(self.answers.values()))
        u, v, height, width = self.fused.value.tolist()
        if self.fused.state == "tracking":
            self._size = (max(width, _LEAST_SIDE_PX), max(height, _LEAST_SIDE_PX))
            self._set_unit(*self._size)
        self._restart(frame, t_ns, u, v)
        return TrackResult(
            (u, v), self._size, 0.0, self.fused.confidence, 0.5, _STATES[self.fused.state], angle_std_rad=0.0
        )

    def _set_unit(self, width: float, height: float) -> None:
        if self._fusion is not None:
            self._fusion.unit = np.full(4, math.sqrt(width * height))
        self._size = (width, height)

    def _restart(self, frame: np.ndarray, t_ns: int, u: float, v: float) -> None:
        """Put drifted members on the fused answer; one that keeps what it has learned is only moved there."""
        if self.fused is None or self._fusion is None:
            return
        width, height = self._size
        box = (u - width / 2, v - height / 2, width, height)
        for name in self.fused.restart:
            member = self.members[name]
            try:
                if isinstance(member, Placeable):
                    member.place(frame, box)
                else:
                    member.init(frame, box, 0.0, t_ns)
            except ValueError:
                continue  # the box leaves the picture: there is nothing to start on yet
            self._fusion.forget(name)


def _source(name: str) -> Source:
    character = CHARACTERS.get(name, Character())
    noise = (character.place, character.place, character.size, character.size)
    return Source(name, noise, threshold=0.5, vouches=character.vouches)


def _measurement(name: str, answer: TrackResult, t_ns: int) -> Measurement:
    """A member's answer as u, v, h, w, and its score brought to a threshold of one half."""
    if answer.state != "tracking":
        return Measurement(name, t_ns, None)
    x, y, width, height = upright_box(answer)
    confidence = min(1.0, 0.5 * answer.score / answer.score_limit) if answer.score_limit > 0 else answer.score
    return Measurement(name, t_ns, np.array([x + width / 2, y + height / 2, height, width]), confidence)
