"""Who is who without depth: the search on boxes as loose as a detector's, beside association by motion alone.

Two of the simulated flights of `outrider bench people`, without their depth. In place of a detector stand the true
boxes, as a detector gives them: every side off, some missing, some twice. What it says about identities is therefore no
matter of the detector; `people-video` has a real one.
"""

from __future__ import annotations

import importlib.metadata
from collections.abc import Sequence

import cv2
import msgspec
import numpy as np

from benchmarks.base import Benchmark, Outcome, Settings
from benchmarks.people import BUDGET_SHARE, ModelClock, TimedNetwork
from benchmarks.people_flights import FLIGHTS
from benchmarks.people_score import Claim, Score, figures
from benchmarks.people_sensor import COLOUR, shots
from onboard.people.association import assign
from onboard.people.detector import PersonDetector
from onboard.people.findings import Frame
from onboard.people.pipeline import PeoplePipeline
from onboard.people.pipeline_config import PeopleConfig
from onboard.people.pose import Picture
from onboard.people.regions import Region
from onboard.people.watch import iou
from simulation.world.people_truth import SeenPerson

_FLIGHTS = (1, 4)
"""Those whose people lie and sit: from above, without depth, the filter does not know who stands."""
_FRAMES, _QUICK_FRAMES = {1: 221, 4: 320}, {1: 60, 4: 110}
_SIDE_SIGMA, _MISSED, _TWICE = 0.08, 0.15, 0.1
"""Standard deviation of each side, as a share of the box's; share of boxes that are missing; of those given twice."""
_LEAST_BODY = 0.3
_KEPT_S, _LEAST_IOU, _NEWEST = 1.0, 0.3, 0.5
Box = tuple[int, int, int, int]


class LooseBoxes(PersonDetector):
    """Stands for a detector: true boxes, off, missing or twice.

    Args:
        rng: what happens to each.
    """

    def __init__(self, rng: np.random.Generator):
        self._rng = rng
        self.people: Sequence[SeenPerson] = ()
        """Who is seen in the next picture, truly."""

    def find(self, picture: Picture) -> list[Region]:
        """Boxes of a picture (H, W, 3)."""
        found = []
        for person in self.people:
            if person.body < _LEAST_BODY:
                continue
            for _ in range(1 + (self._rng.random() < _TWICE)):
                box = self._loose(person.box_px, picture.shape)
                if self._rng.random() >= _MISSED and min(box[2:]) > 8:
                    found.append(Region(box, np.ones((box[3], box[2]), bool), None, None, None, None))
        return found

    def _loose(self, box: Box, shape: tuple[int, ...]) -> Box:
        sides = np.array([box[0], box[1], box[0] + box[2], box[1] + box[3]], float)
        sides += self._rng.normal(0.0, _SIDE_SIGMA, 4) * np.tile(box[2:], 2)
        left, top, right, bottom = np.clip(np.round(sides), 0, np.tile((shape[1], shape[0]), 2)).astype(int)
        return int(left), int(top), int(right - left), int(bottom - top)


class Motion:
    """Numbers by IoU with where each box would be at its speed of late (SORT); after a second away it is forgotten."""

    def __init__(self) -> None:
        self._known: list[tuple[int, Box, np.ndarray, float]] = []
        self._next = 1

    def numbers(self, boxes: Sequence[Box], t_s: float) -> list[int]:
        """Number of each box of a picture at a time, s."""
        self._known = [known for known in self._known if t_s - known[3] <= _KEPT_S]
        costs = np.array([[1.0 - iou(_moved(known, t_s), box) for box in boxes] for known in self._known])
        rows = {column: row for row, column in assign(costs, 1.0 - _LEAST_IOU)}
        given = []
        for column, box in enumerate(boxes):
            row = rows.get(column)
            if row is None:
                self._known.append((self._next, box, np.zeros(2), t_s))
                self._next += 1
                given.append(self._known[-1][0])
                continue
            number, before, way, then_s = self._known[row]
            now = (_middle(box) - _middle(before)) / (t_s - then_s)
            self._known[row] = number, box, way + _NEWEST * (now - way), t_s
            given.append(number)
        return given


def _moved(known: tuple[int, Box, np.ndarray, float], t_s: float) -> tuple[float, float, float, float]:
    _, (x, y, width, height), way, then_s = known
    dx, dy = way * (t_s - then_s)
    return x + dx, y + dy, width, height


def _middle(box: Box) -> np.ndarray:
    return np.array([box[0] + 0.5 * box[2], box[1] + 0.5 * box[3]])


def run(settings: Settings) -> Outcome:
    """Both flights; motion alone gets the boxes in which the search found somebody."""
    cv2.setNumThreads(1)
    ours: dict[str, Score] = {}
    motion: dict[str, Score] = {}
    for number in _FLIGHTS:
        ours[f"seq{number}"], motion[f"seq{number}"] = _fly(number, settings)
    mine, theirs = figures(ours), figures(motion)
    kept = ("id_switches", "idf1", "people_boxes")
    results = {name: value for name, value in mine.items() if name.endswith(kept)}
    results |= {f"motion_{name}": value for name, value in theirs.items() if name.endswith(kept[:2])}
    scorer = f"motion-only SORT, scored by motmetrics {importlib.metadata.version('motmetrics')}"
    return Outcome(results, {"name": scorer, "idf1": theirs["idf1"]})


def _fly(number: int, settings: Settings) -> tuple[Score, Score]:
    flight, seed = FLIGHTS[number - 1], 100 * settings.seed + number
    take = flight.make(np.random.default_rng((settings.seed, number, 17)), seed)
    frames = (_QUICK_FRAMES if settings.quick else _FRAMES)[number]
    clock, detector = ModelClock(), LooseBoxes(np.random.default_rng((settings.seed, number, 5)))
    config = PeopleConfig(use_depth=False)
    watch = msgspec.structs.replace(config.watch, budget_ms=1e3 * BUDGET_SHARE / flight.rate_hz)
    config = msgspec.structs.replace(config, watch=watch)
    search = PeoplePipeline(config, COLOUR, None, TimedNetwork(clock), detector, clock)
    ours, theirs, motion = Score(), Score(), Motion()
    for shot in shots(take, flight.rate_hz, frames, seed):
        detector.people = shot.people
        found = search.look(Frame(shot.picture, shot.t_ns)).people
        boxes = [f.sight.region.box_px for f in found]
        believed = {track.number for track in search.tracks if track.confirmed}
        ours.add(shot.people, [Claim(f.number, f.box_px) for f in found if f.number in believed])
        numbers = motion.numbers(boxes, shot.t_ns / 1e9)
        theirs.add(shot.people, [Claim(n, box) for n, box in zip(numbers, boxes, strict=True)])
    return ours, theirs


BENCHMARK = Benchmark("people-boxes", "who is who without depth, on loose boxes, beside motion-only association", run)
