"""OpenCV's multiple-instance learning tracker (Babenko et al. 2009), behind our interface."""

from __future__ import annotations

from typing import ClassVar

import cv2
import numpy as np

from common.tracking.mil_config import MilConfig
from common.tracking.opencv_tracker import OpenCvTracker


class MilTracker(OpenCvTracker):
    """Boosted classifier over Haar features; fixed size, no failure measure.

    It never says that it has lost the target, so its score says nothing either: fusion has to judge it.

    Args:
        config: its parameters.
        rng: gives OpenCV's generator its seed.
    """

    name: ClassVar[str] = "mil"
    config_type = MilConfig

    def __init__(self, config: MilConfig, rng: np.random.Generator):
        super().__init__(rng)
        self._parameters = cv2.TrackerMIL.Params()
        self._parameters.samplerSearchWinSize = config.search_radius_px
        self._parameters.featureSetNumFeatures = config.features

    def _begin(self) -> cv2.TrackerMIL:
        return cv2.TrackerMIL.create(self._parameters)

    def _score(self, found: bool) -> float:
        return float(found)
