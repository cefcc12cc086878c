"""HAB-DF over pictures: several trackers of different kinds as one (Echeverri 2016, chapter 4)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace as altered

import cv2
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
    upright_around,
    upright_box,
)
from onboard.fusion.camera_motion import CameraMotion, expectation, tell
from onboard.fusion.center import Fused, Fusion
from onboard.fusion.config import FusionConfig, HabDfConfig
from onboard.fusion.outline import Outline
from onboard.fusion.source import Measurement, Source
from onboard.fusion.witness import Witness, agreed

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
    "tld": Character(size=0.2),
}
"""By name; another tracker has the defaults. From each one's error while it has the target, on a face, a pedestrian and
a car. TLD's windows have sizes a fifth apart. The colour filter and MIL also follow what is not the target, so neither
alone shows that it is seen."""


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
        self._witness: Witness | None = None
        self._camera = CameraMotion()
        self._outline = Outline()
        self._told = False

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
        return cls(members, own.of_boxes(config.section(FusionConfig)))

    def init(self, frame: np.ndarray, box: Box, angle_rad: float = 0.0, t_ns: int | None = None) -> None:
        """Start every member on the upright box around the target."""
        check_frame(frame)
        check_box(frame, box, angle_rad)
        box = upright_around(box, angle_rad)
        for member in self.members.values():
            member.init(frame, box, 0.0, t_ns)
        self._fusion = Fusion([source_of(name) for name in self.members], self._config)
        self._set_unit(box[2], box[3])
        self.answers, self.fused = {}, None
        grey, start_ns = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY), 0 if t_ns is None else t_ns
        self._witness = Witness(grey, box, start_ns)
        self._camera, self._told = CameraMotion(), False
        self._outline = Outline()
        self._outline.whole(grey, start_ns, self._camera.see(grey, start_ns), box)

    def expect(self, expectation: Expectation) -> None:
        """Pass it on to every member; it knows more than the picture's own shift, which is then not told."""
        self._told = True
        for member in self.members.values():
            member.expect(expectation)

    def update(self, frame: np.ndarray, t_ns: int) -> TrackResult:
        """Ask every member, fuse their answers, and put those that have drifted back on the fused one."""
        if self._fusion is None or self._witness is None:
            raise ValueError("hab-df: update before init; select a target first")
        grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
        was, place = self._camera.last, self._camera.see(grey, t_ns)
        moved = place - was
        last = None if self.fused is None else shifted(self.fused, moved)
        self._tell(moved)
        before = self.answers
        self.answers = {name: member.update(frame, t_ns) for name, member in self.members.items()}
        for name, answer in self.answers.items():
            if answer.state == "tracking" and name in before and before[name].state != "tracking":
                self._fusion.forget(name)  # it has found the target again, maybe elsewhere
        boxes = {name: upright_box(answer) for name, answer in self.answers.items() if answer.state == "tracking"}
        verdict = self._witness.judge(grey, boxes, len(self.members) > 1, last, t_ns)
        for name in verdict.begun:
            self._fusion.forget(name, follow=True)
        said = [
            Measurement(name, t_ns, None)
            if name in verdict.silent
            else measurement_of(name, answer, t_ns, place, name in verdict.doubted)
            for name, answer in self.answers.items()
        ]
        fused = self.fused = shifted(self._fusion.step(said, t_ns), place)
        if fused.state == "waiting":
            return next(iter(self.answers.values()))
        u, v, height, width = fused.value.tolist()
        if fused.state == "tracking":
            self._set_unit(max(width, _LEAST_SIDE_PX), max(height, _LEAST_SIDE_PX))
            self._witness.learn(grey, (u - width / 2, v - height / 2, width, height), fused)
        box = (u - self._size[0] / 2, v - self._size[1] / 2, *self._size)
        if self._witness.vouches(grey, box, fused):
            self._restart(frame, box, fused, t_ns)
        outlined = self._outlined(grey, box, fused, place)
        center = outlined[0] + outlined[2] / 2, outlined[1] + outlined[3] / 2
        return TrackResult(center, outlined[2:], 0.0, fused.confidence, 0.5, _STATES[fused.state], angle_std_rad=0.0)

    def _outlined(self, grey: np.ndarray, box: Box, fused: Fused, place: np.ndarray) -> Box:
        """The whole target around the fused box, which members of fixed shape may have left on one side of it."""
        if fused.state == "tracking":
            return self._outline.whole(grey, fused.t_ns, place, box)
        self._outline.rest()
        return self._outline.around(box)

    def _tell(self, moved: np.ndarray) -> None:
        """Let every member search this picture where its own target was, moved (2,) px by the camera."""
        if not self._told and moved.any():
            for name, member in self.members.items():
                if name in self.answers:
                    tell(member, expectation(upright_box(self.answers[name]), moved))
        self._told = False

    def _set_unit(self, width: float, height: float) -> None:
        if self._fusion is not None:
            self._fusion.unit = np.full(4, math.sqrt(width * height))
        self._size = (width, height)

    def _restart(self, frame: np.ndarray, box: Box, fused: Fused, t_ns: int) -> None:
        """Put drifted members on the fused answer; one that keeps what it has learned is only moved there."""
        for name in fused.restart:
            if not may_move(self.answers[name].state == "tracking", fused, box, frame.shape):
                continue
            member = self.members[name]
            try:
                if isinstance(member, Placeable):
                    member.place(frame, box)
                else:
                    member.init(frame, box, 0.0, t_ns)
            except ValueError:
                continue  # the box leaves the picture: there is nothing to start on yet
            if self._fusion is not None:
                self._fusion.forget(name)


