"""HAB-DF over pictures: several trackers of different kinds as one (Echeverri 2016, chapter 4)."""

from __future__ import annotations

import math
from collections.abc import Mapping

import cv2
import numpy as np
from msgspec.structs import replace

from common.config import Config, Section
from common.evaluation import jaccard
from common.tracking.appearance import Appearance, upright_patch
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

    place: float = 0.05
    """Standard deviation of its centre, target sizes."""
    size: float = 0.1
    """Standard deviation of its height and width, target sizes."""
    vouches: float = 1.0
    """`Source.vouches`."""


CHARACTERS = {
    "particle_filter": Character(place=0.1, size=0.2, vouches=0.4),
    "mil": Character(place=0.15, size=0.4, vouches=0.2),
}
"""By name; another tracker has the defaults. From each one's error while it has the target, on a face, a pedestrian and
a car. The colour filter and MIL also follow what is not the target, so neither alone shows that it is seen."""
_DOUBTFUL = 0.45
"""Relative similarity below which a member's box is doubted if another member's is clearly more similar."""
_CORRELATED = 0.5
"""Correlation with a known patch below which a box is taken for less similar than it is relative to the background."""
_CLEARLY = 0.1
_UNLIKE, _ALONE_UNLIKE = 0.3, 0.5
"""Relative similarity below which it is doubted in any case, and when the other members say that they are lost."""
_SAME = 0.5
"""Overlap above which two boxes are the same."""
_UNDECIDED_S = 0.06
"""How long the answer must have been without support before one member is chosen to speak, s."""
_CHOSEN = 0.5
"""Least relative similarity of the one that is chosen."""
_AGREED = 1.2
"""Least sum of the reliabilities of two members or more that speak for the fused box."""
_BACKGROUND_EVERY = 10
"""Pictures between two looks for what else is like the target."""
_APART = 0.2
"""Largest overlap with the target of what counts as background."""


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
        self._witness = Appearance()
        self._number = 0
        self._supported_ns = 0
        self._chosen: str | None = None

    @classmethod
    def make(cls, config: Config, rng: np.random.Generator) -> HabDfTracker:
        """One with the members that the configuration names, each with its own section and randomness.

        Raises:
            ConfigError: unknown member.
        """
        from common.tracking.registry import make_tracker  # the registry names this class

        own = config.section(HabDfConfig)
        names = own.members
        members = {
            name: make_tracker(name, config, child) for name, child in zip(names, rng.spawn(len(names)), strict=True)
        }
        fusion = replace(
            config.section(FusionConfig),
            vote_slope=own.vote_slope,
            vote_lambda=own.vote_lambda,
            common_jumps=own.common_jumps,
        )
        return cls(members, fusion)

    def init(self, frame: np.ndarray, box: Box, angle_rad: float = 0.0, t_ns: int | None = None) -> None:
        """Start every member on the target."""
        check_frame(frame)
        check_box(frame, box, angle_rad)
        for member in self.members.values():
            member.init(frame, box, angle_rad, t_ns)
        self._fusion = Fusion([source_of(name) for name in self.members], self._config)
        self._set_unit(box[2], box[3])
        self.answers, self.fused = {}, None
        self._witness, self._number = Appearance(), 0
        self._supported_ns, self._chosen = 0 if t_ns is None else t_ns, None
        grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
        self._witness.learn_target(upright_patch(grey, box))
        self._learn_background(grey, box)

    def expect(self, expectation: Expectation) -> None:
        """Pass it on to every member."""
        for member in self.members.values():
            member.expect(expectation)

    def update(self, frame: np.ndarray, t_ns: int) -> TrackResult:
        """Ask every member, fuse their answers, and put those that have drifted back on the fused one."""
        if self._fusion is None:
            raise ValueError("hab-df: update before init; select a target first")
        before = self.answers
        self.answers = {name: member.update(frame, t_ns) for name, member in self.members.items()}
        for name, answer in self.answers.items():
            if answer.state == "tracking" and name in before and before[name].state != "tracking":
                self._fusion.forget(name)  # it has found the target again, maybe elsewhere
        grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
        similar = self._similar(grey)
        doubted = self._doubted(similar)
        self._choose(similar, t_ns)
        said = [
            measurement_of(n, r, t_ns, n in doubted) if self._speaks(n) else Measurement(n, t_ns, None)
            for n, r in self.answers.items()
        ]
        self.fused = self._fusion.step(said, t_ns)
        if self.fused.state == "waiting":
            return next(iter(self.answers.values()))
        u, v, height, width = self.fused.value.tolist()
        if self.fused.state == "tracking":
            self._size = (max(width, _LEAST_SIDE_PX), max(height, _LEAST_SIDE_PX))
            self._set_unit(*self._size)
            self._learn(grey, (u - width / 2, v - height / 2, width, height))
        self._restart(frame, grey, t_ns, u, v)
        return TrackResult(
            (u, v), self._size, 0.0, self.fused.confidence, 0.5, _STATES[self.fused.state], angle_std_rad=0.0
        )

    def _similar(self, grey: np.ndarray) -> dict[str, float]:
        """How much the box of each member that has one looks like the target, in the picture (H, W) uint8, 0 to 1."""
        return {
            name: self._likeness(grey, upright_box(answer))
            for name, answer in self.answers.items()
            if answer.state == "tracking"
        }

    def _likeness(self, grey: np.ndarray, box: Box) -> float:
        """Relative similarity of a box, less where it correlates with no known patch of the target.

        While little is known of the background, anything is more like the target than like that.
        """
        similarity, correlation = self._witness.similarity(upright_patch(grey, box))
        return similarity * min(1.0, max(0.0, correlation / _CORRELATED))

    def _doubted(self, similar: Mapping[str, float]) -> set[str]:
        """Members whose box looks less like the target than another's does, or like nothing known."""
        best = max(similar.values(), default=0.0)
        least = _ALONE_UNLIKE if len(similar) == 1 and len(self.answers) > 1 else _UNLIKE
        return {n for n, s in similar.items() if s < least or (s < _DOUBTFUL and s < best - _CLEARLY)}

    def _choose(self, similar: Mapping[str, float], t_ns: int) -> None:
        """While members disagree and the past supports none of them, let the one that looks most like the target speak.

        Beyond the thesis, where all are then penalised alike and the answer drifts between them. The choice is kept
        until the answer is supported again, or another looks clearly more like the target.
        """
        if self.fused is None or self.fused.state == "tracking":
            self._supported_ns, self._chosen = t_ns, None
        elif t_ns - self._supported_ns >= _UNDECIDED_S * 1e9:
            best = max(similar, key=lambda name: similar[name], default=None)
            if best is None or similar[best] < _CHOSEN:
                self._chosen = None
            elif self._chosen is None or similar.get(self._chosen, 0.0) < similar[best] - _CLEARLY:
                self._chosen = best
                if self._fusion is not None:
                    for name in (best, *self._agree_with(best)):
                        self._fusion.forget(name)

    def _agree_with(self, name: str) -> list[str]:
        """The other members whose box overlaps that of this one by half."""
        box = upright_box(self.answers[name])
        return [
            other
            for other, answer in self.answers.items()
            if other != name and answer.state == "tracking" and jaccard(upright_box(answer), box) > _SAME
        ]

    def _speaks(self, name: str) -> bool:
        """Whether a member is heard: all are, unless one was chosen, and then those that agree with it."""
        return self._chosen is None or name == self._chosen or name in self._agree_with(self._chosen)

    def _learn(self, grey: np.ndarray, box: Box) -> None:
        """Let the witness learn the fused box where members that agree speak for it, and what else is like it."""
        self._number += 1
        if self._agreed():
            self._witness.learn_target(upright_patch(grey, box))
            if self._number % _BACKGROUND_EVERY == 0:
                self._learn_background(grey, box)

    def _agreed(self) -> bool:
        """Whether two members or more speak for the fused box."""
        sources = {} if self.fused is None else self.fused.sources
        agreeing = [j.reliability for j in sources.values() if j.reliability > 0.5]
        return len(agreeing) >= 2 and sum(agreeing) >= _AGREED

    def _learn_background(self, grey: np.ndarray, box: Box) -> None:
        for candidate in self._witness.search(grey, (box[2], box[3]), (1.0,), 4):
            if jaccard(candidate.box, box) < _APART:
                self._witness.learn_background(upright_patch(grey, candidate.box))

    def _set_unit(self, width: float, height: float) -> None:
        if self._fusion is not None:
            self._fusion.unit = np.full(4, math.sqrt(width * height))
        self._size = (width, height)

    def _restart(self, frame: np.ndarray, grey: np.ndarray, t_ns: int, u: float, v: float) -> None:
        """Put drifted members on the fused answer; one that keeps what it has learned is only moved there."""
        if self.fused is None or self._fusion is None:
            return
        width, height = self._size
        box = (u - width / 2, v - height / 2, width, height)
        if not self._agreed() and self._likeness(grey, box) < _ALONE_UNLIKE:
            return  # it rests on one member, and does not look like the target
        for name in self.fused.restart:
            if self.answers[name].state == "tracking" and not self._agreed():
                continue  # it is as sure as the one that it would be made to follow
            member = self.members[name]
            try:
                if isinstance(member, Placeable):
                    member.place(frame, box)
                else:
                    member.init(frame, box, 0.0, t_ns)
            except ValueError:
                continue  # the box leaves the picture: there is nothing to start on yet
            self._fusion.forget(name)


def source_of(name: str) -> Source:
    """A tracker of the registry as a source of the fusion."""
    character = CHARACTERS.get(name, Character())
    noise = (character.place, character.place, character.size, character.size)
    return Source(name, noise, threshold=0.5, vouches=character.vouches)


def measurement_of(name: str, answer: TrackResult, t_ns: int, doubted: bool = False) -> Measurement:
    """A member's answer as u, v, h, w, and its score brought to a threshold of one half, below it when doubted."""
    if answer.state != "tracking":
        return Measurement(name, t_ns, None)
    x, y, width, height = upright_box(answer)
    confidence = min(1.0, 0.5 * answer.score / answer.score_limit) if answer.score_limit > 0 else answer.score
    confidence *= 0.5 if doubted else 1.0
    return Measurement(name, t_ns, np.array([x + width / 2, y + height / 2, height, width]), confidence)
