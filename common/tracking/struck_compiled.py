"""Compiled loops over the pixels and cells of Struck's windows: votes of gradients, and features of unit length."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


# The signatures compile when the module is imported (and are kept on disk), not when the first target is selected.
@njit("void(f4[:,::1],f4[:,::1],f4[:,:,::1],i8)", cache=True, nogil=True)
def vote(strength, angle, maps, orientations):  # type: ignore[no-untyped-def]
    """Share each pixel's gradient between the two nearest orientations, opposite ones being the same.

    Args:
        strength: (H, W) float32.
        angle: of the gradient, (H, W) float32, rad, 0 to 2π.
        maps: (H, W, C) float32, whose first channels are written.
        orientations: how many.
    """
    for i in range(strength.shape[0]):
        for j in range(strength.shape[1]):
            place = angle[i, j] * orientations / math.pi
            if place >= orientations:
                place -= orientations
            low = min(int(place), orientations - 1)
            share = place - low
            for channel in range(orientations):
                maps[i, j, channel] = 0.0
            maps[i, j, low] = (1.0 - share) * strength[i, j]
            maps[i, j, (low + 1) % orientations] = share * strength[i, j]


# Indices have no sign: whether one counts from the end would be asked of each, which takes half as long again.
@njit("void(f4[:,:,::1],u4[:,::1],u8,u8,u8,f8,f8,f4[:,::1])", cache=True, nogil=True, error_model="numpy")
def read_features(maps, corners, cells, cell_px, orientations, tone_weight, least_tone, out):  # type: ignore[no-untyped-def]
    """Features of boxes from maps of channels: square roots of gradients, then tones about their mean, of length one.

    Args:
        maps: (H, W, C) float32: gradients, grey, two differences of colours; each is the mean over a cell of which this
            is the first pixel.
        corners: (n, 2) uint32, column and row of each box's first pixel.
        cells: along each side of a box.
        cell_px: side of a cell, px.
        orientations: channels of gradients.
        tone_weight: length of the tones' part against that of the gradients.
        least_tone: contrast of the tones below which they count less.
        out: (n, cells² C) float32, written: the gradients of all cells, then the tones of all cells.
    """
    tones = np.uint64(maps.shape[2]) - orientations
    first_tone = cells * cells * orientations
    for i in range(corners.shape[0]):
        grey, energy = 0.0, 0.0
        for row in range(cells):
            y = corners[i, 1] + row * cell_px
            for column in range(cells):
                x = corners[i, 0] + column * cell_px
                at = row * cells + column
                for channel in range(orientations):
                    value = max(maps[y, x, channel], np.float32(0.0))  # sums that run on may be a little below
                    energy += value
                    out[i, at * orientations + channel] = math.sqrt(value)
                for channel in range(tones):
                    out[i, first_tone + at * tones + channel] = maps[y, x, orientations + channel]
                grey += maps[y, x, orientations]
        grey /= cells * cells
        contrast = 0.0
        for cell in range(cells * cells):  # the light changes how bright a target is, and hardly its colour
            out[i, first_tone + cell * tones] -= grey
            for channel in range(tones):
                contrast += out[i, first_tone + cell * tones + channel] ** 2
        gradient, tone = 1.0 / (math.sqrt(energy) + 1e-6), tone_weight / (math.sqrt(contrast) + least_tone)
        length = math.sqrt(energy * gradient * gradient + contrast * tone * tone)
        gradient, tone = gradient / length, tone / length
        for k in range(first_tone):
            out[i, k] *= gradient
        for k in range(first_tone, out.shape[1]):
            out[i, k] *= tone
