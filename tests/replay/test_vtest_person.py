"""The tracker on a real video: a person of the sample vtest.avi, against boxes drawn by hand."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks import sample_video as sample_module
from benchmarks.sample_video import sample_video
from common.cli import main
from common.tracking.config import ParticleFilterConfig
from common.tracking.particle_filter import ParticleFilterTracker

BOXES = Path(sample_module.__file__).parent / "vtest_person.csv"


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


@pytest.mark.parametrize("seed", [1, 2])
def test_track_command_until_the_person_leaves(tmp_path: Path, seed: int) -> None:
    """He turns round, passes the sign post twice, and leaves at the right edge with picture 390; others stay about."""
    out = tmp_path / "track.csv"
    x, y, w, h = _boxes()[60]
    box = f"{x},{y},{w},{h}"
    arguments = ["track", str(sample_video()), "--tracker", "pursuit", "--init", box, "--init-frame", "60"]
    assert main([*arguments, "--out", str(out), "--seed", str(seed)]) == 0
    with out.open(newline="") as file:
        rows = {int(row["frame"]): row for row in csv.DictReader(file)}
    assert len(rows) == 795
    overlaps = [_upright_overlap(rows[number], box) for number, box in _boxes().items()]
    assert np.mean(overlaps) > 0.45
    assert {rows[n]["state"] for n in range(60)} == {"lost"}
    assert np.mean([rows[n]["state"] != "lost" for n in range(60, 389)]) > 0.93
    assert abs(float(rows[380]["x"]) - 662) < 12, "drawn by eye: still the same man after both passages"
    assert {rows[n]["state"] for n in range(395, 460)} == {"lost"}
    assert all(rows[n]["x"] == "" for n in range(395, 460))


def _upright_overlap(row: dict[str, str], box: tuple[float, float, float, float]) -> float:
    if row["state"] == "lost":
        return 0.0
    x, y, w, h = (float(row[name]) for name in "xywh")
    across = min(x + w, box[0] + box[2]) - max(x, box[0])
    down = min(y + h, box[1] + box[3]) - max(y, box[1])
    shared = max(0.0, across) * max(0.0, down)
    return shared / (w * h + box[2] * box[3] - shared)
