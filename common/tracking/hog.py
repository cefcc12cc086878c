"""Histograms of oriented gradients for correlation filters: like those of Felzenszwalb 2010."""

from __future__ import annotations

import math

import cv2
import numpy as np

from common.tracking.hog_compiled import normalise, vote

CELL_PX = 4
"""Side of a cell, px."""
_SIGNED = 18
_UNSIGNED = 9
_LARGEST = 0.4
"""Bound of a normalised entry, so that one strong edge does not speak for all."""
_LEAST_ENERGY = 4.0
"""Gradient of a cell, grey levels, below which it counts as plain."""
CHANNELS = _SIGNED + _UNSIGNED
"""Entries of a cell."""


def gradients_of_cells(patches: np.ndarray) -> np.ndarray:
    """Normalised histograms of the cells of grey pictures.

    Each pixel votes with its gradient's length for the two nearest of 18 directions; opposite ones are added to nine
    more. A cell's entries are over the root mean energy of its neighbourhood of 3 x 3 cells, and bounded.

    Args:
        patches: (n, H, W) float32, grey levels; H and W are multiples of `CELL_PX`.

    Returns:
        (n, H / 4, W / 4, 27) float32.
    """
    count, height, width = patches.shape
    rows, columns = height // CELL_PX, width // CELL_PX
    across, down = np.zeros_like(patches), np.zeros_like(patches)
    np.subtract(patches[:, :, 2:], patches[:, :, :-2], out=across[:, :, 1:-1])
    np.subtract(patches[:, 2:], patches[:, :-2], out=down[:, 1:-1])
    length, angle = cv2.cartToPolar(across.reshape(-1, width), down.reshape(-1, width))
    angle *= np.float32(_SIGNED / (2 * math.pi))
    cells = np.zeros((count, rows, columns, CHANNELS), np.float32)
    vote(length.reshape(patches.shape), angle.reshape(patches.shape), cells, _SIGNED, CELL_PX, 1.0 / CELL_PX**2)
    normalise(cells, np.empty((count, rows, columns), np.float32), _UNSIGNED, _LEAST_ENERGY, _LARGEST)
    return cells
