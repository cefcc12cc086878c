"""The fusion over pictures, wherever its trackers run: what is made of their answers, and where each is to search next.

One place for a film (`tracker.py`) and for a flight (`live.py`): the camera's motion is taken out, answers are compared
with what the target has looked like, fused, and learned from.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import replace

import cv2
import numpy as np

from common.tracking.base import Box, Expectation, TrackResult, upright_box
from onboard.fusion.answer import RELIABLE, agreed
from onboard.fusion.camera_motion import CameraMotion, expectation
from onboard.fusion.center import Fused, Fusion
from onboard.fusion.characters import source_of
from onboard.fusion.config import FusionConfig
from onboard.fusion.copies import Copies
from onboard.fusion.foreseen import Foreseen
from onboard.fusion.members import Answer
from onboard.fusion.place import PlaceCheck
from onboard.fusion.riding import Riding
from onboard.fusion.silhouette import SILHOUETTE
from onboard.fusion.source import Measurement
from onboard.fusion.witness import Verdict, Witness

_LEAST_SIDE_PX = 6.0
"""Least side of the answer, px: of less no tracker can take a patch."""
_DOUBTED = 0.25
"""Confidence of one that is doubted, at most: below its threshold, however sure of itself it is."""


class PictureFusion:
    """Fusion, witness and camera of one target.

    Args:
        names: of the trackers, in the registry.
        config: of the fusion.
        frame: first picture, (H, W, 3) uint8 BGR.
        box: the target in it, px.
        t_ns: its stamp, ns.
    """

    def __init__(self, names: Collection[str], config: FusionConfig, frame: np.ndarray, box: Box, t_ns: int):
        self.grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
        """The newest picture, (H, W) uint8."""
        self.place_px = np.zeros(2)
        """Where the camera's motion has moved it, (2,), px."""
        self.fused: Fused | None = None
        """The answer, moved with the newest picture; None before any."""
        self.said: dict[str, tuple[int, TrackResult]] = {}
        """The stamp, ns, and the result of what each tracker said last."""
        self.kept: Box | None = None
        """Where the target still is in the newest picture, px, though all that see it have left it; None: unknown."""
        self._t_ns = t_ns
        self._place = PlaceCheck(t_ns)
        self._fusion = Fusion([*(source_of(name) for name in names), SILHOUETTE], config)
        self._several = len(names) > 1
        self._witness = Witness(self.grey, box, t_ns, len(names))
        self._riding, self._copies = Riding(), Copies()
        self._camera = CameraMotion()
        self._camera.see(self.grey, t_ns)
        self._given: dict[str, int] = {}
        self._size = (1.0, 1.0)
        self._fit(box[2], box[3])

    @property
    def box(self) -> Box | None:
        """The fused box, px; None before any."""
        if self.fused is None or self.fused.state == "waiting":
            return None
        u, v = float(self.fused.value[0]), float(self.fused.value[1])
        return u - self._size[0] / 2, v - self._size[1] / 2, *self._size

    @property
    def vouched(self) -> bool:
        """Whether trackers may be put on the fused box (`Witness.vouches`), or it is all that is there."""
        box, fused = self.box, self.fused
        if box is None or fused is None:
            return False
        return self._place.is_it(box) or self._witness.vouches(self.grey, box, self._copies.without(fused))

    @property
    def astray(self) -> frozenset[str]:
        """Trackers that have for some time been where, or as large as, the target cannot be, whatever they see."""
        return self._place.astray

    def look(self, frame: np.ndarray, t_ns: int, foreseen: Foreseen | None = None) -> None:
        """Take in the next picture: the answer moves with it.

        Args:
            frame: the picture, (H, W, 3) uint8 BGR.
            t_ns: its stamp, ns.
            foreseen: where somebody who knows the target's motion over ground expects it in it; None: nobody does.
        """
        self._place.look(t_ns, foreseen, frame.shape)
        self.grey, self._t_ns = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY), t_ns
        moved_px = None if foreseen is None else foreseen.moved_px
        before, self.place_px = self.place_px, self._camera.see(self.grey, t_ns, moved_px)
        if self.fused is not None:
            self.fused = _shifted(self.fused, self.place_px - before)

    def may_move(self, sees: bool) -> bool:
        """Whether a tracker that has drifted, and sees a target or does not, may be put on the answer.

        One that sees a target itself is as sure as a single other that it would be made to follow. Nor is it put on
        what the picture's edge cuts: trackers that shrink onto what is left of the target agree there against the one
        that does not.
        """
        if not sees or self.fused is None or self.box is None:
            return not sees
        return agreed(self._copies.without(self.fused)) and whole(self.box, self.grey.shape)

    def given(self, name: str) -> None:
        """A tracker has been given the newest picture."""
        self._given[name] = self._t_ns

    def expected(self, name: str) -> Expectation | None:
        """What the camera has done since the picture that a tracker was given last; None where nothing is known."""
        said, given_ns = self.said.get(name), self._given.get(name)
        if said is None or given_ns is None:
            return None
        moved = self.place_px - self._camera.at(given_ns)
        return expectation(upright_box(said[1]), moved) if moved.any() else None

    def hear(self, answers: Mapping[str, Answer]) -> Fused:
        """Fused answer for the newest picture from what was answered since the last one, to it or to earlier ones."""
        for name, answer in answers.items():
            if answer.result is None:
                continue
            if answer.result.state == "tracking" and name in self.said and self.said[name][1].state != "tracking":
                self._fusion.forget(name)  # it has found the target again, maybe elsewhere
            self.said[name] = (answer.t_ns, answer.result)
            self._riding.hear(name, answer.t_ns, sees=answer.result.state == "tracking")
        verdict = self._judge(answers)
        self.kept = verdict.kept
        measurements = []
        for name, answer in answers.items():
            if name in verdict.silent or (answer.result is None and answer.error):
                measurements.append(Measurement(name, answer.t_ns, None))
            elif answer.result is not None:
                seen_at, doubted = self._camera.at(answer.t_ns), name in verdict.doubted
                fitted = self._place.fitted(upright_box(answer.result))
                measurements.append(_measurement_of(name, answer.result, fitted, answer.t_ns, seen_at, doubted))
        measurements += self._of_thing(answers)
        fused = _shifted(self._fusion.step(measurements, self._t_ns), self.place_px)
        if any(j.reliability > RELIABLE for name, j in fused.sources.items() if name != SILHOUETTE.name):
            self._place.seen()
        fused = self.fused = replace(fused, restart=tuple(n for n in fused.restart if n != SILHOUETTE.name))
        if fused.state == "tracking":
            self._fit(float(fused.value[3]), float(fused.value[2]))
            box = self.box
            if measurements and box is not None:
                self._witness.learn(self.grey, box, self._copies.without(fused))
                if not self._witness.found:
                    self._copies.firm()
        return fused

    def _of_thing(self, answers: Mapping[str, Answer]) -> list[Measurement]:
        """The thing at the target's place, as a measurement; it vouches for trackers that are on it."""
        if self._place.thing is None:
            return []
        box, confidence = self._place.thing
        if self.fused is None or self.fused.state != "tracking":
            self._fusion.forget(SILHOUETTE.name, follow=True)
        for name in (*self._place.on_thing(self._seen(answers)), SILHOUETTE.name):
            self._fusion.vouch(name)
        return [Measurement(SILHOUETTE.name, self._t_ns, _value_of(box, self.place_px), confidence)]

    def _seen(self, answers: Mapping[str, Answer]) -> dict[str, Box]:
        """Boxes of those that see the target in this very picture, px."""
        now = {n: a.result for n, a in answers.items() if a.result is not None and a.t_ns == self._t_ns}
        return {name: upright_box(result) for name, result in now.items() if result.state == "tracking"}

    def put(self, name: str) -> None:
        """A tracker was put on the answer in the newest picture."""
        self.given(name)
        self._riding.moved(name)
        self._copies.put(name, self._t_ns, found=self._witness.found and self._place.box is None)
        self._place.put(name)
        self._fusion.forget(name)

    def _judge(self, answers: Mapping[str, Answer]) -> Verdict:
        """What the witness thinks of the answers to this very picture; of late ones it has the picture no more."""
        if not any(a.result is not None and a.t_ns == self._t_ns for a in answers.values()):
            return Verdict()
        seen = self._seen(answers)
        excluded = self._place.excluded(seen)
        seen = {name: box for name, box in seen.items() if name not in excluded}
        stretches = self._riding.look(self.grey, self._t_ns, self.place_px, seen)
        boxes = {name: self._place.fitted(box) for name, box in seen.items()}
        foreseen, confirmed = self._place.box, self._place.confirmed(boxes)
        copies = self._copies.names(self._t_ns)
        verdict = self._witness.judge(
            self.grey, boxes, self._several, self.fused, self._t_ns, foreseen, stretches, confirmed, copies
        )
        for name in verdict.begun:
            self._fusion.forget(name, follow=True)
        return replace(verdict, silent=verdict.silent | excluded)

    def _fit(self, width: float, height: float) -> None:
        self._size = (max(width, _LEAST_SIDE_PX), max(height, _LEAST_SIDE_PX))
        self._fusion.unit = np.full(4, math.sqrt(self._size[0] * self._size[1]))


