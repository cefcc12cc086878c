"""Features of any box near the target: oriented gradients and tones of 8 x 8 cells, of unit length.

All boxes of one size share one window, seen at 32 x 32 px a target: maps of each channel are smoothed over a cell once,
and a box's features are the maps read at its 64 cells.
"""

from __future__ import annotations

import cv2
import numpy as np

from common.tracking.struck_compiled import read_features, vote

SIDE = 32
"""Side of the target in the window, px."""
_CELL = 4
_CELLS = SIDE // _CELL
_ORIENTATIONS = 6
_TONES = 3
_CHANNELS = _ORIENTATIONS + _TONES
SIZE = _CHANNELS * _CELLS**2
"""Numbers of a feature vector."""
_LEAST_ENERGY = 6.0
"""Gradient of the surroundings, grey levels a px, below which they count as plain."""
_TONE_WEIGHT = 0.6
"""Length of the tones' part against that of the gradients."""
_LEAST_TONE = 0.05


class Window:
    """A part of a picture in which boxes of one size are compared.

    Args:
        frame: picture, (H, W, 3) uint8 BGR.
        center: of the box with offset 0, 0, (column, row), px.
        size: of each box, (width, height), px.
        reach: largest offset along each axis, (columns, rows), px of the window.
    """

    def __init__(self, frame: np.ndarray, center: np.ndarray, size: np.ndarray, reach: tuple[int, int]):
        self._reach = reach
        width, height = SIDE + 2 * reach[0], SIDE + 2 * reach[1]
        step = size / SIDE
        if step.max() > 2.0:  # one pixel of the window is several of the picture
            frame, center, step = _shrunk(frame, center, step, (width, height))
        matrix = np.array([[step[0], 0.0, 0.0], [0.0, step[1], 0.0]])
        matrix[:, 2] = center - step * (np.array([width, height]) - 1) / 2
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        picture = cv2.warpAffine(frame, matrix, (width, height), flags=flags, borderMode=cv2.BORDER_REPLICATE)
        self._maps = _maps(picture)

    def features(self, offsets: np.ndarray) -> np.ndarray:
        """Features (n, SIZE) float32 of boxes at offsets (n, 2) int (columns, rows), px of the window."""
        corners = np.ascontiguousarray(offsets + np.array(self._reach), np.uint32)
        features = np.empty((len(offsets), SIZE), np.float32)
        read_features(self._maps, corners, _CELLS, _CELL, _ORIENTATIONS, _TONE_WEIGHT, _LEAST_TONE, features)
        return features

    def grid(self, step: int) -> tuple[np.ndarray, np.ndarray]:
        """Offsets (n, 2) of a grid over the whole window, and the features (n, SIZE) there."""
        columns, rows = (np.arange(-(r // step) * step, r + 1, step) for r in self._reach)
        offsets = np.stack(np.meshgrid(columns, rows), axis=2).reshape(-1, 2)
        return offsets, self.features(offsets)


def _shrunk(
    frame: np.ndarray, center: np.ndarray, step: np.ndarray, window: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The part of the picture that the window shows, averaged down to about its pixels; centre and step in it."""
    half = step * np.array(window) / 2 + 2 * step
    low = np.maximum(0, np.floor(center - half)).astype(int)
    high = np.minimum([frame.shape[1], frame.shape[0]], np.ceil(center + half).astype(int))
    if (high - low < 8).any():
        return frame, center, step
    part = frame[low[1] : high[1], low[0] : high[0]]
    side = np.maximum(1, np.round((high - low) / np.maximum(step, 1.0))).astype(int)
    factor = (high - low) / side
    small = cv2.resize(part, (int(side[0]), int(side[1])), interpolation=cv2.INTER_AREA)
    return small, (center - low + 0.5) / factor - 0.5, step / factor


def _maps(picture: np.ndarray) -> np.ndarray:
    """Channels (H, W, C) float32 of a window (H, W, 3): the mean over the cell whose first pixel is this one."""
    colours = picture.astype(np.float32)
    grey = colours @ np.array([0.114, 0.587, 0.299], np.float32)
    across = cv2.Sobel(grey, cv2.CV_32F, 1, 0, ksize=1)
    down = cv2.Sobel(grey, cv2.CV_32F, 0, 1, ksize=1)
    length, angle = cv2.cartToPolar(across, down)
    maps = np.empty((*grey.shape, _CHANNELS), np.float32)
    strength = length / (cv2.blur(length, (SIDE // 2 + 1,) * 2) + np.float32(_LEAST_ENERGY))
    vote(strength, angle, maps, _ORIENTATIONS)
    maps[..., _ORIENTATIONS] = grey / 255
    maps[..., _ORIENTATIONS + 1] = (colours[..., 2] - colours[..., 1]) / 255
    maps[..., _ORIENTATIONS + 2] = (colours[..., 0] - colours[..., 1]) / 255
    kernel = (_CELL, _CELL)
    return cv2.boxFilter(maps, -1, kernel, anchor=(0, 0), normalize=True, borderType=cv2.BORDER_REPLICATE)
