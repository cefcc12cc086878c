"""OpenCV's own trackers of an upright box, behind our interface."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar, Protocol

import cv2
import numpy as np

from common.tracking.base import Box, Expectation, TrackResult, check_box, check_frame


class Engine(Protocol):
    """What each of OpenCV's trackers has."""

    def init(self, image: np.ndarray, boundingBox: tuple[int, int, int, int]) -> None:
        """Learn the target."""

    def update(self, image: np.ndarray) -> tuple[bool, tuple[int, ...]]:
        """Whether it is there, and its box."""
        ...


class OpenCvTracker(ABC):
    """One of them. See `common.tracking.base.Tracker`.

    Args:
        rng: gives OpenCV's generator its seed.
    """

    name: ClassVar[str]

    def __init__(self, rng: np.random.Generator):
        self._seed = int(rng.integers(2**31 - 1))
        self._result: TrackResult | None = None
        self._shape: tuple[int, ...] = ()

    @abstractmethod
    def _begin(self) -> Engine:
        """A new one, for a new target."""

    @abstractmethod
    def _score(self, found: bool) -> float:
        """How sure it is of its last answer, 0 to 1; 0.5 is the limit."""

    def init(self, frame: np.ndarray, box: Box, angle_rad: float = 0.0, t_ns: int | None = None) -> None:
        """Learn the target; a rotation of the box is not followed."""
        check_frame(frame)
        check_box(frame, box, angle_rad)
        cv2.setRNGSeed(self._seed)
        self._engine = self._begin()
        rows, columns = frame.shape[:2]
        # What they look at around a box that reaches beyond the picture would be outside it.
        x, y = min(max(round(box[0]), 0), columns - 1), min(max(round(box[1]), 0), rows - 1)
        width, height = min(round(box[2]), columns - x), min(round(box[3]), rows - y)
        self._engine.init(frame, (x, y, width, height))
        self._shape = frame.shape
        self._result = _result((x, y, width, height), 1.0)

    def expect(self, expectation: Expectation) -> None:  # noqa: B027  nothing to override
        """They have no motion model."""

    def update(self, frame: np.ndarray, t_ns: int) -> TrackResult:
        """The most likely place near the last one."""
        if self._result is None:
            raise ValueError(f"{self.name}: update before init; select a target first")
        check_frame(frame, self._shape)
        found, box = self._engine.update(frame)
        if not found:
            x, y, width, height = (*self._result.center_px, *self._result.size_px)
            box = (x - width / 2, y - height / 2, width, height)
        self._result = _result(tuple(box), self._score(found))
        return self._result


def _result(box: tuple[float, ...], score: float) -> TrackResult:
    x, y, width, height = map(float, box)
    state = "tracking" if score >= 0.5 else "lost"
    return TrackResult((x + width / 2, y + height / 2), (width, height), 0.0, score, 0.5, state, 0.0)
