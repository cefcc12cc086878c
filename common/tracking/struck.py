"""Struck: structured-output tracking with kernels on a budget (Hare et al. 2011, DOI 10.1109/ICCV.2011.6126251).

The machine learns to rank boxes, not to tell target from background: the box of highest discriminant is the target.
Features are gradients and tones instead of Haar responses, sizes are compared besides places, and, since the paper's
tracker learns from every picture whatever is in it, ours learns only while the discriminant is near its usual value,
says that the target is not seen where it is far below, and then searches the whole picture, a part at a time.
"""

from __future__ import annotations

import math

import numpy as np

from common.tracking.base import Box
from common.tracking.box_tracker import BoxTracker, Step
from common.tracking.struck_config import StruckConfig
from common.tracking.struck_features import SIDE, SIZE, Window
from common.tracking.struck_svm import StructuredSvm

_RINGS = np.array([3, 6, 10, 16])
"""Distances of the boxes that a picture teaches, px of the window."""
_SPOKES = 12
_SIZES_LEARNED = np.array([0.7, 0.85, 1.18, 1.4])
_SIZE_STEPS = np.arange(-2, 3)
_COARSE, _SEARCH_STEP = 2, 4
"""Steps of the grids of offsets near the target and in the whole picture, px of the window."""
_SEARCHED = 1500
"""Boxes of the whole picture that are looked at in one picture."""
_SEARCH_SCALES = (1.0, 0.8, 1.25)
_MEMORY = 0.05
"""Share of a new picture in the usual value of the discriminant."""


class StruckTracker(BoxTracker):
    """Tracks an upright box. See `common.tracking.base.Tracker`.

    Args:
        config: its parameters.
        rng: chooses which old pictures are learned from again.
    """

    config_type = StruckConfig
    name = "struck"

    def __init__(self, config: StruckConfig, rng: np.random.Generator):
        super().__init__(config)
        self._config = config
        self._seed = int(rng.integers(2**31))
        angles = np.arange(_SPOKES) * (2 * math.pi / _SPOKES)
        rings = _RINGS[:, None, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        self._learned = np.vstack([[[0, 0]], np.round(rings.reshape(-1, 2))]).astype(int)
        self._losses = np.concatenate(
            [_losses_of(self._learned), 1 - np.minimum(_SIZES_LEARNED, 1 / _SIZES_LEARNED) ** 2]
        )
        reach = round(SIDE * config.reach)
        self._reach = reach - reach % _COARSE

    def init(self, frame: np.ndarray, box: Box, angle_rad: float = 0.0, t_ns: int | None = None) -> None:
        """Learn the first pattern; a rotation of the box is not followed."""
        self._begin(frame, box, angle_rad, t_ns)
        config = self._config
        rng = np.random.default_rng(self._seed)
        self._machine = StructuredSvm(SIZE, config.budget, config.cost, config.kernel, rng)
        self._part = 0
        self._learn(frame)
        self._usual = float(self._machine.evaluate(self._features(frame))[0])
        self._result = self._report(1.0, "tracking")

    def _step(self, frame: np.ndarray) -> Step:
        """The box of highest discriminant near the last one; a search of the whole picture while none is high."""
        before = (self._center, self._scale)
        value = self._follow(frame, self._reach)
        seen, again = value >= self._config.seen_share * self._usual, False
        if not seen:
            self._center, self._scale = before
            if self._unseen >= self._config.patience:
                value = self._search(frame)
                seen = again = value >= self._config.found_share * self._usual
                if not seen:
                    self._center, self._scale = before
        if seen and value >= self._config.learn_share * self._usual:
            self._learn(frame)
            self._usual += _MEMORY * (value - self._usual)
        score = max(0.0, min(1.0, 0.5 * value / (self._config.seen_share * self._usual)))
        return Step(score if seen else min(score, 0.49), seen, again)

    def _follow(self, frame: np.ndarray, reach: int) -> float:
        """Move to the best box within a reach, px of the window, then to the best size; returns the discriminant."""
        window = Window(frame, self._center, self._size_px, (reach, reach))
        offsets, features = window.grid(_COARSE)
        best = offsets[self._machine.evaluate(features).argmax()]
        near = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1]), axis=2).reshape(-1, 2)
        near = np.clip(best + near, -reach, reach)
        best = near[self._machine.evaluate(window.features(near)).argmax()]
        self._center = self._center + best * self._size_px / SIDE
        self._hold_in_picture()
        steps = self._config.scale_step ** _SIZE_STEPS.astype(float)
        values = self._machine.evaluate(np.vstack([self._features(frame, step) for step in steps]))
        chosen = int(values.argmax())
        self._scale = self._bounded(self._scale * float(steps[chosen]) ** self._config.scale_damping)
        return float(values[chosen])

    def _search(self, frame: np.ndarray) -> float:
        """Look at a part of the picture, another each time, and then around the best box there."""
        scale = self._scale * _SEARCH_SCALES[self._part % len(_SEARCH_SCALES)]
        self._scale = self._bounded(scale)
        picture = np.array([frame.shape[1], frame.shape[0]], float)
        reach = np.maximum(0, (picture / self._size_px - 1) * SIDE / 2).astype(int)
        window = Window(frame, (picture - 1) / 2, self._size_px, (int(reach[0]), int(reach[1])))
        columns, rows = (np.arange(-r, r + 1, _SEARCH_STEP) for r in reach)
        offsets = np.stack(np.meshgrid(columns, rows), axis=2).reshape(-1, 2)
        parts = -(-len(offsets) // _SEARCHED)
        offsets = offsets[(self._part // len(_SEARCH_SCALES)) % parts :: parts]
        self._part += 1
        best = offsets[self._machine.evaluate(window.features(offsets)).argmax()]
        self._center = (picture - 1) / 2 + best * self._size_px / SIDE
        return self._follow(frame, 4 * _COARSE)

    def _learn(self, frame: np.ndarray) -> None:
        largest = int(_RINGS.max())
        window = Window(frame, self._center, self._size_px, (largest, largest))
        sizes = [self._features(frame, size) for size in _SIZES_LEARNED]
        features = np.vstack([window.features(self._learned), *sizes])
        self._machine.learn(features, self._losses, self._config.reprocessed, self._config.optimised)

    def _features(self, frame: np.ndarray, grown: float = 1.0) -> np.ndarray:
        """Features (1, SIZE) of the box where it is, at another size."""
        return Window(frame, self._center, self._size_px * grown, (0, 0)).features(np.zeros((1, 2), int))


def _losses_of(offsets: np.ndarray) -> np.ndarray:
    """One minus the overlap (n,) of boxes at offsets (n, 2) with the one at 0, 0, px of the window."""
    shared = np.maximum(0, SIDE - np.abs(offsets)).prod(axis=1)
    return 1.0 - shared / (2 * SIDE**2 - shared)
