"""A witness of the fused answer's own: what the target has looked like where trackers that agree spoke for it.

Beyond the thesis, whose fusion knows boxes alone. TLD's nearest-neighbour classifier (Kalal et al. 2012, section 5.3)
doubts a tracker whose box looks less like the target than another's, and decides who speaks while they disagree and
nothing supports the answer.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from common.evaluation import jaccard
from common.tracking.base import Box
from onboard.fusion.answer import RELIABLE, agreed, box_of
from onboard.fusion.center import Fused
from onboard.fusion.doubt import ALONE_UNLIKE, doubted, found_alone, same_as
from onboard.fusion.look import Look
from onboard.fusion.outvoted import Outvoted
from onboard.fusion.prior import (
    CLEARLY,
    LIKE_BESIDE_TWINS,
    SURELY,
    as_foreseen,
    elsewhere,
    gone,
    out_of_reach,
    outshining,
    rivals,
)
from onboard.fusion.riding import Stretch

_ALONE_THERE_UNLIKE = 0.4
"""Least relative similarity of a tracker that is alone, and is where the answer was: it has not gone elsewhere."""
_ALONE_S, _OUTSHONE_S = 0.25, 0.15
"""How long no two must have agreed, and another have looked far more like the target, for that one to be followed."""
_FOUND_MORE, _SETTLED_S = 0.2, 0.5
"""How much more of one that is alone after the answer had rested on nobody, at first, and after how long with no break
nothing more, s: what it has found may be what covers the target, and that passes."""
_BROKEN_S = 0.15
"""For how long nobody must have spoken for the answer for it to count as broken off, s."""
_UNDECIDED_S = 0.06
"""How long the answer must have been without support before one tracker is chosen to speak, s."""
_CHOSEN = 0.5
"""Least relative similarity of the one that is chosen."""
_KEPT_S = 1.0
"""For how long after two have agreed the target is believed where its motion leads, though all have left it, s."""
_NEAR_EXPECTED = 0.3
"""Overlap with that place above which a tracker has not gone."""
_TOGETHER_S = 0.12
"""Time within which trackers that speak for the answer agree: in flight they do not all answer in one step."""
_FIRM = 3
"""Trackers that must agree on an answer that was found again for it to count as followed, if there are so many."""


@dataclass(frozen=True)
class Verdict:
    """What the witness thinks of the trackers' boxes in one picture."""

    doubted: frozenset[str] = frozenset()
    """Trackers whose box does not look like the target, or less so than another's."""
    silent: frozenset[str] = frozenset()
    """Trackers that are not heard: they are at another thing, or another was chosen to speak."""
    begun: tuple[str, ...] = ()
    """Trackers whose past no longer holds and that are to be followed: one was just chosen, and these agree with it."""
    kept: Box | None = None
    """Where the target still is, px, though those that are silent have left it; None where that is not known."""


