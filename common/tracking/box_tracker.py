"""What trackers of a box that keeps its shape share: centre, size, pictures in their order, and what counts as lost."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import replace
from typing import ClassVar, NamedTuple, Protocol

import numpy as np

from common.tracking.base import Box, Expectation, TrackResult, TrackState, center_of, check_box, check_frame

_LEAST_SIDE_PX = 6.0


class BoxConfig(Protocol):
    """What the configuration of each of them has."""

    @property
    def lost_after_s(self) -> float:
        """From when on a target out of sight is lost, s."""
        ...

    @property
    def max_scale(self) -> float:
        """Largest size, and inverse of the smallest, over the first one."""
        ...


class Step(NamedTuple):
    """What one picture gave."""

    score: float
    """0 to 1; 0.5 is the limit."""
    seen: bool
    """Whether the target is where the tracker has gone; where it is not, the tracker has not moved."""
    again: bool = False
    """Whether a search of the picture found it."""


class BoxTracker(ABC):
    """A tracker of one box. See `common.tracking.base.Tracker` and `Placeable`.

    Args:
        config: its parameters.
    """

    name: ClassVar[str]

    def __init__(self, config: BoxConfig):
        self._limits = config
        self._result: TrackResult | None = None

    @abstractmethod
    def _step(self, frame: np.ndarray) -> Step:
        """Follow the target into a picture, or search it; learn what is to be learned."""

    def expect(self, expectation: Expectation) -> None:
        """Start the search of the next picture where the target is expected, or, out of sight, as far from before."""
        if self._result is not None:
            self._expected_px = np.array(expectation.moved_px, float)

    def place(self, frame: np.ndarray, box: Box) -> None:
        """Go on from a box that somebody else found, without learning anything from it.

        Raises:
            ValueError: not started, or a bad box.
        """
        self._started("place")
        check_box(frame, box, 0.0)
        self._center = np.array(center_of(box))
        self._scale = self._bounded(math.sqrt(box[2] * box[3] / float(self._base.prod())))
        self._unseen = 0

    def update(self, frame: np.ndarray, t_ns: int) -> TrackResult:
        """Where the target is in the next picture. See `common.tracking.base.Tracker`."""
        self._started("update")
        check_frame(frame, self._shape)
        if self._t_ns is not None and t_ns < self._t_ns:
            raise ValueError(f"t_ns: got {t_ns}, expected at least the previous picture's {self._t_ns}")
        elapsed_ns = 0 if self._t_ns is None else t_ns - self._t_ns
        self._t_ns = t_ns
        self._number += 1
        if self._expected_px is not None:
            self._center = self._center + self._expected_px
            self._hold_in_picture()
        score, seen, again = self._step(frame)
        self._expected_px = None
        if seen:
            self._unseen, self._unseen_ns = 0, 0
        else:
            self._unseen += 1
            self._unseen_ns += elapsed_ns
        gone = self._unseen_ns > self._limits.lost_after_s * 1e9
        state: TrackState = "tracking" if seen else "lost" if gone else "predicted"
        self._result = replace(self._report(score, state), reinitialised=again)
        return self._result

    def _begin(self, frame: np.ndarray, box: Box, angle_rad: float, t_ns: int | None) -> None:
        """Check a first picture and its box, and stand on it."""
        check_frame(frame)
        check_box(frame, box, angle_rad)
        self._shape, self._t_ns = frame.shape, t_ns
        self._base = np.array(box[2:], float)
        self._center = np.array(center_of(box))
        self._scale, self._angle = 1.0, 0.0
        self._unseen, self._unseen_ns, self._number = 0, 0, 0
        self._expected_px: np.ndarray | None = None

    def _started(self, what: str) -> None:
        if self._result is None:
            raise ValueError(f"{self.name}: {what} before init; select a target first")

    @property
    def _size_px(self) -> np.ndarray:
        """Width and height of the box, px."""
        return self._base * self._scale

    def _bounded(self, scale: float) -> float:
        """The nearest size that is allowed."""
        smallest, limit = _LEAST_SIDE_PX / float(self._base.min()), self._limits.max_scale
        return min(max(scale, 1.0 / limit, smallest), limit)

    def _hold_in_picture(self) -> None:
        self._center = np.clip(self._center, 0.0, [self._shape[1] - 1.0, self._shape[0] - 1.0])

    def _report(self, score: float, state: TrackState) -> TrackResult:
        center = (float(self._center[0]), float(self._center[1]))
        size = (float(self._size_px[0]), float(self._size_px[1]))
        return TrackResult(center, size, math.remainder(self._angle, math.tau), score, 0.5, state, 0.0)
