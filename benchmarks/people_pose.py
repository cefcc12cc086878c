"""Pose and Human Pose Filter on real pictures: annotated people and things of vtest.avi, as they are and turned."""

from __future__ import annotations

import csv
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from benchmarks.base import Benchmark, Outcome, Settings
from benchmarks.sample_video import sample_frames
from common.config import ConfigError
from onboard.people.config import PoseFilterConfig
from onboard.people.pose import Picture, Pose, upright_crop
from onboard.people.pose_file import blazepose_file
from onboard.people.pose_filter import pose_refusal
from onboard.people.pose_finder import PoseFinder
from onboard.people.pose_network import PoseNetwork, blazepose
from onboard.people.regions import Region

BOXES = Path(__file__).parent / "people_vtest.csv"
CHECK_BOXES = BOXES.with_name("people_vtest_check.csv")
"""Other pictures, that no setting was ever chosen on."""
_QUICK_SHARE = 3
_TURNED_PX = 384


@dataclass(frozen=True)
class Annotated:
    """One box of the sample video."""

    frame: int
    x: int
    y: int
    w: int
    h: int
    person: bool
    identity: str = ""
    """One letter for a person who is recognised in several frames."""

    def region(self) -> Region:
        """The box as a region without depth."""
        return Region((self.x, self.y, self.w, self.h), np.ones((self.h, self.w), bool), None, None, None, None)


@dataclass
class Count:
    """What the filter let through."""

    people: int = 0
    kept: int = 0
    things: int = 0
    false: int = 0
    right_end: int = 0

    def add(self, person: bool, kept: bool, right_end: bool) -> None:
        """Count one region."""
        self.people += person
        self.kept += person and kept
        self.things += not person
        self.false += (not person) and kept
        self.right_end += person and right_end


def annotated(path: Path = BOXES) -> list[Annotated]:
    """All boxes of a file in the format of `people_vtest.csv`."""
    rows = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    return [
        Annotated(
            *(int(r[k]) for k in ("frame", "x", "y", "w", "h")), person=r["person"] == "1", identity=r["identity"]
        )
        for r in csv.DictReader(rows)
    ]


def run(settings: Settings) -> Outcome:
    """Pose and filter on each box, upright and turned by an angle of its own."""
    cv2.setNumThreads(1)
    sets = {"": annotated(), "check_": annotated(CHECK_BOXES)}
    if settings.quick:
        sets = {name: boxes[settings.seed % _QUICK_SHARE :: _QUICK_SHARE] for name, boxes in sets.items()}
    try:
        frames = sample_frames(box.frame for boxes in sets.values() for box in boxes)
    except FileNotFoundError as error:
        raise ConfigError(f"bench people-pose: {error}") from None
    network = PoseNetwork(blazepose(blazepose_file()))
    finder = PoseFinder(network)
    results: dict[str, float] = {}
    times: list[float] = []
    for name, boxes in sets.items():
        for turned, count in zip(("", "turned_"), _counts(boxes, frames, finder, settings.seed, times), strict=True):
            results |= {
                f"{name}{turned}pose_filter_recall": count.kept / count.people,
                f"{name}{turned}pose_filter_false_positives": float(count.false),
                f"{name}{turned}pose_right_end": count.right_end / count.people,
            }
        results |= {f"{name}people": float(count.people), f"{name}things": float(count.things)}
    results["region_ms_median"] = float(np.median(times))
    results["crop_ms_median"] = _crop_ms(network, next(iter(frames.values())))
    baseline = {"name": "presence alone, above 0.5", **_presence_alone(finder, frames, sets[""])}
    return Outcome(results, baseline, {"pose_filter_false_positives": 0.0})


def _counts(
    boxes: Sequence[Annotated], frames: dict[int, Picture], finder: PoseFinder, seed: int, times: list[float]
) -> tuple[Count, Count]:
    """What the filter lets through of the boxes as they are, and of the turned ones; adds how long each took, ms."""
    config, rng = PoseFilterConfig(), np.random.default_rng(seed)
    plain, turned = Count(), Count()
    for box in boxes:
        region = box.region()
        start = time.process_time()
        pose = finder.find(frames[box.frame], region)
        times.append(1e3 * (time.process_time() - start))
        plain.add(box.person, not pose_refusal(pose, region, config), pose.up[1] < 0)
        picture, region, up = turn(frames[box.frame], box, rng.uniform(-math.pi, math.pi))
        pose = finder.find(picture, region)
        turned.add(box.person, not pose_refusal(pose, region, config), bool(pose.up @ up > math.cos(math.radians(30))))
    return plain, turned


def turn(picture: Picture, box: Annotated, angle_rad: float) -> tuple[Picture, Region, np.ndarray]:
    """The surroundings of a box, turned about its middle, the box's area in them, and where its upper side now lies."""
    middle = (box.x + 0.5 * (box.w - 1), box.y + 0.5 * (box.h - 1))
    direction = (math.sin(angle_rad), -math.cos(angle_rad))
    side = max(_TURNED_PX, 2 * max(box.w, box.h))
    crop, back = upright_crop(picture, middle, direction, side, side)
    corners = np.array([[box.x, box.y], [box.x + box.w, box.y], [box.x + box.w, box.y + box.h], [box.x, box.y + box.h]])
    places = (corners - back[:, 2]) @ np.linalg.inv(back[:, :2]).T
    drawn = np.zeros((side, side), np.uint8)
    cv2.fillConvexPoly(drawn, np.round(places).astype(np.int32), 1)
    x, y, w, h = cv2.boundingRect(drawn)
    up = np.linalg.inv(back[:, :2]) @ [0.0, -1.0]
    return crop, Region((x, y, w, h), drawn[y : y + h, x : x + w] > 0, None, None, None, None), up / np.linalg.norm(up)


def _crop_ms(network: PoseNetwork, picture: Picture) -> float:
    size = network.model.size_px
    crop = np.ascontiguousarray(picture[:size, :size])
    times = []
    for _ in range(12):
        start = time.process_time()
        network(crop)
        times.append(1e3 * (time.process_time() - start))
    return float(np.median(times[2:]))


def _presence_alone(finder: PoseFinder, frames: dict[int, Picture], boxes: Sequence[Annotated]) -> dict[str, float]:
    kept = [(b.person, _present(finder.find(frames[b.frame], b.region()))) for b in boxes]
    people = [k for person, k in kept if person]
    return {"recall": float(np.mean(people)), "false_positives": float(sum(k for person, k in kept if not person))}


def _present(pose: Pose) -> bool:
    return pose.presence > 0.5


BENCHMARK = Benchmark("people-pose", "pose and Human Pose Filter on annotated people and things of a real video", run)