def shifted(fused: Fused, shift_px: np.ndarray) -> Fused:
    """The same answer moved by (2,) px in the picture."""
    return altered(fused, value=fused.value + np.pad(shift_px, (0, 2)))


def may_move(sees: bool, fused: Fused, box: Box, shape: tuple[int, ...]) -> bool:
    """Whether a tracker that has drifted may be put on the fused answer, a box of a picture of this shape.

    One that sees a target itself is as sure as a single other that it would be made to follow. Nor is it put on what
    the picture's edge cuts: trackers that shrink onto what is left of the target agree there against the one that does
    not.
    """
    return not sees or (agreed(fused) and whole(box, shape))


def whole(box: Box, shape: tuple[int, ...]) -> bool:
    """Whether a box lies inside a picture of this shape without touching its edge."""
    return min(box[:2]) > 0.0 and box[0] + box[2] < shape[1] and box[1] + box[3] < shape[0]


def source_of(name: str) -> Source:
    """A tracker of the registry as a source of the fusion."""
    character = CHARACTERS.get(name, Character())
    noise = (character.place, character.place, character.size, character.size)
    return Source(name, noise, threshold=0.5, vouches=character.vouches)


def measurement_of(
    name: str, answer: TrackResult, t_ns: int, place_px: np.ndarray, doubted: bool = False
) -> Measurement:
    """A member's answer as u, v, h, w, and its score brought to a threshold of one half, below it when doubted.

    Args:
        name: the member's.
        answer: its answer.
        t_ns: stamp of the picture, ns.
        place_px: where the camera's motion has moved the picture, (2,), px: u and v are those of a still camera.
        doubted: whether its confidence is brought below the threshold.
    """
    if answer.state != "tracking":
        return Measurement(name, t_ns, None)
    x, y, width, height = upright_box(answer)
    confidence = min(1.0, 0.5 * answer.score / answer.score_limit) if answer.score_limit > 0 else answer.score
    confidence *= 0.5 if doubted else 1.0
    return Measurement(
        name, t_ns, np.array([x + width / 2 - place_px[0], y + height / 2 - place_px[1], height, width]), confidence
    )
