"""DSST with re-detection: correlation filters for place and size, and a detector that finds the target again.

Danelljan et al. 2014 (DOI 10.5244/C.28.65) for the filters; the failure measure is the peak-to-sidelobe ratio of Bolme
et al. 2010 together with the nearest-neighbour classifier of TLD, and the re-detection is in TLD's spirit (Haag et al.
2015, the DSSTtld of Echeverri 2016). Two things are learned only from pictures in which both measures say that the
target is seen: what it looks like now, and what else in the picture looks like it.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from common.tracking.appearance import Appearance, upright_patch
from common.tracking.base import Box, center_of
from common.tracking.box_tracker import BoxTracker, Step
from common.tracking.correlation import CorrelationFilter, peak_of, peak_to_sidelobe
from common.tracking.dsst_config import DsstConfig
from common.tracking.hog import CELL_PX, gradients_of_cells

_SCALE_SIDE_CELLS = 8
"""Side of a square patch of the size filter, cells."""
_SCALES_SEARCHED = (1.0, 0.8, 1.25)
_CANDIDATES = 4
_SURE = 1.4
"""Peak-to-sidelobe ratio over its limit above which a picture teaches what the target looks like."""
_BACKGROUND_EVERY = 5
"""Pictures between two looks for what else is like the target."""
_APART = 0.2
"""Largest overlap with the target of what counts as background."""


class DsstTracker(BoxTracker):
    """Tracks an upright box. See `common.tracking.base.Tracker`.

    Args:
        config: its parameters.
        rng: not used; the tracker has no randomness.
    """

    config_type = DsstConfig
    name = "dsst"

    def __init__(self, config: DsstConfig, rng: np.random.Generator):
        del rng
        super().__init__(config)
        self._config = config
        half = config.scales // 2
        self._steps = config.scale_step ** np.arange(-half, config.scales - half, dtype=float)

    def init(self, frame: np.ndarray, box: Box, angle_rad: float = 0.0, t_ns: int | None = None) -> None:
        """Learn both filters and the first patch; a rotation of the box is not followed."""
        self._begin(frame, box, angle_rad, t_ns)
        window = self._base * self._config.padding
        self._cells = np.maximum(8, np.round(window / math.sqrt(window.prod()) * self._config.window_cells)).astype(int)
        spread = self._config.spread / self._config.padding * self._cells[::-1]
        shape = (int(self._cells[1]), int(self._cells[0]))
        self._place = CorrelationFilter(shape, (float(spread[0]), float(spread[1])), self._config.regularisation)
        count = len(self._steps)
        self._size = CorrelationFilter((count, 1), (count / 16, 0.0), self._config.regularisation)
        self._appearance = Appearance()
        self._ratio = 0.0
        grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
        self._appearance.learn_target(upright_patch(grey, box))
        self._learn(frame, grey, 1.0)
        self._learn_background(grey)
        self._result = self._report(1.0, "tracking")

    def _step(self, frame: np.ndarray) -> Step:
        """Place, then size, then whether that is the target at all; a search of the whole picture if not."""
        grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
        before = (self._center.copy(), self._scale)
        score, again = self._follow(frame, grey), False
        if score < 0.5:
            # What was followed is not the target: the next picture is searched from the last good place.
            self._center, self._scale = before
            if self._unseen >= self._config.patience and (found := self._search(frame, grey)) is not None:
                score, again = found, True
        if score >= 0.5:
            self._learn_from(frame, grey, score)
        return Step(score, score >= 0.5, again)

    def _follow(self, frame: np.ndarray, grey: np.ndarray) -> float:
        """Move to the peak of the place filter, then of the size filter; returns the score, 0.5 at its limits."""
        response = self._place.response(self._place_features(frame, grey))
        rows, columns = peak_of(response)
        self._center = self._center + np.array([columns, rows]) / self._cells * self._window
        self._hold_in_picture()
        steps, _ = peak_of(self._size.response(self._size_features(grey)))
        self._scale = self._bounded(self._scale * self._config.scale_step**steps)
        similarity, _ = self._appearance.similarity(upright_patch(grey, self._box))
        self._ratio = peak_to_sidelobe(response)
        return self._score(self._ratio, similarity)

    def _score(self, ratio: float, similarity: float) -> float:
        """Lesser of both measures over its limit, times one half, at most 1."""
        config = self._config
        return min(1.0, 0.5 * min(ratio / config.psr_limit, similarity / config.similarity_limit))

    def _search(self, frame: np.ndarray, grey: np.ndarray) -> float | None:
        """Look for the target in the whole picture; returns the score there, or None and nothing is changed."""
        before = (self._center, self._scale)
        size = (float(self._size_px[0]), float(self._size_px[1]))
        scale = (_SCALES_SEARCHED[self._number % len(_SCALES_SEARCHED)],)
        for candidate in self._appearance.search(grey, size, scale, _CANDIDATES)[:2]:
            config = self._config
            if candidate.similarity < config.found_similarity or candidate.correlation < config.found_correlation:
                break
            self._center = np.array(center_of(candidate.box))
            self._scale = self._bounded(before[1] * candidate.box[2] / size[0])
            score = self._follow(frame, grey)
            if score >= 0.5:
                return score
            self._center, self._scale = before
        return None

    def _learn_from(self, frame: np.ndarray, grey: np.ndarray, score: float) -> None:
        self._learn(frame, grey, self._config.learning_rate)
        if self._ratio >= _SURE * self._config.psr_limit:
            self._appearance.learn_target(upright_patch(grey, self._box))
        if self._number % _BACKGROUND_EVERY == 0:
            self._learn_background(grey)

    def _learn(self, frame: np.ndarray, grey: np.ndarray, rate: float) -> None:
        self._place.learn(self._place_features(frame, grey), rate)
        self._size.learn(self._size_features(grey), rate if rate == 1.0 else self._config.scale_learning_rate)

    def _learn_background(self, grey: np.ndarray) -> None:
        size = (float(self._size_px[0]), float(self._size_px[1]))
        own = self._report(1.0, "tracking")
        for candidate in self._appearance.search(grey, size, (1.0,), _CANDIDATES):
            if own.overlap(candidate.box) < _APART:
                self._appearance.learn_background(upright_patch(grey, candidate.box))

    def _place_features(self, frame: np.ndarray, grey: np.ndarray) -> np.ndarray:
        """Gradients, grey and two colour differences of the window, (rows, columns, 30)."""
        side = self._cells * CELL_PX
        x, y = self._center - self._window / 2
        patch = _cut(frame, (x, y, *self._window), (int(side[0]), int(side[1])))
        tones = cv2.cvtColor(patch, cv2.COLOR_BGR2GRAY).astype(np.float32)
        gradients = gradients_of_cells(tones[None])[0]
        small = cv2.resize(patch, (int(self._cells[0]), int(self._cells[1])), interpolation=cv2.INTER_AREA)
        colours = small.astype(np.float32) / 255
        grey_cells = colours.mean(axis=2)
        differences = colours[..., 2] - colours[..., 1], colours[..., 0] - colours[..., 1]
        return np.dstack([gradients, grey_cells - grey_cells.mean(), *differences])

    def _size_features(self, grey: np.ndarray) -> np.ndarray:
        """Gradients of the target's box at each size, (scales, 1, entries), level after level."""
        side = _SCALE_SIDE_CELLS * CELL_PX
        size = self._size_px
        patches = np.empty((len(self._steps), side, side), np.float32)
        for index, step in enumerate(self._steps):
            width, height = size * step
            box = (self._center[0] - width / 2, self._center[1] - height / 2, width, height)
            patches[index] = _cut(grey, box, (side, side))
        return gradients_of_cells(patches).reshape(len(self._steps), 1, -1)

    @property
    def _window(self) -> np.ndarray:
        """Width and height of the searched window, px."""
        return self._size_px * self._config.padding

    @property
    def _box(self) -> Box:
        width, height = self._size_px
        return float(self._center[0] - width / 2), float(self._center[1] - height / 2), float(width), float(height)


def _cut(picture: np.ndarray, box: Box, size: tuple[int, int]) -> np.ndarray:
    """The box's content at another size (width, height), px; what is beyond the picture's edge repeats it."""
    x, y, width, height = box
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    shrink_x, shrink_y = width / size[0], height / size[1]
    matrix = np.array([[shrink_x, 0.0, x + (shrink_x - 1) / 2], [0.0, shrink_y, y + (shrink_y - 1) / 2]])
    return cv2.warpAffine(picture, matrix, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
