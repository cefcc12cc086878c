"""DSST and the fusion on the real video of a person, against boxes drawn by hand."""

from __future__ import annotations

import math

import cv2
import numpy as np

from benchmarks.sample_video import sample_video
from common.processes import load_config
from onboard.fusion.tracker import HabDfTracker
from tests.replay.test_vtest_person import _boxes

STRONG = ("dsst", "cmt", "struck", "tld")
"""Members that hold him alone."""


def test_person_is_followed_until_the_last_box() -> None:
    boxes = _boxes()
    names = (*STRONG, "particle_filter")
    config = load_config(None, [f"hab_df.members=[{', '.join(f'{n!r}' for n in names)}]"])
    fused = HabDfTracker.make(config, np.random.default_rng(1))
    video = cv2.VideoCapture(str(sample_video()))
    overlaps: dict[str, list[float]] = {name: [] for name in ("hab-df", *STRONG)}
    offsets = []
    for number in range(max(boxes) + 1):
        ok, frame = video.read()
        assert ok
        if number == min(boxes):
            fused.init(np.asarray(frame), boxes[number], 0.0, number * 100_000_000)
        elif number > min(boxes):
            result = fused.update(np.asarray(frame), number * 100_000_000)
            if number in boxes:
                x, y, w, h = boxes[number]
                overlaps["hab-df"].append(result.overlap(boxes[number]))
                for name in STRONG:
                    overlaps[name].append(fused.answers[name].overlap(boxes[number]))
                offsets.append(math.dist(result.center_px, (x + w / 2, y + h / 2)))
    means = {name: float(np.mean(values)) for name, values in overlaps.items()}
    assert means.pop("tld") > 0.5, "it waits for its detector while he is behind the post"
    assert min(means.values()) > 0.75, means
    assert np.median(offsets) < 4.0
