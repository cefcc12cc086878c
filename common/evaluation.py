"""How well a track agrees with the truth: the measures of Echeverri 2016, section 4.5.2."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from common.config import ConfigError
from common.tracking.base import Box

LEAST_OVERLAP = 0.5
"""Overlap from which a picture counts as a success."""
LARGEST_DISTANCE_PX = 50.0
"""Distance up to which it does."""


@dataclass(frozen=True)
class Evaluation:
    """Agreement of a track with the truth, picture by picture, over the pictures in which the target is visible."""

    frames: np.ndarray
    """Numbers of those pictures, (T,)."""
    overlap: np.ndarray
    """Jaccard index of eq. 4.9, (T,); 0 where nothing was reported."""
    d4_px: np.ndarray
    """The thesis's distance over u, v, h and w, (T,), px; infinite where nothing was reported."""
    center_px: np.ndarray
    """Distance of the centres, (T,), px; infinite where nothing was reported."""
    absent: int
    """Pictures without the target."""
    reported_absent: int
    """Those of them in which it was reported."""

    def figures(self) -> dict[str, float]:
        """Means and shares; distances over the pictures in which it was reported, successes over all visible ones."""
        reported = np.isfinite(self.d4_px)
        good = self.overlap >= LEAST_OVERLAP
        return {
            "visible": float(len(self.frames)),
            "reported": float(reported.sum()),
            "mean_jaccard": float(self.overlap.mean()),
            "d4_px": float(self.d4_px[reported].mean()) if reported.any() else math.nan,
            "centre_px": float(self.center_px[reported].mean()) if reported.any() else math.nan,
            "success_d4": float((good & (self.d4_px <= LARGEST_DISTANCE_PX)).mean()),
            "success_centre": float((good & (self.center_px <= LARGEST_DISTANCE_PX)).mean()),
            "absent": float(self.absent),
            "reported_while_absent": float(self.reported_absent),
        }


def jaccard(one: Box, other: Box) -> float:
    """Area of the intersection of two boxes over that of their union (eq. 4.9), 0 to 1."""
    across = min(one[0] + one[2], other[0] + other[2]) - max(one[0], other[0])
    down = min(one[1] + one[3], other[1] + other[3]) - max(one[1], other[1])
    shared = max(0.0, across) * max(0.0, down)
    return shared / (one[2] * one[3] + other[2] * other[3] - shared)


def distances_px(one: Box, other: Box) -> tuple[float, float]:
    """Euclidean distances of two boxes over (u, v, h, w) and over the centre (u, v) alone, px."""
    offsets = (one[0] - other[0] + (one[2] - other[2]) / 2, one[1] - other[1] + (one[3] - other[3]) / 2)
    center = math.hypot(*offsets)
    return math.hypot(center, one[2] - other[2], one[3] - other[3]), center


def evaluate(track: Mapping[int, Box | None], truth: Mapping[int, Box | None]) -> Evaluation:
    """Compare boxes (x, y, w, h, px) by picture number; a picture that the track leaves out counts as not reported.

    Raises:
        ConfigError: the truth shows the target nowhere.
    """
    rows, absent, wrong = [], 0, 0
    for frame, true in sorted(truth.items()):
        found = track.get(frame)
        if true is None:
            absent += 1
            wrong += found is not None
        elif found is None:
            rows.append((frame, 0.0, math.inf, math.inf))
        else:
            rows.append((frame, jaccard(found, true), *distances_px(found, true)))
    if not rows:
        raise ConfigError("ground truth: the target is visible in no picture; is --format right?")
    frames, overlap, d4_px, center_px = np.array(rows).T
    return Evaluation(frames.astype(int), overlap, d4_px, center_px, absent, wrong)


def read_track(path: str) -> dict[str, dict[int, Box | None]]:
    """Boxes by tracker and picture number from what `outrider track` wrote; without a column `tracker`, under "".

    Raises:
        ConfigError: unreadable, or not such a file.
    """
    tracks: dict[str, dict[int, Box | None]] = {}
    try:
        with Path(path).open(encoding="utf-8", newline="") as file:
            for row in csv.DictReader(file):
                box = None
                if row["x"] and row["state"] != "lost":
                    box = (float(row["x"]), float(row["y"]), float(row["w"]), float(row["h"]))
                tracks.setdefault(row.get("tracker") or "", {})[int(row["frame"])] = box
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"results: cannot read {path!r}: {error}") from None
    except (KeyError, ValueError, TypeError):
        raise ConfigError(f"results: {path!r} is not what `outrider track --out` writes") from None
    if not tracks:
        raise ConfigError(f"results: {path!r} has no line; was the track ended early?")
    return tracks
