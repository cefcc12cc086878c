"""OpenCV's multiple-instance learning tracker (Babenko et al. 2009), behind our interface."""

from __future__ import annotations

import cv2
import numpy as np

from common.tracking.base import Box, Expectation, TrackResult, check_box, check_frame
from common.tracking.mil_config import MilConfig


class MilTracker:
    """Boosted classifier over Haar features; fixed size, no failure measure. See `common.tracking.base.Tracker`.

    It never says that it has lost the target, so its score says nothing either: fusion has to judge it.

    Args:
        config: its parameters.
        rng: gives OpenCV's generator its seed.
    """

    config_type = MilConfig

    def __init__(self, config: MilConfig, rng: np.random.Generator):
        self._parameters = cv2.TrackerMIL.Params()
        self._parameters.samplerSearchWinSize = config.search_radius_px
        self._parameters.featureSetNumFeatures = config.features
        self._seed = int(rng.integers(2**31 - 1))
        self._result: TrackResult | None = None
        self._shape: tuple[int, ...] = ()

    def init(self, frame: np.ndarray, box: Box, angle_rad: float = 0.0, t_ns: int | None = None) -> None:
        """Learn the target; a rotation of the box is not followed."""
        check_frame(frame)
        check_box(frame, box, angle_rad)
        cv2.setRNGSeed(self._seed)
        self._tracker = cv2.TrackerMIL.create(self._parameters)
        rows, columns = frame.shape[:2]
        # Its samples around a box that reaches beyond the picture would be outside it.
        x, y = min(max(round(box[0]), 0), columns - 1), min(max(round(box[1]), 0), rows - 1)
        width, height = min(round(box[2]), columns - x), min(round(box[3]), rows - y)
        self._tracker.init(frame, (x, y, width, height))
        self._shape = frame.shape
        self._result = _result((x, y, width, height), "tracking")

    def expect(self, expectation: Expectation) -> None:
        """It has no motion model."""

    def update(self, frame: np.ndarray, t_ns: int) -> TrackResult:
        """The most likely place near the last one."""
        if self._result is None:
            raise ValueError("mil: update before init; select a target first")
        check_frame(frame, self._shape)
        found, box = self._tracker.update(frame)
        if found:
            self._result = _result(tuple(box), "tracking")
        else:
            x, y, width, height = (*self._result.center_px, *self._result.size_px)
            self._result = _result((x - width / 2, y - height / 2, width, height), "lost")
        return self._result


def _result(box: tuple[float, ...], state: str) -> TrackResult:
    x, y, width, height = map(float, box)
    seen = state == "tracking"
    return TrackResult(
        (x + width / 2, y + height / 2), (width, height), 0.0, float(seen), 0.5, "tracking" if seen else "lost", 0.0
    )
