"""HAB-DF over trackers in processes of their own: asynchronous, with late answers at their own capture time."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from dataclasses import replace

import cv2
import numpy as np

from common.tracking.base import Box, Expectation, TrackResult, check_box, check_frame, upright_around, upright_box
from onboard.fusion.camera_motion import CameraMotion, expectation
from onboard.fusion.center import Fused, Fusion
from onboard.fusion.config import FusionConfig
from onboard.fusion.members import Answer, Ask, MemberPool
from onboard.fusion.source import Measurement
from onboard.fusion.tracker import may_move, measurement_of, shifted, source_of
from onboard.fusion.witness import Verdict, Witness

log = logging.getLogger(__name__)
_LEAST_SIDE_PX = 6.0
_IDLE_S = 0.5
_RECENT_NS = 250_000_000


class LiveHabDf:
    """The fusion centre, asked picture by picture; its trackers work beside it.

    Args:
        pool: the trackers.
        config: of the fusion.
        answer_within_s: how long a picture waits for its answers, s.
        frozen_after_s: a tracker that has not answered for so long is begun anew, s.
    """

    def __init__(self, pool: MemberPool, config: FusionConfig, answer_within_s: float, frozen_after_s: float):
        self.pool = pool
        self._config = config
        self._answer_within_s, self._frozen_after_s = answer_within_s, frozen_after_s
        self._fusion: Fusion | None = None
        self._witness: Witness | None = None
        self._camera = CameraMotion()
        self._given: dict[str, int] = {}
        self._size = (1.0, 1.0)
        self._fused: Fused | None = None
        self._seen_ns = 0
        self._wanted: dict[str, int] = {}
        self._said: dict[str, tuple[int, TrackResult]] = {}
        self.late = 0
        """Answers that came with a later picture than their own."""
        self.begun_anew: dict[str, str] = {}
        """Why each tracker was begun anew, by name, for the newest time."""

    def select(self, frame: np.ndarray, box: Box, angle_rad: float, t_ns: int) -> None:
        """Start every tracker on a target; one that is not ready follows as soon as it is.

        Raises:
            ValueError: no colour picture, or a box that is degenerate or not in the picture.
        """
        check_frame(frame)
        check_box(frame, box, angle_rad)
        self.pool.collect(_IDLE_S)
        box = upright_around(box, angle_rad)
        self._fusion = Fusion([source_of(name) for name in self.pool.members], self._config)
        self._fit(box[2], box[3])
        grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
        self._witness = Witness(grey, box, t_ns)
        self._camera, self._given = CameraMotion(), {}
        self._camera.see(grey, t_ns)
        self._wanted = {}
        self._fused, self._seen_ns, self._said = None, t_ns, {}
        for name, member in self.pool.members.items():
            member.started = False
            if member.ask(Ask("init", t_ns, frame.shape, box), frame):
                self._given[name] = t_ns

    def drop(self) -> None:
        """Forget the target."""
        self._fusion = None

    @property
    def box(self) -> Box | None:
        """The fused box of the last step, px; None before any."""
        fused = self._fused
        if fused is None or fused.state == "waiting":
            return None
        u, v = float(fused.value[0]), float(fused.value[1])
        return u - self._size[0] / 2, v - self._size[1] / 2, *self._size

    def member_boxes(self, t_ns: int) -> dict[str, Box | None]:
        """Newest box of each tracker, px, by name; None for one that has not seen the target of late."""
        boxes: dict[str, Box | None] = dict.fromkeys(self.pool.members)
        for name, (said_ns, result) in self._said.items():
            if result.state == "tracking" and t_ns - said_ns <= _RECENT_NS:
                boxes[name] = upright_box(result)
        return boxes

    def sees(self, t_ns: int) -> bool:
        """Whether the answer has rested on trustworthy trackers of late: they do not all answer in every step."""
        return self._fused is not None and t_ns - self._seen_ns <= _RECENT_NS

    def step(self, frame: np.ndarray, t_ns: int) -> Fused:
        """Fused answer for a picture, (H, W, 3) uint8 BGR, from what has been answered so far.

        Raises:
            ValueError: no target.
        """
        if self._fusion is None or self._witness is None:
            raise ValueError("fusion: step without a target; select one first")
        grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
        was, place = self._camera.last, self._camera.see(grey, t_ns)
        if self._fused is not None:
            self._fused = shifted(self._fused, place - was)
        answers = dict(self.pool.collect(0.0))
        for name, member in self.pool.members.items():
            if member.started and member.ask(Ask("update", t_ns, frame.shape, None, self._expected(name)), frame):
                self._given[name] = t_ns
        answers |= dict(self.pool.collect(self._answer_within_s))
        verdict = self._judge(answers, grey, t_ns)
        measurements = []
        for name, answer in answers.items():
            self.late += answer.t_ns < t_ns
            if answer.result is not None:
                if answer.result.state == "tracking" and name in self._said and self._said[name][1].state != "tracking":
                    self._fusion.forget(name)  # it has found the target again, maybe elsewhere
                self._said[name] = (answer.t_ns, answer.result)
            if name in verdict.silent or (answer.result is None and answer.error):
                measurements.append(Measurement(name, answer.t_ns, None))
            elif answer.result is not None:
                seen_at, doubted = self._camera.at(answer.t_ns), name in verdict.doubted
                measurements.append(measurement_of(name, answer.result, answer.t_ns, seen_at, doubted))
        fused = self._fused = shifted(self._fusion.step(measurements, t_ns), place)
        if fused.state == "tracking":
            self._seen_ns = t_ns
            self._fit(float(fused.value[3]), float(fused.value[2]))
        box = self.box
        if measurements and fused.state == "tracking" and box is not None:
            self._witness.learn(grey, box, fused)
        vouched = box is not None and self._witness.vouches(grey, box, fused)
        self._tend(replace(fused, restart=fused.restart if vouched else ()), frame, t_ns)
        return fused

    def _expected(self, name: str) -> Expectation | None:
        """What the camera has done since a tracker's last picture; None for one that has just been put somewhere."""
        said, given_ns = self._said.get(name), self._given.get(name)
        if said is None or given_ns is None:
            return None
        moved = self._camera.last - self._camera.at(given_ns)
        return expectation(upright_box(said[1]), moved) if moved.any() else None

    def _judge(self, answers: Mapping[str, Answer], grey: np.ndarray, t_ns: int) -> Verdict:
        """What the witness thinks of the answers to this very picture; of late ones it has the picture no more."""
        boxes = {
            name: upright_box(answer.result)
            for name, answer in answers.items()
            if answer.result is not None and answer.result.state == "tracking" and answer.t_ns == t_ns
        }
        if not boxes or self._witness is None or self._fusion is None:
            return Verdict()
        verdict = self._witness.judge(grey, boxes, len(self.pool.members) > 1, self._fused, t_ns)
        for name in verdict.begun:
            self._fusion.forget(name, follow=True)
        return verdict

    def _fit(self, width: float, height: float) -> None:
        self._size = (max(width, _LEAST_SIDE_PX), max(height, _LEAST_SIDE_PX))
        if self._fusion is not None:
            self._fusion.unit = np.full(4, math.sqrt(self._size[0] * self._size[1]))

    def _tend(self, fused: Fused, frame: np.ndarray, t_ns: int) -> None:
        """Begin dead and frozen trackers anew; put those that have drifted, or have no target, on the fused answer."""
        for name, member in self.pool.members.items():
            why = member.tend(self._frozen_after_s)
            if why:
                self.begun_anew[name] = why
                log.warning("tracker %s %s; begun anew", name, why)
        self._wanted.update(dict.fromkeys(fused.restart, t_ns))
        box = self.box
        if fused.state != "tracking" or box is None or self._fusion is None:
            return
        try:
            check_box(frame, box, 0.0)
        except ValueError:
            return  # the box leaves the picture: there is nothing to start on yet
        boxes = self.member_boxes(t_ns)
        for name, member in self.pool.members.items():
            recent = t_ns - self._wanted.get(name, -(10**18)) < 1e9 * self._config.restart_every_s
            if not member.started:
                if member.ask(Ask("init", t_ns, frame.shape, box), frame):
                    self._begin(name, t_ns)
            elif (
                recent
                and may_move(boxes[name] is not None, fused, box, frame.shape)
                and member.ask(Ask("place", t_ns, frame.shape, box), frame)
            ):
                del self._wanted[name]
                self._begin(name, t_ns)

    def _begin(self, name: str, t_ns: int) -> None:
        """A tracker was put on the answer in the picture of this stamp."""
        self._given[name] = t_ns
        if self._fusion is not None:
            self._fusion.forget(name)

    def close(self) -> None:
        """End the trackers."""
        self.pool.close()
