"""How a target lies by its own straight lines: its outline, windows, painted edges.

Colour histograms fix an angle weakly: one degree moves hardly any of a kernel's weight, and a target that was first
seen from the side, then from above, fits best a degree or more away from where it lies. The lines of a made thing run
along its length and across it wherever it is seen from, and all of its pixels vote.
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

    def turn(self, frame: np.ndarray, state: np.ndarray) -> float:
        """How far a state (4,) has to be turned to lie along the target's lines, rad; 0 where these are in doubt."""
        if not self.usable:
            return 0.0
        turn, coherence = lines_turn(frame, state, self._aspect)
        trusted = abs(turn) <= self._reach_rad and coherence >= _AS_COHERENT * self._coherence
        return turn if trusted else 0.0


def lines_turn(frame: np.ndarray, state: np.ndarray, aspect: float) -> tuple[float, float]:
    """How far the lines in a state's rectangle lie from its sides, and how coherent they are.

    The gradient's direction is taken four times, so that all sides of a rectangle point the same way (the double angle
    of Granlund 1978, DOI 10.1016/0146-664X(78)90047-3, once more), and summed over the pixels weighted by its square.

    Args:
        frame: (H, W, 3) uint8.
        state: x, y (px), psi (rad), 1/sqrt(A) (1/px).
        aspect: r = h / w.

    Returns:
        Turn, rad, from -pi/4 to pi/4, and coherence: 1 for lines at right angles alone, 0 for no preferred direction.
    """
    patch = cv2.GaussianBlur(_upright(frame, state, aspect), (5, 5), _BLUR)
    along, across, total = _fourfold(patch)
    if total <= 0.0:
        return 0.0, 0.0
    return math.atan2(across, along) / 4.0, math.hypot(along, across) / total


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
@njit("UniTuple(f8,3)(u1[:,:,::1])", cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _fourfold(patch):  # type: ignore[no-untyped-def]
    """Sums of w cos 4t, w sin 4t and w over pixels and channels; gradient direction t, squared length w (Scharr)."""
    along, across, total = 0.0, 0.0, 0.0
    for y in range(1, patch.shape[0] - 1):
        for x in range(1, patch.shape[1] - 1):
            for c in range(3):
                nw, n, ne = float(patch[y - 1, x - 1, c]), float(patch[y - 1, x, c]), float(patch[y - 1, x + 1, c])
                w, e = float(patch[y, x - 1, c]), float(patch[y, x + 1, c])
                sw, s, se = float(patch[y + 1, x - 1, c]), float(patch[y + 1, x, c]), float(patch[y + 1, x + 1, c])
                gx = 3.0 * (ne + se - nw - sw) + 10.0 * (e - w)
                gy = 3.0 * (sw + se - nw - ne) + 10.0 * (s - n)
                xx, yy = gx * gx, gy * gy
                length = xx + yy
                if length > 0.0:
                    even, odd = xx - yy, 2.0 * gx * gy  # length * (cos 2t, sin 2t)
                    along += (even * even - odd * odd) / length
                    across += 2.0 * even * odd / length
                    total += length
    return along, across, total
