"""How a target lies by its own straight lines: its outline, windows, painted edges.

Colour histograms fix an angle weakly: one degree moves hardly any of a kernel's weight, and a target that was first
seen from the side, then from above, fits best a degree or more away from where it lies. The lines of a made thing run
along its length and across it wherever it is seen from, and half of its pixels vote, in a checkerboard.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numba import njit

from common.tracking.histogram import PSI, SCALE, X, Y

_LONGEST_PX = 160
"""Longer side of the upright patch in which the lines are read; a larger target is shrunk to it."""
_BLUR = 1.0
"""Standard deviation of the blur before it, px: against the staircase of a resampled edge, and noise."""
_LEAST_COHERENT = 0.5
"""Least coherence of a target whose lines count: a car from above has 0.8, a person 0.1 to 0.4, grass 0.05 to 0.1."""
_AS_COHERENT = 0.75
"""Least share of the first coherence in a later picture: half of an occluder, a broken block, a shadow take more."""


_ROUNDS, _NEAR_COSINE = 2, math.cos(4.0 * math.radians(9.0))
"""The direction of all edges is refined so often by those within 9 degrees of it alone: a windscreen's pillars, say,
lean to both sides, but may show more against the paint of one."""


class OwnLines:
    """The lines of one target, as long as they run along the rectangle that it was chosen by.

    Args:
        frame: picture in which it was chosen, (H, W, 3) uint8.
        state: its state there, (4,).
        aspect: r = h / w.
        reach_rad: how far its lines may lie from the rectangle's sides, there and later, rad; 0 leaves them unread.
    """

    def __init__(self, frame: np.ndarray, state: np.ndarray, aspect: float, reach_rad: float):
        self._aspect, self._reach_rad = aspect, reach_rad
        self._coherence = 0.0
        if reach_rad > 0.0:
            turn, coherence = lines_turn(frame, state, aspect)
            if abs(turn) <= reach_rad and coherence >= _LEAST_COHERENT:
                self._coherence = coherence

    @property
    def usable(self) -> bool:
        """Whether the target has such lines."""
        return self._coherence > 0.0

    def turn(self, frame: np.ndarray, state: np.ndarray) -> float | None:
        """How far a state (4,) has to be turned to lie along the target's lines, rad; None where these are in doubt."""
        if not self.usable:
            return None
        turn, coherence = lines_turn(frame, state, self._aspect)
        return turn if abs(turn) <= self._reach_rad and coherence >= _AS_COHERENT * self._coherence else None


def lines_turn(frame: np.ndarray, state: np.ndarray, aspect: float) -> tuple[float, float]:
    """How far the lines in a state's rectangle lie from its sides, and how coherent they are.

    The gradient's direction is taken four times, so that all sides of a rectangle point the same way (the double angle
    of Granlund 1978, DOI 10.1016/0146-664X(78)90047-3, once more), and summed over the pixels, weighted by its square;
    then again over those alone that lie near the sum.

    Args:
        frame: (H, W, 3) uint8.
        state: x, y (px), psi (rad), 1/sqrt(A) (1/px).
        aspect: r = h / w.

    Returns:
        Turn, rad, from -pi/4 to pi/4, and coherence: 1 for lines at right angles alone, 0 for no preferred direction.
    """
    patch = cv2.GaussianBlur(_upright(frame, state, aspect), (5, 5), _BLUR)
    along, across, coherence = _axis(patch, _ROUNDS, _NEAR_COSINE)
    return math.atan2(across, along) / 4.0, float(coherence)


def _upright(frame: np.ndarray, state: np.ndarray, aspect: float) -> np.ndarray:
    """What the rectangle of a state (4,) holds, turned upright, (h, w, 3) uint8; beyond the edge it is repeated."""
    width = 1.0 / (state[SCALE] * math.sqrt(aspect))
    height = width * aspect
    step = max(1.0, max(width, height) / _LONGEST_PX)
    columns, rows = max(3, int(width / step)), max(3, int(height / step))
    cosine, sine = step * math.cos(state[PSI]), step * math.sin(state[PSI])
    left, top = (columns - 1) / 2, (rows - 1) / 2
    to_frame = np.array(
        [
            [cosine, -sine, state[X] - cosine * left + sine * top],
            [sine, cosine, state[Y] - sine * left - cosine * top],
        ]
    )
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return cv2.warpAffine(frame, to_frame, (columns, rows), flags=flags, borderMode=cv2.BORDER_REPLICATE)


# A given signature compiles when the module is imported (and is kept on disk), not when the first target is selected.
@njit(
    "UniTuple(f8,3)(u1[:,:,::1],i8,f8)", cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"}
)
def _axis(patch, rounds, near_cosine):  # type: ignore[no-untyped-def]
    """Direction (cos 4t, sin 4t) of the edges in a patch (h, w, 3), refined in rounds, and the coherence of all."""
    rows, columns, channels = patch.shape
    count = (rows - 2) * ((columns - 1) // 2) * channels  # at most
    evens, odds = np.empty(count, np.float32), np.empty(count, np.float32)  # length * (cos 4t, sin 4t)
    lengths = np.empty(count, np.float32)  # of the gradient (Scharr), squared
    i, total = 0, 0.0
    for y in range(1, rows - 1):
        for x in range(1 + y % 2, columns - 1, 2):
            for c in range(channels):
                nw, n, ne = (
                    np.int32(patch[y - 1, x - 1, c]),
                    np.int32(patch[y - 1, x, c]),
                    np.int32(patch[y - 1, x + 1, c]),
                )
                w, e = np.int32(patch[y, x - 1, c]), np.int32(patch[y, x + 1, c])
                sw, s, se = (
                    np.int32(patch[y + 1, x - 1, c]),
                    np.int32(patch[y + 1, x, c]),
                    np.int32(patch[y + 1, x + 1, c]),
                )
                gx = np.float32(3 * (ne + se - nw - sw) + 10 * (e - w))
                gy = np.float32(3 * (sw + se - nw - ne) + 10 * (s - n))
                length = gx * gx + gy * gy
                even, odd = gx * gx - gy * gy, np.float32(2.0) * gx * gy  # length * (cos 2t, sin 2t)
                inverse = np.float32(1.0) / max(length, np.float32(1.0))
                evens[i], odds[i] = (even * even - odd * odd) * inverse, np.float32(2.0) * even * odd * inverse
                lengths[i] = length
                total += length
                i += 1
    voters = i
    along, across = float(evens[:voters].sum()), float(odds[:voters].sum())
    coherence = math.hypot(along, across) / max(total, 1.0)
    for _ in range(rounds):
        norm = max(math.hypot(along, across), 1e-9)
        even4, odd4, least = np.float32(along / norm), np.float32(across / norm), np.float32(near_cosine)
        along, across = 0.0, 0.0
        for i in range(voters):
            # A pixel counts by what the cosine of four times its angle to that direction has above the bound.
            share = max(evens[i] * even4 + odds[i] * odd4 - least * lengths[i], np.float32(0.0))
            share /= max(lengths[i], np.float32(1.0))
            along += share * evens[i]
            across += share * odds[i]
    return along, across, coherence
