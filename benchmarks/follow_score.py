"""What counts as followed: how far the target is from the middle, whether the box is on it, and when it was lost."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from common.evaluation import LARGEST_DISTANCE_PX, LEAST_OVERLAP, distances_px, jaccard
from common.geometry.camera import Camera
from common.tracking.base import Box, TrackResult, upright_box

_LOST_S = 2.0
"""How long without a break the target must have been away for the run to be over, s."""
_ON_IT = 0.1
"""Least overlap of a box that is on the target."""
_HIDDEN = 0.5
"""Share of it that must be covered for nobody to be asked where it is."""


def box_of(result: TrackResult | None) -> Box | None:
    """Upright box of an answer; None where it does not say that it sees the target."""
    return upright_box(result) if result is not None and result.state == "tracking" else None


@dataclass
class Score:
    """Frame after frame of one run.

    The target is lost once it has been out of the picture, or visible with the box elsewhere (J < 0.1) or none, for two
    seconds without a break, frames in which it is covered left out; the run ends with the frame before those.
    """

    camera: Camera
    """Whose pictures."""
    rate_hz: float
    """Frames a second, Hz."""
    errors_px: list[float] = field(default_factory=list)
    """Distance of the true target from the middle of the picture, px."""
    overlaps: list[float] = field(default_factory=list)
    """Jaccard index of the box; 0 without one; only of frames in which the target is visible."""
    distances_px: list[float] = field(default_factory=list)
    """Distance over u, v, h, w (4.5.2), px, of the same frames; infinite without a box."""
    frames: int = 0
    """Frames so far."""
    _bad: int = 0
    _followed: int = 0

    def note(self, truth: Box | None, hidden: float, box: Box | None) -> None:
        """One frame.

        Args:
            truth: where the target is, beyond the picture's edge too; None behind the camera.
            hidden: share of it that is covered.
            box: the tracker's; None: it does not see the target.
        """
        self.frames += 1
        bad = True
        if truth is not None:
            u, v = truth[0] + truth[2] / 2, truth[1] + truth[3] / 2
            inside = 0 <= u < self.camera.width and 0 <= v < self.camera.height
            self.errors_px.append(math.hypot(u - self.camera.cx_px, v - self.camera.cy_px))
            bad = not inside
            if inside and hidden < _HIDDEN:
                j, d = (0.0, math.inf) if box is None else (jaccard(box, truth), distances_px(box, truth)[0])
                self.overlaps.append(j)
                self.distances_px.append(d)
                bad = j < _ON_IT
            elif inside:
                return  # nobody sees what is covered: it is neither found nor missed
        if bad and not self._bad:
            self._followed = self.frames - 1
        self._bad = self._bad + 1 if bad else 0

    @property
    def lost(self) -> bool:
        """Whether the run is over."""
        return self._bad >= _LOST_S * self.rate_hz

    @property
    def followed(self) -> int:
        """Frames until the loss, or all."""
        return self._followed if self.lost else self.frames

    @property
    def mean_error_px(self) -> float:
        """Mean distance of the target from the middle until the loss, px."""
        return float(np.mean(self.errors_px[: max(1, self.followed)]))

    def success(self, total: int) -> float:
        """Share of a run's frames, those after the loss included, with J >= 0.5 and d <= 50 px (4.5.2)."""
        pairs = zip(self.overlaps, self.distances_px, strict=True)
        good = [j >= LEAST_OVERLAP and d <= LARGEST_DISTANCE_PX for j, d in pairs]
        unseen = self.frames - len(good)
        return sum(good) / max(1, total - unseen)
