"""Bins of the colour space: 8 x 8 x 8 in RGB, placed where the target's colours are safe, with the light undone.

Two things are added to the fixed bins of Teulière 2011, both because a painted surface is one narrow peak of colour:
- With fixed bounds a peak that happens to lie on one flips between two bins with every change of light or noise, and
  the distance to the reference jumps from 0.2 to 0.6. So the bounds of each channel are shifted, once, at the start,
  to where the target is told from its surroundings best and changes least under a small change of light.
- Values are multiplied by a gain for each channel before they are binned (`common.tracking.light` moves them): the
  adaptation to illumination that the paper names as future work. Three numbers cannot learn the background, as an
  adapting reference histogram does.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import cv2
import numpy as np

BINS_PER_CHANNEL = 8
BINS = BINS_PER_CHANNEL**3
"""Bins of the colour space (Teulière 2011, section IV)."""
BIN_WIDTH = 256 // BINS_PER_CHANNEL
"""Width of a bin in each channel, grey levels."""
_VALUES = np.arange(256) / BIN_WIDTH
_PLACE_VALUES = np.array([[BINS_PER_CHANNEL**2], [BINS_PER_CHANNEL], [1]], np.uint16)
_OFFSET_STEP = 8
_LIGHT_CHANGE = 0.04
"""Change of light that a good placement survives: 8 grey levels of 200, twice the noise of a small camera."""


@dataclass(frozen=True)
class ColourBins:
    """The map from colour to bin, b(l) in Teulière 2011, eq. 1."""

    offsets: tuple[int, int, int] = (0, 0, 0)
    """Shift of the bounds of each channel (B, G, R) towards dark, grey levels, 0 to 31."""

    def table(self, gain: float | np.ndarray = 1.0) -> np.ndarray:
        """What each value of each channel adds to a bin's number.

        Args:
            gain: factor on the values before they are binned; one, or (..., 3) for B, G, R.

        Returns:
            (3, 256) uint16, or (..., 3, 256) for several gains at once.
        """
        gains = np.asarray(gain, float)
        gains = np.broadcast_to(gains, (3,)) if gains.ndim == 0 else gains
        # What the gain lifts above 255 lies in the last bin whatever the offset.
        bins = _VALUES * gains[..., None]
        bins += np.array(self.offsets)[:, None] / BIN_WIDTH
        return np.minimum(bins, BINS_PER_CHANNEL - 1, out=bins).astype(np.uint16) * _PLACE_VALUES

    def of(self, pixels: np.ndarray, gain: float | np.ndarray = 1.0) -> np.ndarray:
        """Bin of each pixel.

        Args:
            pixels: (H, W, 3) uint8 BGR, H and W at least 1.
            gain: factor on the values before they are binned; one, or (3,) for B, G, R.

        Returns:
            (H, W) uint16, 0 to 511.
        """
        return binned(pixels, self.table(gain))

    def histogram(
        self, pixels: np.ndarray, weights: np.ndarray | None = None, gain: float | np.ndarray = 1.0
    ) -> np.ndarray:
        """Normalised histogram (512,) of pixels (N, 3), with weights (N,) or all alike."""
        counts = np.bincount(self.of(pixels[None], gain)[0], weights, BINS).astype(float)
        return counts / counts.sum()


def binned(pixels: np.ndarray, table: np.ndarray) -> np.ndarray:
    """Bin (H, W) uint16 of each pixel (H, W, 3) under a table (3, 256) of `ColourBins.table`."""
    parts = cv2.LUT(pixels, np.ascontiguousarray(table.T)[None])
    return parts[..., 0] + parts[..., 1] + parts[..., 2]


def bhattacharyya_coefficient(reference: np.ndarray, candidate: np.ndarray) -> np.ndarray:
    """Likeness of histograms along the last axis: 1 for equal ones, 0 for disjoint ones (Teulière 2011, eq. 2)."""
    return np.sqrt(reference * candidate).sum(axis=-1)


def bhattacharyya_distance(reference: np.ndarray, candidate: np.ndarray) -> np.ndarray:
    """Distance of histograms along the last axis, 0 to 1 (Teulière 2011, eq. 3)."""
    return np.sqrt(np.maximum(0.0, 1.0 - bhattacharyya_coefficient(reference, candidate)))


def place_bins(target: np.ndarray, weights: np.ndarray, surroundings: np.ndarray) -> ColourBins:
    """Bins under which the target differs most from its surroundings and least from itself in slightly other light.

    Args:
        target: (N, 3) uint8 BGR pixels of the target.
        weights: (N,) their kernel weights.
        surroundings: (M, 3) pixels around it; M may be 0, then only the light counts.
    """

    def merit(bins: ColourBins) -> float:
        here = bins.histogram(target, weights)
        relit = [bins.histogram(target, weights, gain) for gain in (1 - _LIGHT_CHANGE, 1 + _LIGHT_CHANGE)]
        fragility = float(np.mean([bhattacharyya_distance(here, other) for other in relit]))
        if len(surroundings) == 0:
            return -fragility
        return float(bhattacharyya_distance(here, bins.histogram(surroundings))) - fragility

    shifts = range(0, BIN_WIDTH, _OFFSET_STEP)
    return max((ColourBins(offsets) for offsets in itertools.product(shifts, shifts, shifts)), key=merit)
