"""The light on the target against the light of its first picture: a gain for each colour channel, followed and found.

Teulière 2011 leaves the adaptation to illumination to future work (section V). While the target is seen, small changes
are followed, in brightness and in each channel by itself (a cloud also changes the colour). When it is not seen, the
light may have jumped (a cloud, the camera's exposure). The jump of the whole picture's mean is then tried first, and
gains farther away after it, a few in each picture.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from common.tracking.histogram import HistogramModel

_BRIGHTER = np.linspace(-0.06, 0.06, 5)
"""Relative changes of brightness that are tried on each picture: twice the steepest one seen at 20 Hz."""
_TINTED = 0.04
"""Relative change of one channel that is tried."""
_STEPS = np.concatenate([np.outer(_BRIGHTER, np.ones(3)), _TINTED * np.eye(3), -_TINTED * np.eye(3)])
_SHARPNESS = 200.0
"""Sharpness of the choice among them; ten times eq. 5, since these distances differ by the light alone."""
_BOUNDS = (0.35, 2.8)
_TINT = 1.35
"""Most by which a channel's gain may differ from the mean of all: beyond, it is another colour."""
_JUMPS = (1.06, 0.94, 1.14, 0.87, 1.25, 0.8, 1.4, 0.7, 1.6, 0.6, 1.8, 0.55)
"""Factors on the gain that are tried when the target is not seen."""
_TRIED_AT_ONCE = 2
_EVERY_PX = 16
"""Of the picture's pixels, so far apart, its mean colour is taken."""


class Light:
    """Gain (3,), B, G, R, that undoes the light's change since the first picture.

    Args:
        memory_s: time constant with which it follows, s; 0 leaves it at 1.
    """

    def __init__(self, memory_s: float):
        self.gain = np.ones(3)
        self._memory_s = memory_s
        self._jump = 0
        self._seen: np.ndarray | None = None  # the last picture with the target

    def follow(self, model: HistogramModel, frame: np.ndarray, state: np.ndarray, thinning: int, dt_s: float) -> None:
        """Move the gain to where the distance of the target's state (4,) is smallest."""
        self._jump, self._seen = 0, frame
        if self._memory_s == 0.0:
            return
        distances = model.relit(frame, state, self.gain * (1.0 + _STEPS), thinning)
        weights = np.exp(-_SHARPNESS * (distances**2 - distances.min() ** 2))
        step = weights @ _STEPS / weights.sum()
        self.gain = _bounded(self.gain * (1.0 + min(1.0, dt_s / self._memory_s) * step))

    def jumps(self, frame: np.ndarray) -> list[np.ndarray]:
        """Gains to try on a picture in which the target is not seen; others each time, until it is."""
        if self._memory_s == 0.0:
            return []
        scene = [] if self._seen is None else [self.gain * _mean_colour(self._seen) / _mean_colour(frame)]
        chosen = [self.gain * _JUMPS[(self._jump + i) % len(_JUMPS)] for i in range(_TRIED_AT_ONCE)]
        self._jump += _TRIED_AT_ONCE
        return [_bounded(gain) for gain in (*scene, *chosen)]


def _mean_colour(frame: np.ndarray) -> np.ndarray:
    """Mean (3,) of each channel over the picture, at least one grey level."""
    return np.maximum(cv2.mean(np.ascontiguousarray(frame[::_EVERY_PX, ::_EVERY_PX]))[:3], 1.0)


def _bounded(gain: np.ndarray) -> np.ndarray:
    mean = math.exp(float(np.log(gain).mean()))
    return gain.clip(mean / _TINT, mean * _TINT).clip(*_BOUNDS)
