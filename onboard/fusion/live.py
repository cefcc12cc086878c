"""HAB-DF over trackers in processes of their own: asynchronous, with late answers at their own capture time."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from common.tracking.base import Box, check_box, check_frame, upright_around, upright_box
from onboard.fusion.center import Fused
from onboard.fusion.config import FusionConfig
from onboard.fusion.foreseen import Foreseen
from onboard.fusion.members import Ask, MemberPool
from onboard.fusion.pictures import PictureFusion

log = logging.getLogger(__name__)
_IDLE_S = 0.5
"""How long answers are waited for where nothing is flown by them yet, s."""
_RECENT_NS = 250_000_000
"""How old what a tracker said last may be to be its word, ns: five pictures at 20 Hz."""


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
        self._fusion: PictureFusion | None = None
        self._seen_ns = 0
        self._wanted: dict[str, int] = {}
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
        self._fusion = PictureFusion(self.pool.members, self._config, frame, box, t_ns)
        self._wanted, self._seen_ns = {}, t_ns
        for name, member in self.pool.members.items():
            member.started = False
            if member.ask(Ask("init", t_ns, frame.shape, box), frame):
                self._fusion.given(name)

    def drop(self) -> None:
        """Forget the target."""
        self._fusion = None

    @property
    def box(self) -> Box | None:
        """The fused box of the last step, px; None before any."""
        return None if self._fusion is None else self._fusion.box

    def member_boxes(self, t_ns: int) -> dict[str, Box | None]:
        """Newest box of each tracker, px, by name; None for one that has not seen the target of late."""
        boxes: dict[str, Box | None] = dict.fromkeys(self.pool.members)
        for name, (said_ns, result) in ({} if self._fusion is None else self._fusion.said).items():
            if result.state == "tracking" and t_ns - said_ns <= _RECENT_NS:
                boxes[name] = upright_box(result)
        return boxes

    def sees(self, t_ns: int) -> bool:
        """Whether the answer has rested on trustworthy trackers of late: they do not all answer in every step."""
        return self.box is not None and t_ns - self._seen_ns <= _RECENT_NS

    def catch_up(self, frame: np.ndarray, t_ns: int) -> None:
        """Take a picture of the past whose answers can be waited for, as `step`."""
        self._step(frame, t_ns, None, _IDLE_S)

    def step(self, frame: np.ndarray, t_ns: int, foreseen: Foreseen | None = None) -> Fused:
        """Fused answer for a picture from what has been answered so far.

        Args:
            frame: the picture, (H, W, 3) uint8 BGR.
            t_ns: its capture stamp, ns.
            foreseen: where the target's motion over ground leads one to expect it in it; None: unknown.

        Raises:
            ValueError: no target.
        """
        return self._step(frame, t_ns, foreseen, self._answer_within_s)

    def _step(self, frame: np.ndarray, t_ns: int, foreseen: Foreseen | None, within_s: float) -> Fused:
        fusion = self._fusion
        if fusion is None:
            raise ValueError("fusion: step without a target; select one first")
        fusion.look(frame, t_ns, foreseen)
        answers = dict(self.pool.collect(0.0))
        for name, member in self.pool.members.items():
            if member.started and member.ask(Ask("update", t_ns, frame.shape, None, fusion.expected(name)), frame):
                fusion.given(name)
        answers |= dict(self.pool.collect(within_s))
        self.late += sum(answer.t_ns < t_ns for answer in answers.values())
        fused = fusion.hear(answers)
        if fused.state == "tracking":
            self._seen_ns = t_ns
        restart = {*fused.restart, *fusion.astray} if fusion.vouched else set()
        self._tend(fusion, replace(fused, restart=tuple(sorted(restart))), frame, t_ns)
        return fused

    def _tend(self, fusion: PictureFusion, fused: Fused, frame: np.ndarray, t_ns: int) -> None:
        """Begin dead and frozen trackers anew; put those that have drifted, or have no target, on the fused answer."""
        for name, member in self.pool.members.items():
            why = member.tend(self._frozen_after_s)
            if why:
                self.begun_anew[name] = why
                log.warning("tracker %s %s; begun anew", name, why)
        self._wanted.update(dict.fromkeys(fused.restart, t_ns))
        box = self.box
        if fused.state != "tracking" or box is None:
            return
        try:
            check_box(frame, box, 0.0)
        except ValueError:
            return  # the box leaves the picture: there is nothing to start on yet
        boxes = self.member_boxes(t_ns)
        for name, member in self.pool.members.items():
            wanted_ns = self._wanted.get(name)
            if not member.started:
                if member.ask(Ask("init", t_ns, frame.shape, box), frame):
                    fusion.put(name)
            elif (
                wanted_ns is not None
                and t_ns - wanted_ns < 1e9 * self._config.restart_every_s
                and fusion.may_move(boxes[name] is not None and name not in fusion.astray)
                and member.ask(Ask("place", t_ns, frame.shape, box), frame)
            ):
                del self._wanted[name]
                fusion.put(name)

    def close(self) -> None:
        """End the trackers."""
        self.pool.close()
