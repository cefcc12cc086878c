"""The fusion over pictures, wherever its trackers run: what is made of their answers, and where each is to search next.

One place for a film (`tracker.py`) and for a flight (`live.py`): the camera's motion is taken out, answers are compared
with what the target has looked like, fused, and learned from.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace

import cv2
import numpy as np

from common.evaluation import jaccard
from common.tracking.base import Box, Expectation, TrackResult, upright_box
from onboard.fusion.camera_motion import CameraMotion, expectation
from onboard.fusion.center import Fused, Fusion
from onboard.fusion.characters import source_of
from onboard.fusion.config import FusionConfig
from onboard.fusion.doubt import together
from onboard.fusion.foreseen import Foreseen
from onboard.fusion.members import Answer
from onboard.fusion.riding import Riding
from onboard.fusion.silhouette import SILHOUETTE
from onboard.fusion.source import Measurement
from onboard.fusion.witness import Verdict, Witness, agreed

_LEAST_SIDE_PX = 6.0
_DOUBTED = 0.25
"""Confidence of one that is doubted, at most: below its threshold, however sure of itself it is."""
_ON_IT, _IT = 0.4, 0.6
"""Least overlap with the one thing that is no part of the surroundings of who is heard beside it, and who is right."""
_HEARD = 0.5
"""Least reliability of a tracker that sees the target."""
_SOLID_ALONE_S, _SOLID = 3.0, 0.6
"""How long the depth camera's thing is heard by itself, s: then it may be anything that stands there. And its
confidence: of several things it may be the wrong one."""
_DISPUTED_S = 0.3
"""How long two trackers or more must have agreed where the target is not foreseen for them to be heard, s."""
_ASTRAY_S = 0.3
"""How long a tracker must have been where, or as large as, the target cannot be for it to be put on the answer, s."""


class PictureFusion:
    """Fusion, witness and camera of one target.

    Args:
        names: of the trackers, in the registry.
        config: of the fusion.
        frame: first picture, (H, W, 3) uint8 BGR.
        box: the target in it, px.
        t_ns: its stamp, ns.
    """

    def __init__(self, names: Iterable[str], config: FusionConfig, frame: np.ndarray, box: Box, t_ns: int):
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
        self._foreseen: Foreseen | None = None
        self._whole: Box | None = None
        """What is no part of the surroundings, and can be the target, in the newest picture, px."""
        self._astray: dict[str, int] = {}
        self._disputed_ns = t_ns
        self._fusion = Fusion([*(source_of(name) for name in names), SILHOUETTE], config)
        self._seen_ns = t_ns
        self._several = len(set(names)) > 1
        self._witness = Witness(self.grey, box, t_ns, len(set(names)))
        self._riding = Riding()
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
        on_it = self._whole is not None and jaccard(box, self._whole) > _IT
        return on_it or self._witness.vouches(self.grey, box, fused)

    @property
    def astray(self) -> frozenset[str]:
        """Trackers that have for some time been where, or as large as, the target cannot be, whatever they see."""
        return frozenset(n for n, since_ns in self._astray.items() if self._t_ns - since_ns >= _ASTRAY_S * 1e9)

    def look(self, frame: np.ndarray, t_ns: int, foreseen: Foreseen | None = None) -> None:
        """Take in the next picture: the answer moves with it.

        Args:
            frame: the picture, (H, W, 3) uint8 BGR.
            t_ns: its stamp, ns.
            foreseen: where somebody who knows the target's motion over ground expects it in it; None: nobody does.
        """
        self._foreseen = foreseen
        self._whole = None if foreseen is None else foreseen.whole(frame.shape)
        self.grey, self._t_ns = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY), t_ns
        moved_px = None if foreseen is None else foreseen.moved_px
        before, self.place_px = self.place_px, self._camera.see(self.grey, t_ns, moved_px)
        if self.fused is not None:
            self.fused = _shifted(self.fused, self.place_px - before)

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
                fitted = self._fitted(upright_box(answer.result))
                measurements.append(_measurement_of(name, answer.result, fitted, answer.t_ns, seen_at, doubted))
        measurements += self._of_thing(answers)
        fused = _shifted(self._fusion.step(measurements, self._t_ns), self.place_px)
        if any(j.reliability > _HEARD for name, j in fused.sources.items() if name != SILHOUETTE.name):
            self._seen_ns = self._t_ns
        fused = self.fused = replace(fused, restart=tuple(n for n in fused.restart if n != SILHOUETTE.name))
        if fused.state == "tracking":
            self._fit(float(fused.value[3]), float(fused.value[2]))
            box = self.box
            if measurements and box is not None:
                self._witness.learn(self.grey, box, fused)
        return fused

    def _of_thing(self, answers: Mapping[str, Answer]) -> list[Measurement]:
        """The thing at the target's place, as a measurement; it vouches for trackers that are on it."""
        thing = self._whole or self._solid
        if thing is None:
            return []
        if self.fused is None or self.fused.state != "tracking":
            self._fusion.forget(SILHOUETTE.name, follow=True)
        now = {n: a.result for n, a in answers.items() if a.result is not None and a.t_ns == self._t_ns}
        on_it = {n for n, r in now.items() if r.state == "tracking" and jaccard(upright_box(r), thing) > _IT}
        for name in (*on_it, SILHOUETTE.name):
            self._fusion.vouch(name)
        confidence = _SOLID if self._whole is None else 1.0
        return [Measurement(SILHOUETTE.name, self._t_ns, _value_of(thing, self.place_px), confidence)]

    @property
    def _solid(self) -> Box | None:
        """What stands at the target's place by the depth camera, unless no tracker has seen the target for long."""
        if self._foreseen is None or self._t_ns - self._seen_ns > _SOLID_ALONE_S * 1e9:
            return None
        return self._foreseen.solid

    def put(self, name: str) -> None:
        """A tracker was put on the answer in the newest picture."""
        self.given(name)
        self._riding.moved(name)
        self._astray.pop(name, None)
        self._fusion.forget(name)

    def _judge(self, answers: Mapping[str, Answer]) -> Verdict:
        """What the witness thinks of the answers to this very picture; of late ones it has the picture no more."""
        now = {n: a.result for n, a in answers.items() if a.result is not None and a.t_ns == self._t_ns}
        if not now:
            return Verdict()
        seen = {name: upright_box(result) for name, result in now.items() if result.state == "tracking"}
        excluded = self._excluded(seen)
        seen = {name: box for name, box in seen.items() if name not in excluded}
        stretches = self._riding.look(self.grey, self._t_ns, self.place_px, seen)
        boxes = {name: self._fitted(box) for name, box in seen.items()}
        foreseen = None if self._foreseen is None else self._foreseen.box
        confirmed = self._confirmed(boxes)
        verdict = self._witness.judge(
            self.grey, boxes, self._several, self.fused, self._t_ns, foreseen, stretches, confirmed
        )
        for name in verdict.begun:
            self._fusion.forget(name, follow=True)
        return replace(verdict, silent=verdict.silent | excluded)

    def _excluded(self, boxes: Mapping[str, Box]) -> frozenset[str]:
        """Trackers that are at something else, by its distance; notes since when, and who has another size."""
        if self._foreseen is None:
            self._astray.clear()
            self._disputed_ns = self._t_ns
            return frozenset()
        excluded = self._foreseen.excluded(boxes)
        excluded -= self._majority(boxes, excluded)
        if self._whole is not None:
            excluded |= {name for name, box in boxes.items() if jaccard(box, self._whole) < _ON_IT}
        for name, box in boxes.items():
            if name in excluded or self._foreseen.grown(box) != 0.0:
                self._astray.setdefault(name, self._t_ns)
            else:
                self._astray.pop(name, None)
        return excluded

    def _majority(self, boxes: Mapping[str, Box], excluded: frozenset[str]) -> frozenset[str]:
        """Trackers at another distance than foreseen that have agreed for long, against no more than one that is not.

        What is foreseen rests on who was heard; where that one went astray, so did it.
        """
        away = self._foreseen.of_his_size({n: boxes[n] for n in excluded}) if self._foreseen is not None else ()
        group = together({n: boxes[n] for n in away})
        if len(group) < 2 or len(boxes) - len(excluded) > 1:
            self._disputed_ns = self._t_ns
        return group if self._t_ns - self._disputed_ns >= _DISPUTED_S * 1e9 else frozenset()

    def _confirmed(self, boxes: Mapping[str, Box]) -> frozenset[str]:
        """Trackers that agree with another, or with what stands there, where the depth camera has the target."""
        if self._foreseen is None:
            return frozenset()
        there = self._foreseen.confirmed(boxes)
        thing = {} if self._solid is None else {SILHOUETTE.name: self._solid}
        return together({n: box for n, box in boxes.items() if n in there} | thing) - {SILHOUETTE.name}

    def _fitted(self, box: Box) -> Box:
        """A tracker's box, no larger and no smaller than the target can look."""
        return box if self._foreseen is None else self._foreseen.fitted(box)

    def _fit(self, width: float, height: float) -> None:
        self._size = (max(width, _LEAST_SIDE_PX), max(height, _LEAST_SIDE_PX))
        self._fusion.unit = np.full(4, math.sqrt(self._size[0] * self._size[1]))


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
