"""How a target looks, learned on the run, and how much of its look a picture can show."""

from __future__ import annotations

import math

import cv2
import numpy as np

from common.evaluation import jaccard
from common.tracking.appearance import Appearance, upright_patch
from common.tracking.base import Box

_CORRELATED = 0.5
"""Correlation with a known patch below which a box is taken for less similar than it is relative to the background."""
_SHRINK = 0.25
"""Size of the picture in which detail is measured, over the whole: there noise is none."""
_DETAIL_MEMORY_S = 3.0
"""Time constant with which the usual detail follows the pictures, s."""
_CLEAR, _LEAST_CLEAR = 1.5, 0.5
"""Detail over its usual value counts as full from one over the first on; the second is the least that is reckoned."""
_BACKGROUND_EVERY = 10
"""Pictures between two looks for what else is like the target."""
_NEAR = (-0.2, -0.1, 0.0, 0.1, 0.2)
"""How far around a place is looked for the target, box sides."""
_APART = 0.2
"""Largest overlap with the target of what counts as background."""


class Look:
    """TLD's nearest-neighbour classifier (Kalal et al. 2012, section 5.3) over the fused target.

    Args:
        grey: first picture, (H, W) uint8.
        box: the target in it, px.
        t_ns: its stamp, ns.
    """

    def __init__(self, grey: np.ndarray, box: Box, t_ns: int):
        self._appearance = Appearance()
        self._number = 0
        self._appearance.learn_target(upright_patch(grey, box))
        self._learn_background(grey, box)
        self._detail, self._looked_ns = 0.0, t_ns
        self.clearness = 1.0
        """Detail of the picture seen last against what is usual, 0 to 1: so much likeness can be asked of it."""
        self.see(grey, t_ns)

    def see(self, grey: np.ndarray, t_ns: int) -> None:
        """Note how much detail a new picture (H, W) has as a whole against what is usual.

        In a picture that is blurred or dark as a whole, nothing looks as it did, the target no less than the rest.
        """
        small = cv2.resize(grey, None, fx=_SHRINK, fy=_SHRINK, interpolation=cv2.INTER_AREA)
        detail = float(cv2.Laplacian(small, cv2.CV_32F).std())
        share = -math.expm1(-max(0, t_ns - self._looked_ns) * 1e-9 / _DETAIL_MEMORY_S)
        self._detail = detail if self._detail == 0.0 else self._detail + share * (detail - self._detail)
        self._looked_ns = t_ns
        self.clearness = min(1.0, max(_LEAST_CLEAR, _CLEAR * detail / max(self._detail, 1e-6)))

    def likeness(self, grey: np.ndarray, box: Box) -> float:
        """Relative similarity of a box, less where it correlates with no known patch of the target, 0 to 1.

        While little is known of the background, anything is more like the target than like that.
        """
        similarity, correlation = self._appearance.similarity(upright_patch(grey, box))
        return similarity * min(1.0, max(0.0, correlation / _CORRELATED))

    def best_near(self, grey: np.ndarray, box: Box) -> tuple[Box, float]:
        """The box of this size near a place, px, that is most like the target, and its likeness."""
        x, y, width, height = box
        near: list[Box] = [(x + u * width, y + v * height, width, height) for u in _NEAR for v in _NEAR]
        rated = [self.likeness(grey, one) for one in near]
        best = int(np.argmax(rated))
        return near[best], rated[best]

    def learn(self, grey: np.ndarray, box: Box, *, sure: bool) -> None:
        """Learn the target where one is sure of it, and from time to time what else is like it.

        Args:
            grey: the picture, (H, W) uint8.
            box: the fused box in it, px.
            sure: whether it is the target; nothing is learned else.
        """
        self._number += 1
        if not sure:
            return
        self._appearance.learn_target(upright_patch(grey, box))
        if self._number % _BACKGROUND_EVERY == 0:
            self._learn_background(grey, box)

    def _learn_background(self, grey: np.ndarray, box: Box) -> None:
        for candidate in self._appearance.search(grey, (box[2], box[3]), (1.0,), 4):
            if jaccard(candidate.box, box) < _APART:
                self._appearance.learn_background(upright_patch(grey, candidate.box))
