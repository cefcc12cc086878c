"""People without depth: where a person detector says, with pose and filter, on annotated pictures of a real video."""

from __future__ import annotations

import time

import cv2
import numpy as np

from benchmarks.base import Benchmark, Outcome, Settings
from benchmarks.people_pose import annotated
from benchmarks.sample_video import sample_frames
from common.config import ConfigError
from onboard.people.config import PoseFilterConfig
from onboard.people.detector import PersonDetector
from onboard.people.detector_file import HOW, fetched_detector
from onboard.people.pose_file import blazepose_file
from onboard.people.pose_filter import pose_refusal
from onboard.people.pose_finder import PoseFinder
from onboard.people.pose_network import PoseNetwork, blazepose
from onboard.people.regions import Box
from onboard.people.watch import iou

TUNED_ON = (0, 132, 198, 264, 396, 594)
"""Pictures that the detector's least score, overlap and squares were chosen on: they are left out here."""
_SAME, _LOOSE, _PARTLY, _ELSEWHERE = 0.5, 0.3, 0.2, 0.1
_QUICK_PICTURES = 3


def run(settings: Settings) -> Outcome:
    """The annotated pictures that nothing was chosen on; with `--quick` three of them, which the seed draws."""
    cv2.setNumThreads(1)
    config = fetched_detector()
    if config is None:
        return Outcome({}, {"name": "none"}, table=(f"  There is no person detector: {HOW}",))
    boxes = [box for box in annotated() if box.frame not in TUNED_ON]
    try:
        frames = sample_frames(box.frame for box in boxes)
    except FileNotFoundError as error:
        raise ConfigError(f"bench people-video: {error}") from None
    numbers = sorted(frames)
    if settings.quick:
        numbers = np.random.default_rng(settings.seed).choice(numbers, _QUICK_PICTURES, replace=False).tolist()
    detector, finder = PersonDetector(config), PoseFinder(PoseNetwork(blazepose(blazepose_file())))
    people = regions_on = found_on = loosely = twice = things_found = elsewhere = regions = found = 0
    times_ms = []
    for number in numbers:
        start = time.process_time()
        there = detector.find(frames[number])
        times_ms.append(1e3 * (time.process_time() - start))
        kept = [r.box_px for r in there if not pose_refusal(finder.find(frames[number], r), r, PoseFilterConfig())]
        persons = [(b.x, b.y, b.w, b.h) for b in boxes if b.frame == number and b.person]
        things = [(b.x, b.y, b.w, b.h) for b in boxes if b.frame == number and not b.person]
        people, regions, found = people + len(persons), regions + len(there), found + len(kept)
        regions_on += _covered(persons, [r.box_px for r in there])
        found_on += _covered(persons, kept)
        loosely += _covered(persons, kept, _LOOSE)
        twice += sum(max(sum(iou(p, box) >= _PARTLY for box in kept) - 1, 0) for p in persons)
        things_found += _covered(things, kept)
        elsewhere += sum(all(iou(p, box) < _ELSEWHERE for p in persons) for box in kept)
    results = {
        "detector_recall": regions_on / people,
        "found_recall": found_on / people,
        "found_recall_iou_0.3": loosely / people,
        "found_twice": float(twice),
        "found_on_things": float(things_found),
        "found_elsewhere": float(elsewhere),
        "regions_per_picture": regions / len(numbers),
        "found_per_picture": found / len(numbers),
        "people": float(people),
        "detector_ms": float(np.median(times_ms)),
    }
    return Outcome(results, {"name": "none; the paper has no such mode"})


def _covered(truths: list[Box], boxes: list[Box], least: float = _SAME) -> int:
    """How many of the first have one of the second that shares so much of the area (IoU)."""
    return sum(any(iou(truth, box) >= least for box in boxes) for truth in truths)


BENCHMARK = Benchmark("people-video", "people without depth: detector, pose and filter on a real video", run)
