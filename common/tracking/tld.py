"""TLD: a tracker, a detector, and what each learns from the other's errors (Kalal et al. 2012).

DOI 10.1109/TPAMI.2011.239; the tracker of Echeverri 2016, section 3.2. Median flow carries the box on (section 5.2);
the detector scans all windows by variance, ferns and nearest neighbours (5.3); the integrator takes the more certain of
both (5.5); while the trajectory is valid, P-N learning corrects the detector (5.6).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np

from common.evaluation import jaccard
from common.tracking.appearance import Appearance, upright_patch
from common.tracking.base import Box, center_of, size_of
from common.tracking.box_tracker import BoxTracker, Step
from common.tracking.median_flow import median_flow
from common.tracking.tld_config import TldConfig
from common.tracking.tld_detector import Detector

_JUDGED = 60
"""Windows that the nearest neighbours judge in one picture, those of largest confidence (the paper: 100)."""
_LEARNED, _CONFUSED = 0.75, 0.5
"""Relative similarity up to which a patch of the target is learned, and from which one of the background is (the
authors' code: 0.65, 0.5)."""
_CONFIRMED = 8
"""Pictures after which a patch is learned, if the trajectory has been valid in all of them."""
_FIRST_OTHERS = 60
"""Patches of the first picture's background (the paper: 100): without any, everything is like the target."""
_FAR = 0.2
"""Overlap with the target below which a window is background."""
_CLOSE = 0.7
"""Overlap with the tracker's box above which a window corrects it."""
_ONE_CLUSTER = 0.5
"""Overlap above which two windows are one answer of the detector."""
_ELSEWHERE = 0.5
"""Share of the smaller box below which two are at different places: a part of a face may look more like the face than
the whole does (the paper: an overlap below 0.5)."""
_SURER = 0.1
"""How much more similar a window elsewhere must be than the box of a valid trajectory (the paper: at all)."""
_TRACKER_WEIGHT = 10.0
"""How many windows the tracker's own box counts as then (the authors' code: 10)."""


class _Found(NamedTuple):
    """What the detector takes for the target."""

    box: Box
    similarity: float
    """Relative similarity, 0 to 1."""


class TldTracker(BoxTracker):
    """Tracks an upright box. See `common.tracking.base.Tracker`.

    Args:
        config: its parameters.
        rng: places the ferns' comparisons, and distorts what they learn.
    """

    config_type = TldConfig
    name = "tld"

    def __init__(self, config: TldConfig, rng: np.random.Generator):
        super().__init__(config)
        self._config = config
        self._seed = int(rng.integers(2**31))

    def init(self, frame: np.ndarray, box: Box, angle_rad: float = 0.0, t_ns: int | None = None) -> None:
        """Learn the target and what is around it; a rotation of the box is not followed."""
        self._begin(frame, box, angle_rad, t_ns)
        rng = np.random.default_rng(self._seed)
        self._grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
        self._detector = Detector(self._grey.shape, box, self._config, rng)
        self._detector.learn_first(self._grey, box)
        self._appearance = Appearance()
        self._appearance.learn_target(upright_patch(self._grey, box))
        for other in self._detector.others(box, _FIRST_OTHERS):
            self._appearance.learn_background(upright_patch(self._grey, other), -1.0)
        self._learn_background(self._grey, self._detector.find(self._grey), box)
        self._flow: Box | None = box  # where the flow goes on from; it goes on a while where the target is not seen
        self._valid = True
        self._pending: list[np.ndarray] = []
        self._result = self._report(1.0, "tracking")

    def place(self, frame: np.ndarray, box: Box) -> None:
        """Go on from a box that somebody else found, without learning anything from it.

        Raises:
            ValueError: not started, or a bad box.
        """
        super().place(frame, box)
        self._grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
        self._flow, self._valid = self._box, False

    def _step(self, frame: np.ndarray) -> Step:
        """Track, detect, integrate, learn."""
        grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
        tracked = None if self._flow is None else self._tracked(grey, self._flow)
        passed = self._detector.find(grey)
        box, again = self._integrated(grey, tracked, self._detected(grey, passed))
        score = 0.0 if box is None else self._score(*self._appearance.similarity(upright_patch(grey, box)))
        self._grey, self._flow = grey, box
        if box is None or score < 0.5:
            self._valid, self._pending = False, []
            if self._unseen_ns > self._config.lost_after_s * 1e9:
                self._flow = None  # it has followed something else: the detector starts anew
            return Step(score, False)
        self._go_to(box)
        if not self._valid or self._appearance.similarity(upright_patch(grey, box))[0] < _CONFUSED:
            self._pending = []
        else:
            self._detector.learn(box)
            self._learn_target(grey, box)
            self._learn_background(grey, passed, box)
        return Step(score, True, again)

    @property
    def _box(self) -> Box:
        width, height = self._size_px.tolist()
        return float(self._center[0]) - width / 2, float(self._center[1]) - height / 2, width, height

    def _go_to(self, box: Box) -> None:
        self._center = np.array(center_of(box))
        self._scale = self._bounded(math.sqrt(box[2] * box[3] / float(self._base.prod())))

    def _tracked(self, grey: np.ndarray, box: Box) -> Box | None:
        """Where the flow carries a box; None where it fails, or leaves the picture."""
        moved = median_flow(self._grey, grey, box, self._expected_px)
        if moved is None or moved.error_px > self._config.flow_error * size_of(box):
            return None
        width, height = box[2] * moved.grown, box[3] * moved.grown
        u, v = np.array(center_of(box)) + moved.offset_px
        rows, columns = grey.shape
        if not (0 <= u < columns and 0 <= v < rows):
            return None
        scale = math.sqrt(width * height / float(self._base.prod()))
        if self._bounded(scale) != scale:
            return None
        return float(u) - width / 2, float(v) - height / 2, width, height

    def _detected(self, grey: np.ndarray, passed: list[Box]) -> list[_Found]:
        """Windows that the nearest neighbours take for the target."""
        config, found = self._config, []
        for box in passed[:_JUDGED]:
            similarity, correlation = self._appearance.similarity(upright_patch(grey, box))
            if similarity > config.found_similarity and correlation > config.found_correlation:
                found.append(_Found(box, similarity))
        return found

    def _integrated(self, grey: np.ndarray, tracked: Box | None, detected: list[_Found]) -> tuple[Box | None, bool]:
        """The box of both, and whether the detector has started it anew; sets whether the trajectory is valid."""
        clusters = _clustered(detected)
        if tracked is None:
            self._valid = False
            return (clusters[0].box, True) if len(clusters) == 1 else (None, False)
        patch = upright_patch(grey, tracked)
        similarity, _ = self._appearance.similarity(patch)
        least = similarity + (_SURER if self._valid else 0.0)
        surer = [one for one in clusters if _covered(one.box, tracked) < _ELSEWHERE and one.similarity > least]
        if len(surer) == 1:
            self._valid = False
            return surer[0].box, True
        if self._appearance.conservative_similarity(patch) >= self._config.valid_similarity:
            self._valid = True
        close = [one.box for one in detected if jaccard(one.box, tracked) > _CLOSE]
        mean = (_TRACKER_WEIGHT * np.array(tracked) + np.sum(close or [np.zeros(4)], axis=0)) / (
            _TRACKER_WEIGHT + len(close)
        )
        x, y, width, height = mean.tolist()
        return (x, y, width, height), False

    def _score(self, similarity: float, correlation: float) -> float:
        """Lesser of both measures over its limit, times one half, 0 to 1.

        What else looks like the target is no reason to doubt a trajectory that is valid: then a close likeness is
        enough, relative or not.
        """
        config = self._config
        likeness = similarity / config.seen_similarity
        if self._valid:
            likeness = max(likeness, correlation / config.valid_correlation)
        return min(1.0, max(0.0, 0.5 * min(likeness, correlation / config.seen_correlation)))

    def _learn_target(self, grey: np.ndarray, box: Box) -> None:
        """Teach the nearest neighbours what they would not have found; else every small slip would become the target.

        Not before the trajectory has stayed valid for some pictures more: what slides over the target would be learned
        piece by piece.
        """
        self._pending.append(upright_patch(grey, box))
        if len(self._pending) <= _CONFIRMED:
            return
        patch = self._pending.pop(0)
        similarity, correlation = self._appearance.similarity(patch)
        if similarity <= _LEARNED and correlation >= self._config.found_correlation:
            self._appearance.learn_target(patch)

    def _learn_background(self, grey: np.ndarray, passed: list[Box], box: Box) -> None:
        """Teach the nearest neighbours what the ferns take for the target elsewhere."""
        for other in passed[:_JUDGED]:
            if _covered(other, box) >= _FAR:
                continue
            patch = upright_patch(grey, other)
            if self._appearance.similarity(patch)[0] >= _CONFUSED:
                self._appearance.learn_background(patch)


def _covered(one: Box, other: Box) -> float:
    """Area that two boxes share over that of the smaller one: a part of the target is not the background."""
    across = min(one[0] + one[2], other[0] + other[2]) - max(one[0], other[0])
    down = min(one[1] + one[3], other[1] + other[3]) - max(one[1], other[1])
    return max(0.0, across) * max(0.0, down) / min(one[2] * one[3], other[2] * other[3])


def _clustered(detected: list[_Found]) -> list[_Found]:
    """Mean box, and largest similarity, of each group of windows that overlap by one half, single linkage."""
    groups: list[list[_Found]] = []
    for one in detected:
        joined = [group for group in groups if any(jaccard(one.box, other.box) > _ONE_CLUSTER for other in group)]
        merged = [one, *(entry for group in joined for entry in group)]
        groups = [group for group in groups if group not in joined] + [merged]
    found = []
    for group in groups:
        x, y, width, height = np.mean([one.box for one in group], axis=0).tolist()
        found.append(_Found((x, y, width, height), max(one.similarity for one in group)))
    return found
