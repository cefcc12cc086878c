"""Two short clips that every tracker is replayed on, each with its truth.

A car passes under a bridge, and one comes closer while a cloud comes.

They are painted (`benchmarks/painted_scene.py`), half as large, and packed, so that what is replayed is a real file
with a codec's losses; `python -m tests.replay.clips` makes them anew.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from benchmarks.painted_scene import CAR_PX, HEIGHT, RATE_HZ, WIDTH, Pose, Scene
from common.ground_truth import read_ground_truth
from common.tracking.base import Box

FOLDER = Path(__file__).parent / "clips"
_BRIDGE_PX = (280, 465)
"""Columns of the scene that the bridge covers."""
_SHRINK = 0.5


@dataclass(frozen=True)
class Clip:
    """One clip."""

    name: str
    scene: Scene
    duration_s: float
    seen: Callable[[Pose], float]
    """Share of the car that shows at a pose, 0 to 1."""

    @property
    def video(self) -> Path:
        """The file."""
        return FOLDER / f"{self.name}.mp4"

    def pictures(self) -> Iterator[tuple[np.ndarray, Box | None]]:
        """Rendered picture (240, 320, 3) and the car's box, px; None while it is hidden."""
        for _, frame, pose in self.scene.frames(self.duration_s):
            small = cv2.resize(frame, None, fx=_SHRINK, fy=_SHRINK, interpolation=cv2.INTER_AREA)
            x, y, width, height = (_SHRINK * side for side in pose.box())
            yield small, (x, y, width, height) if self.seen(pose) > 0.0 else None

    def truth(self) -> dict[int, Box | None]:
        """The committed boxes by number of the picture, from 0."""
        return read_ground_truth(str(FOLDER / f"{self.name}.txt"), "tld")


def _under_the_bridge(t_s: float) -> Pose:
    return Pose(85.0 + 200.0 * t_s, HEIGHT / 2 + 12.0 * math.sin(2.0 * t_s))


def _bridge(frame: np.ndarray, t_s: float) -> None:
    left, right = _BRIDGE_PX
    frame[:, left:right] = (120, 125, 128)
    frame[:, left : left + 6] = frame[:, right - 6 : right] = (70, 70, 75)
    for row in range(0, HEIGHT, 48):
        cv2.line(frame, (left, row), (right, row + 20), (105, 110, 112), 3)


def _beside_the_bridge(pose: Pose) -> float:
    left, right = pose.x_px - CAR_PX[0] / 2, pose.x_px + CAR_PX[0] / 2
    hidden = max(0.0, min(right, _BRIDGE_PX[1]) - max(left, _BRIDGE_PX[0]))
    return 1.0 - hidden / CAR_PX[0]


def _approached(t_s: float) -> Pose:
    sway = 40.0 * math.sin(2.5 * t_s)
    return Pose(WIDTH / 2 + sway, HEIGHT / 2 + 25.0 * math.sin(1.7 * t_s), 0.04 * math.sin(3.0 * t_s), 0.9 + 0.27 * t_s)


CLIPS = (
    Clip("bridge", Scene(_under_the_bridge, 3, decorate=_bridge), 2.6, _beside_the_bridge),
    Clip("cloud", Scene(_approached, 4, gain=lambda t_s: 1.0 - 0.25 * t_s), 1.5, lambda pose: 1.0),
)


def write() -> None:
    """Render and pack all clips, and write their truth as corners x1, y1, x2, y2, NaN while the car is hidden."""
    for clip in CLIPS:
        size = (round(WIDTH * _SHRINK), round(HEIGHT * _SHRINK))
        writer = cv2.VideoWriter(str(clip.video), cv2.VideoWriter.fourcc(*"mp4v"), RATE_HZ, size)
        with (FOLDER / f"{clip.name}.txt").open("w", newline="", encoding="utf-8") as file:
            rows = csv.writer(file, lineterminator="\n")
            for picture, box in clip.pictures():
                writer.write(picture)
                corners = [math.nan] * 4 if box is None else [box[0], box[1], box[0] + box[2], box[1] + box[3]]
                rows.writerow([f"{value:.2f}" for value in corners])
        writer.release()


if __name__ == "__main__":
    write()