def whole(box: Box, shape: tuple[int, ...]) -> bool:
    """Whether a box lies inside a picture of this shape without touching its edge."""
    return min(box[:2]) > 0.0 and box[0] + box[2] < shape[1] and box[1] + box[3] < shape[0]


def _shifted(fused: Fused, shift_px: np.ndarray) -> Fused:
    """The same answer moved by (2,) px in the picture."""
    value = fused.value.copy()
    value[:2] += shift_px
    return replace(fused, value=value)


def _measurement_of(
    name: str, answer: TrackResult, box: Box, t_ns: int, place_px: np.ndarray, doubted: bool
) -> Measurement:
    """A member's answer as u, v, h, w, and its score brought to a threshold of one half, below it when doubted.

    Args:
        name: the member's.
        answer: its answer.
        box: the upright box of that, as large as the target can look, px.
        t_ns: stamp of the picture, ns.
        place_px: where the camera's motion has moved the picture, (2,), px: u and v are those of a still camera.
        doubted: whether its confidence is brought below the threshold.
    """
    if answer.state != "tracking":
        return Measurement(name, t_ns, None)
    confidence = min(1.0, 0.5 * answer.score / answer.score_limit) if answer.score_limit > 0 else answer.score
    confidence = min(confidence, _DOUBTED) if doubted else confidence
    return Measurement(name, t_ns, _value_of(box, place_px), confidence)


def _value_of(box: Box, place_px: np.ndarray) -> np.ndarray:
    """u, v, h, w of a box, (4,), px, in the coordinates of a still camera; the picture has moved by place_px, (2,)."""
    x, y, width, height = box
    return np.array([x + width / 2 - place_px[0], y + height / 2 - place_px[1], height, width])
