"""Trackers that are networks, with the model files that the user gives them, in OpenCV's implementations."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import ClassVar

import cv2
import numpy as np

from common.config import ConfigError
from common.tracking.base import Box, TrackResult
from common.tracking.deep_config import NanoConfig, VitConfig
from common.tracking.opencv_tracker import OpenCvTracker

_DEVIATIONS = (0.229, 0.224, 0.225)
"""Of blue, green and red over all pictures, as shares of 255: what OpenCV's default says that a Vit learned with."""


class _DeepTracker(OpenCvTracker):
    """One that says how sure it is.

    Args:
        threshold: its own score below which the target counts as lost.
        rng: gives OpenCV's generator its seed.
    """

    _engine: cv2.TrackerNano | cv2.TrackerVit

    def __init__(self, threshold: float, rng: np.random.Generator):
        super().__init__(rng)
        self._threshold = threshold

    def init(self, frame: np.ndarray, box: Box, angle_rad: float = 0.0, t_ns: int | None = None) -> None:
        """Learn the target; a rotation of the box is not followed.

        Raises:
            ValueError: a bad picture or box, or networks of another kind.
        """
        with self._networks():
            super().init(frame, box, angle_rad, t_ns)

    def update(self, frame: np.ndarray, t_ns: int) -> TrackResult:
        """The most likely place near the last one."""
        with self._networks():
            return super().update(frame, t_ns)

    @contextmanager
    def _networks(self) -> Iterator[None]:
        try:
            yield
        except cv2.error as error:
            raise ValueError(f"{self.name}: its networks do not fit OpenCV's tracker: {error.err or error}") from None

    def _score(self, found: bool) -> float:
        own = max(self._engine.getTrackingScore(), 0.0)
        score = own / (own + self._threshold)  # its threshold becomes 0.5
        return score if found else min(score, 0.49)


class NanoTracker(_DeepTracker):
    """NanoTrack: a Siamese network of two files (`[nano]`).

    Args:
        config: files and threshold.
        rng: gives OpenCV's generator its seed.

    Raises:
        ConfigError: a file is not named, missing, or no such network.
    """

    name: ClassVar[str] = "nano"
    config_type = NanoConfig

    def __init__(self, config: NanoConfig, rng: np.random.Generator):
        super().__init__(config.threshold, rng)
        self._parameters = cv2.TrackerNano.Params()
        self._parameters.backbone = _file("nano.backbone", config.backbone)
        self._parameters.neckhead = _file("nano.neckhead", config.neckhead)
        _read("nano.backbone and nano.neckhead", self._begin)

    def _begin(self) -> cv2.TrackerNano:
        return cv2.TrackerNano.create(self._parameters)


class VitTracker(_DeepTracker):
    """A vision transformer of one file (`[vit]`).

    Args:
        config: file and threshold.
        rng: gives OpenCV's generator its seed.

    Raises:
        ConfigError: the file is not named, missing, or no such network.
    """

    name: ClassVar[str] = "vit"
    config_type = VitConfig

    def __init__(self, config: VitConfig, rng: np.random.Generator):
        super().__init__(config.threshold, rng)
        self._parameters = cv2.TrackerVit.Params()
        self._parameters.net = _file("vit.model", config.model)
        self._parameters.tracking_score_threshold = config.threshold
        self._parameters.stdvalue = _as_divisor(_DEVIATIONS)
        _read("vit.model", self._begin)

    def _begin(self) -> cv2.TrackerVit:
        return cv2.TrackerVit.create(self._parameters)


def _as_divisor(deviations: tuple[float, float, float]) -> tuple[float, float, float]:
    """Three numbers of which OpenCV's tracker makes the inverses of these.

    It computes one over a `Scalar`, which OpenCV defines as for quaternions: the conjugate over the squared length.
    With the deviations themselves, green and red would be given to the network negative, and all at a third.
    """
    blue, green, red = (1.0 / deviation for deviation in deviations)
    length = blue**2 + green**2 + red**2
    return blue / length, -green / length, -red / length


def _file(key: str, name: str) -> str:
    if not name:
        raise ConfigError(f"{key}: got nothing, expected the path of an ONNX file; this tracker comes without one")
    if not Path(name).is_file():
        raise ConfigError(f"{key}: {name!r} does not exist, expected the path of an ONNX file")
    return name


def _read(keys: str, begin: Callable[[], object]) -> None:
    try:
        begin()
    except cv2.error as error:
        raise ConfigError(f"{keys}: OpenCV cannot read it as ONNX: {error.err or error}") from None
