"""TLD's detector: windows of all places and sizes through variance and ferns, and what teaches the ferns.

Kalal et al. 2012, sections 5.3 and 5.6. The nearest neighbours, its third stage, are `common.tracking.appearance`.
"""

from __future__ import annotations

import cv2
import numpy as np

from common.tracking.base import Box, center_of, size_of
from common.tracking.tld_compiled import overlaps, scan
from common.tracking.tld_config import TldConfig

_CONFIDENT = 0.5
"""Mean posterior above which a window passes (the paper: 0.5)."""
_VARIANCE_SHARE = 0.5
"""Variance of a window over the target's first one below which it is not looked at (the paper: 0.5)."""
_NEAR, _FAR = 0.6, 0.2
"""Overlap with the target above which windows teach the ferns that they are it, and below which that they are not."""
_NEAREST = 10
_FIRST_WARPS, _WARPS = 20, 4
"""Distorted pictures of the target that the first one gives, and each later one (the paper: 20, 10)."""
_TURN_DEG, _GROWTH, _NOISE = 10.0, 0.02, 5.0
"""Largest rotation and change of size of a distorted picture, and the noise in it, grey levels (the paper's)."""
_BLUR = 1.2
_LEAST_SIDE_PX = 10


class Detector:
    """Scans pictures of one size, scaled down so that the target is small.

    Args:
        shape: (H, W) of the pictures.
        box: of the target, px.
        config: its parameters.
        rng: places the comparisons, and distorts pictures.
    """

    def __init__(self, shape: tuple[int, int], box: Box, config: TldConfig, rng: np.random.Generator):
        self._shrink = min(1.0, config.side_px / size_of(box))
        self._shape = (round(shape[0] * self._shrink), round(shape[1] * self._shrink))
        self._rng = rng
        sides = self._sides(np.array(box[2:]) * self._shrink, config)
        self._windows, self._kinds = self._grid(sides, config.shift)
        self._pairs = self._comparisons(sides, config)
        self._counts = np.zeros((2, config.ferns, 2**config.bits), np.float32)
        self._posteriors = np.zeros((config.ferns, 2**config.bits), np.float32)
        self._least_variance = 0.0
        self._searched = np.zeros(self._shape, np.uint8)
        self._nothing = np.zeros((self._shape[0] + 1, self._shape[1] + 1))
        self._codes = np.zeros((len(self._windows), config.ferns), np.int32)
        self._confidence = np.zeros(len(self._windows), np.float32)

    def _sides(self, size: np.ndarray, config: TldConfig) -> list[np.ndarray]:
        """Widths and heights of windows, (2,) int each, px of the small picture."""
        powers = np.arange(config.scales) - config.scales // 2
        sides = [np.round(size * config.scale_step**power).astype(int) for power in powers]
        rows, columns = self._shape
        least = min(_LEAST_SIDE_PX, round(float(size.min())))
        sides = [s for s in sides if s.min() >= least and s[0] < columns - 1 and s[1] < rows - 1]
        return sides or [np.maximum(2, np.minimum(np.round(size), (columns - 2, rows - 2))).astype(int)]

    def _grid(self, sides: list[np.ndarray], shift: float) -> tuple[np.ndarray, np.ndarray]:
        windows, kinds = [], []
        for kind, (width, height) in enumerate(sides):
            step = max(1, round(shift * min(width, height)))
            x, y = np.arange(0, self._shape[1] - width, step), np.arange(0, self._shape[0] - height, step)
            corners = np.stack(np.meshgrid(x, y), axis=2).reshape(-1, 2)
            windows.append(np.column_stack([corners, np.tile((width, height), (len(corners), 1))]))
            kinds.append(np.full(len(corners), kind))
        return np.concatenate(windows).astype(np.uint32), np.concatenate(kinds).astype(np.uint32)

    def _comparisons(self, sides: list[np.ndarray], config: TldConfig) -> np.ndarray:
        """Offsets (sizes, ferns, bits, 2) uint32 of the two pixels of each comparison, which lie along one axis."""
        rng, shape = self._rng, (config.ferns, config.bits)
        one = rng.uniform(0.0, 1.0, (*shape, 2))
        other, along = one.copy(), rng.integers(0, 2, shape)
        np.put_along_axis(other, along[..., None], rng.uniform(0.0, 1.0, (*shape, 1)), axis=2)
        places = np.stack([one, other], axis=2)
        pixels = [np.floor(places * side).astype(np.uint32) for side in sides]
        return np.stack([p[..., 1] * np.uint32(self._shape[1]) + p[..., 0] for p in pixels])

    def learn_first(self, grey: np.ndarray, box: Box) -> None:
        """Learn the target from one picture (H, W) uint8 and from distorted copies of it, and the rest as not it."""
        small = self._small(grey)
        x, y, width, height = (round(v * self._shrink) for v in box)
        own = small[max(0, y) : y + height, max(0, x) : x + width]
        self._least_variance = _VARIANCE_SHARE * float(own.astype(np.float64).var())
        shared = self._overlaps(box)
        self._teach_target(small, box, shared, _FIRST_WARPS)
        self._scan(small, 0.0)
        self._teach(self._codes[(shared < _FAR) & (self._confidence >= 0.0)], target=False)

    def others(self, box: Box, count: int) -> list[Box]:
        """Some windows of the picture that was learned first that are not plain and not the target, px."""
        far = np.flatnonzero((self._overlaps(box) < _FAR) & (self._confidence >= 0.0))
        chosen = self._rng.choice(far, min(count, len(far)), replace=False)
        return [tuple(window) for window in (self._windows[chosen] / self._shrink).tolist()]

    def find(self, grey: np.ndarray) -> list[Box]:
        """Windows that pass variance and ferns, px of the picture (H, W) uint8, those of largest confidence first."""
        self._searched = self._small(grey)
        self._scan(self._searched, _CONFIDENT)
        passed = np.flatnonzero(self._confidence > _CONFIDENT)
        passed = passed[np.argsort(-self._confidence[passed], kind="stable")]
        return [tuple(window) for window in (self._windows[passed] / self._shrink).tolist()]

    def learn(self, box: Box) -> None:
        """P-N learning: windows on the target teach the ferns that they are it; others that passed, that they are not.

        Args:
            box: the target in the picture that was searched last, px.
        """
        shared = self._overlaps(box)
        wrong = (self._confidence > _CONFIDENT) & (shared < _FAR)
        self._teach(self._codes[wrong], target=False)
        self._teach_target(self._searched, box, shared, _WARPS)

    def _small(self, grey: np.ndarray) -> np.ndarray:
        if self._shrink == 1.0:
            return grey
        return cv2.resize(grey, self._shape[::-1], interpolation=cv2.INTER_AREA)

    def _teach_target(self, small: np.ndarray, box: Box, shared: np.ndarray, warps: int) -> None:
        """Teach the ferns the windows (n overlaps are given) that are nearest to the target, and distorted copies."""
        near = np.flatnonzero(shared > _NEAR)
        near = near[np.argsort(-shared[near], kind="stable")[:_NEAREST]]
        if not len(near):
            return
        windows, kinds = self._windows[near], self._kinds[near]
        codes = np.empty((len(near), self._codes.shape[1]), np.int32)
        confidence = np.empty(len(near), np.float32)
        x0, y0 = windows[:, :2].min(axis=0).tolist()
        x1, y1 = (windows[:, :2] + windows[:, 2:]).max(axis=0).tolist()
        u, v = center_of(box)
        middle = (u * self._shrink, v * self._shrink)
        picture = np.zeros(self._shape, np.uint8)
        for number in range(warps + 1):
            part = small[y0:y1, x0:x1] if number == 0 else self._distorted(small, middle, (x0, y0, x1, y1))
            picture[y0:y1, x0:x1] = cv2.GaussianBlur(part, (0, 0), _BLUR)
            self._look_at(picture, self._nothing, self._nothing, windows, kinds, codes, confidence, -1.0, 0.0)
            self._teach(codes, target=True)

    def _distorted(self, small: np.ndarray, middle: tuple[float, float], part: tuple[int, int, int, int]) -> np.ndarray:
        """A part (x0, y0, x1, y1) of the picture after a small rotation about a point, growth, and noise."""
        angle, grown = self._rng.uniform(-_TURN_DEG, _TURN_DEG), 1.0 + self._rng.uniform(-_GROWTH, _GROWTH)
        matrix = cv2.getRotationMatrix2D(middle, angle, grown)
        matrix[:, 2] -= part[:2]
        size = (part[2] - part[0], part[3] - part[1])
        turned = cv2.warpAffine(small, matrix, size, borderMode=cv2.BORDER_REPLICATE)
        noisy = turned + np.float32(_NOISE) * self._rng.standard_normal(turned.shape, np.float32)
        return np.clip(noisy, 0, 255).astype(np.uint8)

    def _overlaps(self, box: Box) -> np.ndarray:
        """Jaccard index (n,) of each window with a box, px of the picture."""
        shared = np.empty(len(self._windows), np.float32)
        x, y, width, height = (v * self._shrink for v in box)
        overlaps(self._windows, x, y, width, height, shared)
        return shared

    def _scan(self, small: np.ndarray, least_confidence: float) -> None:
        """Codes and confidence of all windows; those that cannot reach a confidence are given up."""
        sums, squares = cv2.integral2(small, sdepth=cv2.CV_64F, sqdepth=cv2.CV_64F)
        self._look_at(
            cv2.GaussianBlur(small, (0, 0), _BLUR), sums, squares, self._windows, self._kinds,
            self._codes, self._confidence, self._least_variance, least_confidence,
        )  # fmt: skip

    def _look_at(
        self, blurred: np.ndarray, sums: np.ndarray, squares: np.ndarray, windows: np.ndarray, kinds: np.ndarray,
        codes: np.ndarray, confidence: np.ndarray, least_variance: float, least_confidence: float,
    ) -> None:  # fmt: skip
        scan(
            blurred.ravel(), sums, squares, windows, kinds, self._pairs, self._posteriors, self._shape[1],
            least_variance, least_confidence, codes, confidence,
        )  # fmt: skip

    def _teach(self, codes: np.ndarray, *, target: bool) -> None:
        """Count codes (n, ferns) that the ferns judge wrongly, and set their posteriors anew."""
        ferns = np.arange(codes.shape[1])
        confidence = self._posteriors[ferns, codes].mean(axis=1)
        codes = codes[confidence <= _CONFIDENT if target else confidence >= _CONFIDENT]
        np.add.at(self._counts[int(target)], (ferns, codes), 1.0)
        not_it, it = self._counts[0][ferns, codes], self._counts[1][ferns, codes]
        self._posteriors[ferns, codes] = it / np.maximum(it + not_it, 1.0)
