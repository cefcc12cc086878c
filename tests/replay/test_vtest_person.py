"""The tracker on a real video: a person of the sample vtest.avi, against boxes drawn by hand."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from common.tracking.config import ParticleFilterConfig
from common.tracking.particle_filter import ParticleFilterTracker
from tests.conftest import sample_video

BOXES = Path(__file__).parent / "vtest_person.csv"


def _boxes() -> dict[int, tuple[float, float, float, float]]:
    rows = [line for line in BOXES.read_text().splitlines() if not line.startswith("#")]
    return {int(r["frame"]): (float(r["x"]), float(r["y"]), float(r["w"]), float(r["h"])) for r in csv.DictReader(rows)}


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_person_is_followed_until_the_last_box(seed: int) -> None:
    boxes = _boxes()
    video = cv2.VideoCapture(str(sample_video()))
    tracker = ParticleFilterTracker(ParticleFilterConfig(), np.random.default_rng(seed))
    overlaps, offsets = [], []
    for frame_number in range(max(boxes) + 1):
        ok, frame = video.read()
        assert ok
        t_ns = frame_number * 100_000_000
        if frame_number == min(boxes):
            tracker.init(np.asarray(frame), boxes[frame_number], 0.0, t_ns)
        elif frame_number > min(boxes):
            result = tracker.update(np.asarray(frame), t_ns)
            if frame_number in boxes:
                x, y, w, h = boxes[frame_number]
                overlaps.append(result.overlap(boxes[frame_number]))
                offsets.append(math.dist(result.center_px, (x + w / 2, y + h / 2)))
    assert np.mean(overlaps) > 0.45
    assert np.median(offsets) < 8.0
