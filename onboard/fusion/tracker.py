"""HAB-DF over pictures: several trackers of different kinds as one (Echeverri 2016, chapter 4)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from common.config import Config
from common.tracking.base import (
    Box,
    Expectation,
    Tracker,
    TrackResult,
    TrackState,
    check_box,
    check_frame,
    put,
    upright_around,
)
from onboard.fusion.camera_motion import tell
from onboard.fusion.center import Fused
from onboard.fusion.config import FusionConfig, HabDfConfig
from onboard.fusion.foreseen import Foreseen
from onboard.fusion.members import Answer
from onboard.fusion.outline import Outline
from onboard.fusion.pictures import PictureFusion

_STATES: Mapping[str, TrackState] = {
    "waiting": "lost",
    "tracking": "tracking",
    "predicted": "predicted",
    "lost": "lost",
}


class HabDfTracker:
    """Several trackers, fused. See `common.tracking.base.Tracker`.

    Args:
        members: trackers by name.
        config: parameters of the fusion.
        outline: whether the answer is the whole target around the fused box (`Outline`), and not that box.
    """

    config_type = HabDfConfig

    def __init__(self, members: Mapping[str, Tracker], config: FusionConfig, outline: bool = True):
        self.members = dict(members)
        self.answers: dict[str, TrackResult] = {}
        """What each member said last."""
        self._config = config
        self._fusion: PictureFusion | None = None
        self._outline, self._outlines = Outline(), outline
        self._told = False
        self._foreseen: Foreseen | None = None

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
        return cls(members, own.of_boxes(config.section(FusionConfig)), own.outline)

    def init(self, frame: np.ndarray, box: Box, angle_rad: float = 0.0, t_ns: int | None = None) -> None:
        """Start every member on the upright box around the target."""
        check_frame(frame)
        check_box(frame, box, angle_rad)
        box, start_ns = upright_around(box, angle_rad), 0 if t_ns is None else t_ns
        self._fusion = PictureFusion(self.members, self._config, frame, box, start_ns)
        for name, member in self.members.items():
            member.init(frame, box, 0.0, t_ns)
            self._fusion.given(name)
        self.answers, self._told, self._foreseen = {}, False, None
        self._outline = Outline()
        self._outline.whole(self._fusion.grey, start_ns, self._fusion.place_px, box)

    def expect(self, expectation: Expectation) -> None:
        """Pass it on to every member; it knows more than the picture's own shift, which is then not told."""
        self._told = True
        for member in self.members.values():
            member.expect(expectation)

    def foresee(self, foreseen: Foreseen | None) -> None:
        """Say where the target's motion over ground leads one to expect it in the next picture; None: unknown."""
        self._foreseen = foreseen

    def update(self, frame: np.ndarray, t_ns: int) -> TrackResult:
        """Ask every member, fuse their answers, and put those that have drifted back on the fused one."""
        fusion = self._fusion
        if fusion is None:
            raise ValueError("hab-df: update before init; select a target first")
        fusion.look(frame, t_ns, self._foreseen)
        self.answers = {name: self._ask(name, fusion, frame, t_ns) for name in self.members}
        self._told, self._foreseen = False, None
        fused = fusion.hear({name: Answer(t_ns, result) for name, result in self.answers.items()})
        box = fusion.box
        if box is None:
            return next(iter(self.answers.values()))
        if fusion.kept is not None:
            seeing = [name for name, said in self.answers.items() if said.state == "tracking"]
            self._put(fusion, frame, fusion.kept, seeing, t_ns)
        elif fusion.vouched:
            self._restart(fusion, frame, box, fused, t_ns)
        x, y, width, height = self._outlined(fusion, box, fused) if self._outlines else box
        center = x + width / 2, y + height / 2
        return TrackResult(center, (width, height), 0.0, fused.confidence, 0.5, _STATES[fused.state], angle_std_rad=0.0)

    def _ask(self, name: str, fusion: PictureFusion, frame: np.ndarray, t_ns: int) -> TrackResult:
        """Let a member search this picture where its own target was, moved by the camera."""
        member, expected = self.members[name], fusion.expected(name)
        if expected is not None and not self._told:
            tell(member, expected)
        fusion.given(name)
        return member.update(frame, t_ns)

    def _outlined(self, fusion: PictureFusion, box: Box, fused: Fused) -> Box:
        """The whole target around the fused box, which members of fixed shape may have left on one side of it."""
        if fused.state == "tracking":
            return self._outline.whole(fusion.grey, fused.t_ns, fusion.place_px, box)
        self._outline.rest()
        return self._outline.around(box)

    def _restart(self, fusion: PictureFusion, frame: np.ndarray, box: Box, fused: Fused, t_ns: int) -> None:
        """Put drifted members on the fused answer; one that keeps what it has learned is only moved there."""
        astray = fusion.astray
        drifted = sorted({*fused.restart, *astray})
        sees = {name: self.answers[name].state == "tracking" and name not in astray for name in drifted}
        self._put(fusion, frame, box, [n for n in drifted if fusion.may_move(sees[n])], t_ns)

    def _put(self, fusion: PictureFusion, frame: np.ndarray, box: Box, names: Iterable[str], t_ns: int) -> None:
        for name in names:
            try:
                put(self.members[name], frame, box, t_ns)
            except ValueError:
                continue  # the box leaves the picture: there is nothing to start on yet
            fusion.put(name)
