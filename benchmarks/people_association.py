"""Who is who after gaps of seconds to minutes: annotated people of vtest.avi under a camera that turns and jumps.

Every annotated picture is turned by an angle and shifted by a distance of its own, as between two passes of a fast
vehicle. Ours sees the turned pictures; motion-only association (SORT: boxes with a constant velocity, IoU, Hungarian
method) gets the same boxes at their shifted places. Neither forgets anybody.
"""

from __future__ import annotations

import importlib.metadata
import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from benchmarks.base import Benchmark, Outcome, Settings
from benchmarks.people_pose import Annotated, annotated, turn
from benchmarks.sample_video import sample_frames
from common.config import ConfigError
from onboard.people.appearance import look_of, similarity
from onboard.people.association import assign
from onboard.people.config import AssociationConfig
from onboard.people.pose import Picture
from onboard.people.pose_file import blazepose_file
from onboard.people.pose_finder import PoseFinder
from onboard.people.pose_network import PoseNetwork, blazepose
from onboard.people.tracks import Detection, PeopleTracker

_RATE_HZ = 10.0
_SHIFT_PX = 120.0
_LEAST_IOU = 0.3
_RUNS, _QUICK_RUNS = 5, 1
Box = tuple[float, float, float, float]


@dataclass(frozen=True)
class Seen:
    """One annotated person in one picture."""

    box: Annotated
    detection: Detection
    shifted: Box
    """Where the box lies after the camera's jump, px."""


def run(settings: Settings) -> Outcome:
    """Both on the same people, with several draws of the camera's turns and jumps."""
    cv2.setNumThreads(1)
    people = [box for box in annotated() if box.identity]
    try:
        frames = sample_frames(box.frame for box in people)
    except FileNotFoundError as error:
        raise ConfigError(f"bench people-association: {error}") from None
    finder = PoseFinder(PoseNetwork(blazepose(blazepose_file())))
    config = AssociationConfig(confirm_hits=1)
    ours, motion, first = [], [], []
    for draw in range(_QUICK_RUNS if settings.quick else _RUNS):
        rng = np.random.default_rng((settings.seed, draw))
        sequence = [
            _seen([b for b in people if b.frame == number], frames[number], finder, rng) for number in sorted(frames)
        ]
        ours.append(_scores(sequence, _by_look(sequence, config)))
        motion.append(_scores(sequence, _by_motion(sequence)))
        first += _rank_one(sequence)
    results = {
        "rank1": float(np.mean(first)),
        "idf1": float(np.mean([s["idf1"] for s in ours])),
        "idf1_worst": min(s["idf1"] for s in ours),
        "id_switches": float(np.mean([s["num_switches"] for s in ours])),
        "motion_idf1": float(np.mean([s["idf1"] for s in motion])),
        "motion_id_switches": float(np.mean([s["num_switches"] for s in motion])),
        "boxes": float(len(people)),
        "people": float(len({b.identity for b in people})),
        "gap_s_max": _longest_gap_s(people),
    }
    scorer = f"motion-only SORT, scored by motmetrics {importlib.metadata.version('motmetrics')}"
    return Outcome(results, {"name": scorer, "idf1": results["motion_idf1"]})


def _seen(boxes: Sequence[Annotated], picture: Picture, finder: PoseFinder, rng: np.random.Generator) -> list[Seen]:
    angle = rng.uniform(-math.pi, math.pi)
    dx, dy = rng.uniform(-_SHIFT_PX, _SHIFT_PX, 2)
    found = []
    for box in boxes:
        turned, region, _ = turn(picture, box, angle)
        pose = finder.find(turned, region)
        detection = Detection(pose, look_of(turned, region, pose))
        found.append(Seen(box, detection, (box.x + dx, box.y + dy, box.w, box.h)))
    return found


def _by_look(sequence: Sequence[Sequence[Seen]], config: AssociationConfig) -> list[list[int]]:
    tracker = PeopleTracker(config)
    return [tracker.update([s.detection for s in seen], _time_ns(seen)) for seen in sequence]


def _time_ns(seen: Sequence[Seen]) -> int:
    return round(seen[0].box.frame / _RATE_HZ * 1e9)


def _by_motion(sequence: Sequence[Sequence[Seen]]) -> list[list[int]]:
    """Numbers by IoU with where each box would be, had it gone on as between its last two pictures."""
    boxes: list[tuple[Box, Box]] = []
    numbers = []
    for seen in sequence:
        costs = np.array([[1.0 - _iou(_predicted(*known), s.shifted) for s in seen] for known in boxes])
        given = {column: row for row, column in assign(costs, 1.0 - _LEAST_IOU)}
        row_numbers = []
        for index, s in enumerate(seen):
            row = given.get(index, len(boxes))
            if row == len(boxes):
                boxes.append((s.shifted, s.shifted))
            else:
                boxes[row] = (boxes[row][1], s.shifted)
            row_numbers.append(row + 1)
        numbers.append(row_numbers)
    return numbers


def _predicted(before: Box, last: Box) -> Box:
    return (2 * last[0] - before[0], 2 * last[1] - before[1], last[2], last[3])


def _iou(a: Box, b: Box) -> float:
    w = max(0.0, min(a[0] + a[2], b[0] + b[2]) - max(a[0], b[0]))
    h = max(0.0, min(a[1] + a[3], b[1] + b[3]) - max(a[1], b[1]))
    return w * h / (a[2] * a[3] + b[2] * b[3] - w * h)


def _scores(sequence: Sequence[Sequence[Seen]], numbers: Sequence[Sequence[int]]) -> dict[str, float]:
    import motmetrics  # brings pandas: a second that the other benchmarks need not wait

    accumulator = motmetrics.MOTAccumulator(auto_id=True)
    for seen, given in zip(sequence, numbers, strict=True):
        distances = np.where(np.eye(len(seen), dtype=bool), 0.0, np.nan)
        accumulator.update([ord(s.box.identity) for s in seen], list(given), distances)
    table = motmetrics.metrics.create().compute(accumulator, metrics=["idf1", "num_switches"])
    return {name: float(table[name].iloc[0]) for name in ("idf1", "num_switches")}


def _rank_one(sequence: Sequence[Sequence[Seen]]) -> list[bool]:
    """For everybody who was there before: whether the most similar earlier look is theirs."""
    earlier: list[Seen] = []
    hits = []
    for seen in sequence:
        for s in seen:
            if any(e.box.identity == s.box.identity for e in earlier):
                best = max(earlier, key=lambda e: similarity(e.detection.look, s.detection.look))
                hits.append(best.box.identity == s.box.identity)
        earlier += seen
    return hits


def _longest_gap_s(people: Sequence[Annotated]) -> float:
    gaps = [0]
    for identity in {b.identity for b in people}:
        gaps += np.diff(sorted(b.frame for b in people if b.identity == identity)).tolist()
    return max(gaps) / _RATE_HZ


BENCHMARK = Benchmark("people-association", "who is who after gaps, beside motion-only association", run)
