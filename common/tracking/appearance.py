"""What a target has looked like, and what looks like it but is not: small patches, learned on the run.

The nearest-neighbour classifier of TLD (Kalal et al. 2012, DOI 10.1109/TPAMI.2011.239), and a search of the whole
picture by correlation with the patches.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from common.tracking.base import Box

_SIDE = 15
"""Side of a patch, px (TLD)."""
_NEGATIVES, _POSITIVES = 60, 40
_NEW_POSITIVE, _NEW_NEGATIVE = 0.9, 0.6
"""A patch is learned when it is less like the known ones of its kind (or, background, more like the target)."""
_SEARCH_SIDE = 18.0
"""Shorter side of the target in the picture in which it is searched, px."""
_SEARCH_LIMIT = 0.5
"""Least correlation of a candidate in that picture."""
_BLUR = 0.8


@dataclass(frozen=True)
class Candidate:
    """A place that may be the target."""

    box: Box
    """Its box, px."""
    similarity: float
    """Relative similarity, 0 to 1: above one half it is more like the target than like anything else that was seen."""
    correlation: float
    """Correlation with the most similar patch of the target, -1 to 1."""


def upright_patch(grey: np.ndarray, box: Box) -> np.ndarray:
    """The box's content at 15 x 15 px, of mean 0 and length 1, (225,) float32; what is beyond the edge repeats it."""
    x, y, width, height = box
    step_x, step_y = width / _SIDE, height / _SIDE
    left, top = x + (step_x - 1) / 2, y + (step_y - 1) / 2
    # A box of many pixels is first blurred to what a patch's pixel covers, or its samples would be noise.
    coarse = max(step_x, step_y)
    if coarse > 2.0:
        step = int(coarse)
        x0, y0 = max(0, int(x) - step), max(0, int(y) - step)
        x1, y1 = min(grey.shape[1], math.ceil(x + width) + step), min(grey.shape[0], math.ceil(y + height) + step)
        if x1 > x0 and y1 > y0:
            grey = cv2.blur(grey[y0:y1, x0:x1], (step, step))
            left, top = left - x0, top - y0
    matrix = np.array([[step_x, 0.0, left], [0.0, step_y, top]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    patch = cv2.warpAffine(grey, matrix, (_SIDE, _SIDE), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    vector = patch.ravel().astype(np.float32)
    vector -= np.add.reduce(vector) / vector.size
    return vector / (math.sqrt(float(vector @ vector)) + 1e-3)


class Appearance:
    """Patches of the target and of what is not the target."""

    def __init__(self) -> None:
        self._positives = np.zeros((0, _SIDE * _SIDE), np.float32)
        self._negatives = np.zeros((0, _SIDE * _SIDE), np.float32)
        self._turn = 0

    def similarity(self, patch: np.ndarray) -> tuple[float, float]:
        """Relative similarity, 0 to 1, of a patch (225,), and its correlation with the nearest one of the target."""
        best = float((self._positives @ patch).max()) if len(self._positives) else -1.0
        worst = float((self._negatives @ patch).max()) if len(self._negatives) else -1.0
        return _relative(best, worst), best

    def conservative_similarity(self, patch: np.ndarray) -> float:
        """Relative similarity, 0 to 1, of a patch (225,) to the first half of the known ones of the target alone.

        What was learned late may be wrong (Kalal et al. 2012, section 5.3).
        """
        best = float((self._positives[: (len(self._positives) + 1) // 2] @ patch).max())
        worst = float((self._negatives @ patch).max()) if len(self._negatives) else -1.0
        return _relative(best, worst)

    def learn_target(self, patch: np.ndarray) -> None:
        """Remember a patch (225,) of the target, unless one like it is known; the first one is kept for ever."""
        if len(self._positives) and float((self._positives @ patch).max()) > _NEW_POSITIVE:
            return
        if len(self._positives) >= _POSITIVES:
            self._positives = np.delete(self._positives, 1, axis=0)
        self._positives = np.vstack([self._positives, patch])

    def learn_background(self, patch: np.ndarray, least: float = _NEW_NEGATIVE) -> None:
        """Remember a patch (225,) that is not the target, if it correlates with it by so much at least."""
        if float((self._positives @ patch).max()) < least:
            return
        if len(self._negatives) and float((self._negatives @ patch).max()) > _NEW_POSITIVE:
            return
        if len(self._negatives) >= _NEGATIVES:
            self._negatives = np.delete(self._negatives, 0, axis=0)
        self._negatives = np.vstack([self._negatives, patch])

    def search(
        self, grey: np.ndarray, size_px: tuple[float, float], scales: tuple[float, ...], count: int
    ) -> list[Candidate]:
        """Places in a picture (H, W) uint8 that look most like the target, best first.

        Each call takes another of the known patches, besides the newest one: all have had their turn after a while.
        """
        if not len(self._positives):
            return []
        self._turn = (self._turn + 1) % len(self._positives)
        templates = {len(self._positives) - 1, self._turn}
        found = []
        for scale in scales:
            width, height = size_px[0] * scale, size_px[1] * scale
            shrink = min(1.0, _SEARCH_SIDE / min(width, height))
            small = cv2.resize(grey, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA) if shrink < 1 else grey
            side = (max(4, round(width * shrink)), max(4, round(height * shrink)))
            if side[0] >= small.shape[1] or side[1] >= small.shape[0]:
                continue
            for index in templates:
                picture = self._positives[index].reshape(_SIDE, _SIDE)
                template = cv2.resize(picture * 500 + 128, side, interpolation=cv2.INTER_LINEAR).astype(np.float32)
                match = cv2.matchTemplate(small.astype(np.float32), template, cv2.TM_CCOEFF_NORMED)
                for x, y in _peaks(match, side, count):
                    found.append((x / shrink, y / shrink, width, height))
        judged = []
        for box in found:
            similarity, correlation = self.similarity(upright_patch(grey, box))
            judged.append(Candidate(box, similarity, correlation))
        return sorted(judged, key=lambda c: -c.similarity)


def _relative(best: float, worst: float) -> float:
    """Relative similarity, 0 to 1, by the correlations with the nearest patch of the target and of the background."""
    like, unlike = 1.0 - (best + 1.0) / 2, 1.0 - (worst + 1.0) / 2
    return unlike / (like + unlike + 1e-6)


def _peaks(match: np.ndarray, side: tuple[int, int], count: int) -> list[tuple[float, float]]:
    """Corners (x, y) of the highest peaks of a correlation, at least half a template apart."""
    places = []
    match = match.copy()
    for _ in range(count):
        _, value, _, (x, y) = cv2.minMaxLoc(match)
        if value < _SEARCH_LIMIT:
            break
        places.append((float(x), float(y)))
        half = (side[0] // 2, side[1] // 2)
        match[max(0, y - half[1]) : y + half[1] + 1, max(0, x - half[0]) : x + half[0] + 1] = -1.0
    return places