class Witness:
    """What the fused target looks like, learned on the run.

    Args:
        grey: first picture, (H, W) uint8.
        box: the target in it, px.
        t_ns: its stamp, ns.
        trackers: how many there are.
    """

    def __init__(self, grey: np.ndarray, box: Box, t_ns: int, trackers: int = _FIRM):
        self._firm = min(_FIRM, trackers)
        self._supported_ns = t_ns
        self._chosen: str | None = None
        self._agreed_ns = self._dull_ns = t_ns
        self._outvoted = Outvoted()
        self._broken = False
        """Whether the answer has rested on nobody since two trackers, or a sure look, last spoke for it."""
        self._spoke: dict[str, int] = {}
        """When each tracker last spoke for the answer, ns."""
        self.found = False
        """Whether the answer has been without support since it was last firm: it may have been found, not followed."""
        self._refound = False
        """Whether anybody has spoken for it since: till then it is where the target's own motion leads."""
        self._look = Look(grey, box, t_ns)

    def judge(
        self,
        grey: np.ndarray,
        boxes: Mapping[str, Box],
        several: bool,
        fused: Fused | None,
        t_ns: int,
        foreseen: Box | None = None,
        stretches: Mapping[str, Stretch] = MappingProxyType({}),
        confirmed: frozenset[str] = frozenset(),
        copies: frozenset[str] = frozenset(),
    ) -> Verdict:
        """Compare the boxes that trackers report in a picture with what the target has looked like.

        Args:
            grey: the picture, (H, W) uint8.
            boxes: of each tracker that sees the target in this very picture, px.
            several: whether there are other trackers, though they may see nothing.
            fused: the last fused answer; None before any.
            t_ns: stamp of the picture, ns.
            foreseen: where the target's motion over ground leads one to expect it, px; None: unknown.
            stretches: since when each tracker has seen the target without a break, and whether what it sees moves.
            confirmed: trackers that agree with another source where, by a depth camera, the target is.
            copies: trackers that were put on an answer that was found: what they find there shows nothing.
        """
        fused = None if fused is None or fused.state == "waiting" else fused
        if fused is not None and fused.state != "tracking" and t_ns - self._supported_ns >= _BROKEN_S * 1e9:
            self._broken = True
        self.found |= fused is not None and self._undecided(fused, t_ns)
        self._refound = self.found and fused is not None and (self._refound or fused.state == "tracking")
        self._look.see(grey, t_ns)
        bare = {name: self._look.likeness(grey, box) for name, box in boxes.items()}
        if foreseen is None:
            overruling = self._overruling(bare, boxes, copies, fused, t_ns)
            if overruling:
                return Verdict(frozenset(), frozenset(boxes.keys() - overruling), tuple(sorted(overruling)))
            kept = self._kept(grey, bare, boxes, fused, t_ns)
            if kept is not None:
                self._supported_ns = t_ns
                return Verdict(frozenset(), frozenset(boxes), (), kept)
        similar = {n: self._leniently(bare[n], box, fused, foreseen) for n, box in boxes.items()}
        others = frozenset() if fused is None else self._others(similar, boxes, several, fused, t_ns, foreseen)
        majority = () if foreseen is None else self._outvoted.by(similar, boxes, others, t_ns)
        others = frozenset(boxes.keys() - majority) if majority else others
        similar = {name: likeness for name, likeness in similar.items() if name not in others}
        boxes = {name: box for name, box in boxes.items() if name not in others}
        # Where somebody foresees its place, what was expected is that, and the answer is where it was.
        among = None if fused is None or not several else box_of(fused, t_ns if foreseen is None else None)
        begun = majority or self._choose(similar, boxes, fused, t_ns) or found_alone(similar, boxes, among)
        heard = boxes.keys() if self._chosen is None else {self._chosen, *same_as(self._chosen, boxes)}
        stretches = stretches if foreseen is None else {}
        least = _ALONE_THERE_UNLIKE + (self._unsettled(stretches, boxes, t_ns) if self._broken else 0.0)
        followed = (n for n in boxes if n in stretches and self._follows(stretches[n]))
        doubts = doubted(similar, boxes, among, least, foreseen, frozenset(followed)) - confirmed
        return Verdict(doubts, others | (boxes.keys() - heard), begun)

    def _unsettled(self, stretches: Mapping[str, Stretch], boxes: Mapping[str, Box], t_ns: int) -> float:
        """How much more likeness is asked of trackers that may have found another thing, by how long they have it."""
        since_ns = max((stretches[n].since_ns if n in stretches else t_ns for n in boxes), default=t_ns)
        return _FOUND_MORE * max(0.0, 1.0 - (t_ns - since_ns) * 1e-9 / _SETTLED_S)

    def _follows(self, stretch: Stretch) -> bool:
        """Whether a tracker has followed a thing that moves without a break since two last agreed."""
        return stretch.rides and stretch.since_ns <= self._agreed_ns

    def _leniently(self, likeness: float, box: Box, fused: Fused | None, foreseen: Box | None) -> float:
        """Likeness of a box, more in a picture that has lost its detail, if the target was expected there."""
        there = fused is not None and jaccard(box, box_of(fused)) > _NEAR_EXPECTED
        return min(1.0, likeness / self._look.clearness) if there or foreseen is not None else likeness

    def _kept(
        self, grey: np.ndarray, bare: Mapping[str, float], boxes: Mapping[str, Box], fused: Fused | None, t_ns: int
    ) -> Box | None:
        """Where the target still is, though all that see it, and agreed on it a moment ago, have gone elsewhere.

        A thing that crosses one that looks the same takes them along; its own motion tells it from the other.
        """
        if fused is None or fused.state == "lost" or not boxes or self._refound:
            return None
        if t_ns - self._agreed_ns > _KEPT_S * 1e9:
            return None
        expected = box_of(fused, t_ns)
        if any(jaccard(box, expected) > _NEAR_EXPECTED for box in boxes.values()):
            return None
        box, likeness = self._look.best_near(grey, expected)
        return box if gone(bare, boxes, box, likeness) else None

    def _overruling(
        self,
        similar: Mapping[str, float],
        boxes: Mapping[str, Box],
        copies: frozenset[str],
        fused: Fused | None,
        t_ns: int,
    ) -> frozenset[str]:
        """Trackers elsewhere than an answer on which few agree, and that look more like the target.

        What was followed is the target, whatever it looks like; what was found may be another thing, and two that
        agree elsewhere may overrule it. One by itself may where the answer has rested on one alone for long, and the
        other one's look leaves no doubt.
        """
        if fused is None or fused.state == "lost":
            return frozenset()
        last = box_of(fused)
        alone = frozenset[str]()
        if fused.state == "tracking" and t_ns - self._agreed_ns >= _ALONE_S * 1e9:
            alone = outshining(similar, boxes, last)
        if not alone:
            self._dull_ns = t_ns
        if t_ns - self._dull_ns >= _OUTSHONE_S * 1e9:
            return alone
        return rivals(similar, boxes, last, copies) if self.found else frozenset()

    def _others(
        self,
        similar: Mapping[str, float],
        boxes: Mapping[str, Box],
        several: bool,
        fused: Fused,
        t_ns: int,
        foreseen: Box | None,
    ) -> frozenset[str]:
        """Trackers that are at another thing than the target, by where and how large their box is."""
        if fused.state == "lost":
            return frozenset()  # where it is predicted says nothing any more
        last = box_of(fused)
        far = out_of_reach(boxes, last, max(0, t_ns - self._agreed_ns) * 1e-9)
        if not several:
            return far
        if foreseen is None:
            return far | elsewhere(similar, boxes, last, LIKE_BESIDE_TWINS)
        there = {name for name, box in boxes.items() if as_foreseen(box, foreseen)}
        return (far | elsewhere(similar, boxes, last)) - there | elsewhere(similar, boxes, foreseen)

    def likeness(self, grey: np.ndarray, box: Box) -> float:
        """How like the target a box looks, 0 to 1 (`Look.likeness`)."""
        return self._look.likeness(grey, box)

    def learn(self, grey: np.ndarray, box: Box, fused: Fused) -> None:
        """Learn the fused box where trackers that agree speak for it, and from time to time what else is like it."""
        self._spoke |= {name: fused.t_ns for name, j in fused.sources.items() if j.reliability > RELIABLE}
        if sum(fused.t_ns - spoke_ns <= _TOGETHER_S * 1e9 for spoke_ns in self._spoke.values()) >= self._firm:
            self.found = False
        if agreed(fused) or (self._broken and self._look.likeness(grey, box) >= SURELY):
            self._broken = False
        if agreed(fused):
            self._agreed_ns = fused.t_ns
        self._look.learn(grey, box, sure=agreed(fused) and not self.found)

    def vouches(self, grey: np.ndarray, box: Box, fused: Fused) -> bool:
        """Whether trackers may be put on the fused box: several speak for it, or it looks like the target.

        Not where one alone has found it after the answer broke off: those that are put there agree at once, and what
        they agree on would be learned.
        """
        return agreed(fused) or (not self._broken and self._look.likeness(grey, box) >= ALONE_UNLIKE)

    def _choose(
        self, similar: Mapping[str, float], boxes: Mapping[str, Box], fused: Fused | None, t_ns: int
    ) -> tuple[str, ...]:
        """While trackers disagree and the past supports none, let the one that looks most like the target speak.

        Beyond the thesis, where all are then penalised alike and the answer drifts between them. The choice is kept
        until the answer is supported again, or another looks clearly more like the target. Returns those whose past no
        longer holds.
        """
        if fused is None or fused.state == "tracking":
            self._supported_ns, self._chosen = t_ns, None
        elif self._undecided(fused, t_ns):
            best = max(similar, key=lambda name: similar[name], default=None)
            if best is None or similar[best] < _CHOSEN:
                self._chosen = None
            elif self._chosen is None or similar.get(self._chosen, 0.0) < similar[best] - CLEARLY:
                self._chosen = best
                return best, *same_as(best, boxes)
        return ()

    def _undecided(self, fused: Fused, t_ns: int) -> bool:
        """Whether the answer has been without support for longer than one picture that went wrong."""
        return fused.state != "tracking" and t_ns - self._supported_ns >= _UNDECIDED_S * 1e9
