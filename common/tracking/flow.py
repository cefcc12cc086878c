"""Sparse optical flow with the forward-backward check of Kalal et al. 2010 (DOI 10.1109/ICPR.2010.675)."""

from __future__ import annotations

import cv2
import numpy as np

_WINDOW_PX = 15
_LEVELS = 3
_FROM_GUESS = cv2.OPTFLOW_USE_INITIAL_FLOW
_REACH_PX = 128
"""How far around the points, and around where they are expected, the pictures are looked at: more than the flow can
tell, since a pyramid of the whole picture costs more than the flow of a hundred points."""
_GRID_PX = 2**_LEVELS
"""Pixels for one of the coarsest level: parts that begin on a multiple of it have the same levels as the whole."""
_STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.03)


def follow_points(
    before: np.ndarray, after: np.ndarray, points: np.ndarray, expected_px: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Where points of one picture are in the next, and how far each comes back from where it was, px.

    Args:
        before: (H, W) uint8.
        after: (H, W) uint8.
        points: (n, 2) float, x, y.
        expected_px: displacement (2,) that is expected of all of them; none without it.

    Returns:
        Places (n, 2) float32, and the forward-backward errors (n,) float32: infinite where the flow lost the point.
    """
    if not len(points):
        return np.zeros((0, 2), np.float32), np.zeros(0, np.float32)
    corner, before, after = _parts(before, after, points, expected_px)
    start = np.ascontiguousarray(points - corner, np.float32).reshape(-1, 1, 2)
    options = {"winSize": (_WINDOW_PX, _WINDOW_PX), "maxLevel": _LEVELS, "criteria": _STOP}
    guess, flags = (None, 0) if expected_px is None else ((start + expected_px).astype(np.float32), _FROM_GUESS)
    there, seen, _ = cv2.calcOpticalFlowPyrLK(before, after, start, guess, flags=flags, **options)  # pyright: ignore[reportCallIssue, reportArgumentType]
    guess = None if expected_px is None else (there - expected_px).astype(np.float32)
    back, seen_back, _ = cv2.calcOpticalFlowPyrLK(after, before, there, guess, flags=flags, **options)  # pyright: ignore[reportCallIssue, reportArgumentType]
    error = np.linalg.norm((back - start)[:, 0], axis=1).astype(np.float32)
    rows, columns = after.shape
    inside = ((there[:, 0] >= 0) & (there[:, 0] < (columns, rows))).all(axis=1)
    error[(seen.ravel() == 0) | (seen_back.ravel() == 0) | ~inside] = np.inf
    return there[:, 0] + corner, error


def _parts(
    before: np.ndarray, after: np.ndarray, points: np.ndarray, expected_px: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Corner (2,) float32, x, y, of the part of both pictures in which points (n, 2) can be followed, and the parts."""
    last = np.array([before.shape[1] - 1.0, before.shape[0] - 1.0])
    low, high = points.min(axis=0), points.max(axis=0)
    if expected_px is not None:
        low, high = np.minimum(low, low + expected_px), np.maximum(high, high + expected_px)
    x0, y0 = (np.clip(low - _REACH_PX, 0.0, last) // _GRID_PX * _GRID_PX).astype(int).tolist()
    x1, y1 = (np.clip(high + _REACH_PX, 0.0, last) + 1.0).astype(int).tolist()
    return np.array([x0, y0], np.float32), before[y0:y1, x0:x1], after[y0:y1, x0:x1]
