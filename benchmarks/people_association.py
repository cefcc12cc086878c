"""Who is who after gaps of a second to a minute: annotated people of vtest.avi under a camera that turns and jumps.

Once all pictures are gone through in their order; once every two of them that are a gap apart, with nothing in between.
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
from benchmarks.people_pose import BOXES, Annotated, annotated, turn
from benchmarks.sample_video import sample_frames
from common.config import ConfigError
from onboard.people.appearance import look_of, similarity
from onboard.people.association import assign
from onboard.people.config import AssociationConfig
from onboard.people.identity import Detection
from onboard.people.pose import Picture
from onboard.people.pose_file import blazepose_file
from onboard.people.pose_finder import PoseFinder
from onboard.people.pose_network import PoseNetwork, blazepose
from onboard.people.tracks import PeopleTracker

_RATE_HZ = 10.0
_SHIFT_PX = 120.0
_LEAST_IOU = 0.3
_RUNS, _QUICK_RUNS = 5, 1
_GAPS = BOXES.with_name("people_vtest_gaps.csv")
_GAPS_S = {"1s": (0.5, 2.0), "10s": (2.0, 15.0), "30s": (15.0, 45.0), "60s": (45.0, 70.0)}
"""Least and most of the gaps that count as so long, s."""
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
    later = annotated(_GAPS)
    try:
        frames = sample_frames(box.frame for box in (*people, *later))
    except FileNotFoundError as error:
        raise ConfigError(f"bench people-association: {error}") from None
    finder = PoseFinder(PoseNetwork(blazepose(blazepose_file())))
    config = AssociationConfig(confirm_hits=1)
    ours, motion, first = [], [], []
    kept = {name: _Kept() for name in _GAPS_S}
    for draw in range(_QUICK_RUNS if settings.quick else _RUNS):
        rng = np.random.default_rng((settings.seed, draw))

        def seen_of(boxes: Sequence[Annotated], rng: np.random.Generator = rng) -> list[list[Seen]]:
            by_frame = [[b for b in boxes if b.frame == number] for number in sorted({b.frame for b in boxes})]
            return [_seen(some, frames[some[0].frame], finder, rng) for some in by_frame]

        sequence = seen_of(people)
        ours.append(_scores(sequence, _by_look(sequence, config)))
        motion.append(_scores(sequence, _by_motion(sequence)))
        first += _rank_one(sequence)
        _over_gaps([*sequence, *seen_of(later)], config, kept)
    results = {
        "rank1": float(np.mean(first)),
        "idf1": float(np.mean([s["idf1"] for s in ours])),
        "idf1_worst": min(s["idf1"] for s in ours),
        "id_switches": float(np.mean([s["num_switches"] for s in ours])),
        "motion_idf1": float(np.mean([s["idf1"] for s in motion])),
        "motion_id_switches": float(np.mean([s["num_switches"] for s in motion])),
        "boxes": float(len(people) + len(later)),
        "people": float(len({b.identity for b in people})),
    }
    for name, count in kept.items():
        results |= {
            f"kept_{name}": count.ours / count.people,
            f"motion_kept_{name}": count.motion / count.people,
            f"people_{name}": float(count.people),
        }
    scorer = f"motion-only SORT, scored by motmetrics {importlib.metadata.version('motmetrics')}"
    return Outcome(results, {"name": scorer, "idf1": results["motion_idf1"]})


@dataclass
class _Kept:
    """Who keeps their number over gaps of about one length."""

    people: int = 0
    ours: int = 0
    motion: int = 0


def _over_gaps(pictures: Sequence[Sequence[Seen]], config: AssociationConfig, kept: dict[str, _Kept]) -> None:
    """Count, over every two pictures a gap apart, with nothing seen in between, who has the same number in both."""
    for before in pictures:
        for after in pictures:
            gap_s = (after[0].box.frame - before[0].box.frame) / _RATE_HZ
            name = next((n for n, (least, most) in _GAPS_S.items() if least <= gap_s < most), None)
            if name is None:
                continue
            kept[name].ours += _same(before, after, _by_look([before, after], config))
            kept[name].motion += _same(before, after, _by_motion([before, after]))
            kept[name].people += len({s.box.identity for s in before} & {s.box.identity for s in after})


def _same(before: Sequence[Seen], after: Sequence[Seen], numbers: Sequence[Sequence[int]]) -> int:
    """How many people of two pictures have one number in both."""
    first = {s.box.identity: number for s, number in zip(before, numbers[0], strict=True)}
    return sum(first.get(s.box.identity) == number for s, number in zip(after, numbers[1], strict=True))


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


BENCHMARK = Benchmark("people-association", "who is who after gaps, beside motion-only association", run)
