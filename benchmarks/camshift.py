"""OpenCV's CamShift as a tracker: the well-known simple method that ours is compared with."""

from __future__ import annotations

import math

import cv2
import numpy as np

from common.tracking.base import Box, Expectation, TrackResult, check_box, check_frame

_BINS = (32, 16)
_LEAST_SATURATION, _LEAST_VALUE = 40.0, 30.0
_STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 10, 1.0)
_LEAST_SCORE = 0.15


class CamShiftTracker:
    """Back-projection of a hue and saturation histogram, and the adaptive window on it (G. Bradski, 1998)."""

    def __init__(self) -> None:
        self._histogram: np.ndarray | None = None
        self._window = (0, 0, 1, 1)
        self._size_px = (1.0, 1.0)
        self._angle_rad = 0.0
        self._shape: tuple[int, ...] = ()

    def init(self, frame: np.ndarray, box: Box, angle_rad: float = 0.0, t_ns: int | None = None) -> None:
        """Learn the colours in the box."""
        check_frame(frame)
        check_box(frame, box, angle_rad)
        inside = np.zeros(frame.shape[:2], np.uint8)
        center = (box[0] + box[2] / 2, box[1] + box[3] / 2)
        corners = cv2.boxPoints((center, (box[2], box[3]), math.degrees(angle_rad)))
        cv2.fillConvexPoly(inside, corners.round().astype(np.int32), 255)
        hsv = cv2.cvtColor(frame, cv2.COLOR_BGR2HSV)
        histogram = cv2.calcHist([hsv], [0, 1], cv2.bitwise_and(inside, _colourful(hsv)), list(_BINS), [0, 180, 0, 256])
        cv2.normalize(histogram, histogram, 0, 255, cv2.NORM_MINMAX)
        x, y, width, height = cv2.boundingRect(corners)
        self._histogram, self._window = histogram, (x, y, width, height)
        self._size_px, self._angle_rad, self._shape = (box[2], box[3]), angle_rad, frame.shape

    def expect(self, expectation: Expectation) -> None:
        """The plain method has no motion model."""

    def update(self, frame: np.ndarray, t_ns: int) -> TrackResult:
        """Shift the window once."""
        if self._histogram is None:
            raise ValueError("CamShift: update before init")
        check_frame(frame, self._shape)
        hsv = cv2.cvtColor(frame, cv2.COLOR_BGR2HSV)
        projected = cv2.calcBackProject([hsv], [0, 1], self._histogram, [0, 180, 0, 256], 1)
        likely = cv2.bitwise_and(projected, _colourful(hsv))
        (center, size, degrees), window = cv2.CamShift(likely, self._window, _STOP)
        x, y, width, height = window
        seen = width > 0 and height > 0
        score = float(likely[y : y + height, x : x + width].mean()) / 255 if seen else 0.0
        if seen and min(size) > 0:
            self._window, self._size_px = window, (float(size[0]), float(size[1]))
            self._angle_rad = _nearest(math.radians(degrees), self._angle_rad)
        else:
            x, y, width, height = self._window
            center = (x + width / 2, y + height / 2)
        state = "tracking" if score >= _LEAST_SCORE else "lost"
        place = (float(center[0]), float(center[1]))
        return TrackResult(place, self._size_px, self._angle_rad, score, _LEAST_SCORE, state, angle_std_rad=0.0)


def _colourful(hsv: np.ndarray) -> np.ndarray:
    """Mask of the pixels whose hue means something."""
    return cv2.inRange(hsv, (0, _LEAST_SATURATION, _LEAST_VALUE), (180, 255, 255))


def _nearest(angle_rad: float, to_rad: float) -> float:
    """The same axis, turned by quarters to the direction nearest to the one before: the ellipse has no front."""
    return to_rad + math.remainder(angle_rad - to_rad, math.pi / 2)
