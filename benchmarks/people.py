"""The search for people over four simulated flights, scored as the paper scored its four recorded ones.

The pipeline is the node's own, without the bus. Its clock is a model of one core that only the pose network advances,
by what a look takes there: how often it looks does not depend on the machine that runs the benchmark.
"""

from __future__ import annotations

import importlib.metadata
import os
import sys
import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from dataclasses import dataclass, field
from multiprocessing import get_context
from multiprocessing.sharedctypes import SynchronizedArray

import cv2
import msgspec
import numpy as np

from benchmarks.base import Benchmark, Outcome, Settings
from benchmarks.people_flights import FLIGHTS, Flight
from benchmarks.people_score import Claim, Score, figures
from benchmarks.people_sensor import COLOUR, DEPTH, Shot, shots
from onboard.people.findings import Frame
from onboard.people.pipeline import PeoplePipeline
from onboard.people.pipeline_config import PeopleConfig
from onboard.people.pose import Picture
from onboard.people.pose_file import blazepose_file
from onboard.people.pose_network import PoseNetwork, blazepose
from onboard.people.sights import VehiclePose
from simulation.world.people_truth import SeenPerson

PAPER = {
    "seq1_fn_rate": 0.0, "seq1_fp_rate": 0.0, "seq1_id_switches": 0.0, "seq1_mota": 1.0,
    "seq2_fn_rate": 0.292, "seq2_fp_rate": 0.0, "seq2_id_switches": 0.0, "seq2_mota": 0.708,
    "seq3_fn_rate": 0.25, "seq3_fp_rate": 0.0, "seq3_id_switches": 1.0, "seq3_mota": 0.667,
    "seq4_fn_rate": 0.858, "seq4_fp_rate": 0.0, "seq4_id_switches": 1.0, "seq4_mota": 0.137,
    "fn_rate": 0.265, "fp_rate": 0.0, "id_switches": 2.0, "mota": 0.733, "worst_mota": 0.137,
}  # fmt: skip
"""Al-Kaff 2019, Table 2."""
_LOOK_S = 0.022
"""What one pass of the pose network takes on one core of a desk machine, s (docs/people.md)."""
BUDGET_SHARE = 0.8
"""Share of a picture's period that poses may take."""
_POLL_S = 2.0


@dataclass(frozen=True)
class Seen:
    """One picture of one flight: the truth, and what the search said."""

    people: list[SeenPerson]
    claims: list[Claim]


@dataclass
class Flown:
    """What came of one flight."""

    flight: Flight
    pictures: list[Seen] = field(default_factory=list)
    took_s: float = 0.0


class ModelClock:
    """Seconds that pass only while the network looks."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        """Seconds."""
        return self.now_s


class TimedNetwork(PoseNetwork):
    """The network, on a core where each look takes as long as on the model's."""

    def __init__(self, clock: ModelClock):
        super().__init__(blazepose(blazepose_file()))
        self._clock = clock

    def __call__(self, crop: Picture) -> tuple[np.ndarray, np.ndarray, float]:
        """As the network, and the clock goes on."""
        self._clock.now_s += _LOOK_S
        return super().__call__(crop)


def pipeline(rate_hz: float) -> PeoplePipeline:
    """The node's search for people, for pictures of a rate, Hz."""
    config, clock = PeopleConfig(), ModelClock()
    watch = msgspec.structs.replace(config.watch, budget_ms=1e3 * BUDGET_SHARE / rate_hz)
    config = msgspec.structs.replace(config, watch=watch)
    return PeoplePipeline(config, COLOUR, DEPTH.camera, TimedNetwork(clock), clock=clock)


def claims_of(search: PeoplePipeline, shot: Shot) -> list[Claim]:
    """Who the search says is where in a picture: people it believes in, as the paper counts them."""
    vehicle = VehiclePose(shot.ned_p_m, shot.ned_q_body)
    found = search.look(Frame(shot.picture, shot.t_ns, shot.depth_mm, shot.t_ns, vehicle)).people
    believed = {track.number for track in search.tracks if track.confirmed}
    return [Claim(f.number, f.box_px) for f in found if f.number in believed]


_shares: SynchronizedArray[float] | None = None


def _share_progress(shares: SynchronizedArray[float]) -> None:
    global _shares  # noqa: PLW0603 the only way to hand an array to the workers of a pool
    _shares = shares


def fly(number: int, seed: int, quick: bool) -> Flown:
    """Fly one; runs in a process of its own."""
    cv2.setNumThreads(1)
    flight = FLIGHTS[number - 1]
    rate_hz, frames = flight.pictures(quick)
    take = flight.make(np.random.default_rng((seed, number, 17)), 100 * seed + number)
    search, flown, started = pipeline(rate_hz), Flown(flight), time.perf_counter()
    for index, shot in enumerate(shots(take, rate_hz, frames, 100 * seed + number)):
        flown.pictures.append(Seen(shot.people, claims_of(search, shot)))
        if _shares is not None:
            _shares[number - 1] = (index + 1) / frames
    flown.took_s = time.perf_counter() - started
    return flown


def run(settings: Settings) -> Outcome:
    """Fly all four, as many at a time as there are cores, and score them."""
    flown = sorted(_fly_all(settings), key=lambda f: f.flight.number)
    scores: dict[str, Score] = {}
    for one in flown:
        score = scores[f"seq{one.flight.number}"] = Score()
        for seen in one.pictures:
            score.add(seen.people, seen.claims)
    counts = Counter({f"seq{f.flight.number}_pictures": len(f.pictures) for f in flown})
    results = figures(scores) | {name: float(value) for name, value in counts.items()}
    scorer = f"the paper's Table 2, recorded flights; scored by motmetrics {importlib.metadata.version('motmetrics')}"
    return Outcome(results, {"name": scorer, "mota": PAPER["mota"]}, PAPER)


def _fly_all(settings: Settings) -> list[Flown]:
    for name in ("LP_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ[name] = "1"  # Mesa and BLAS take every core otherwise, in every process
    context = get_context("spawn")
    wanted = sorted(FLIGHTS, key=lambda f: -f.pictures(settings.quick)[1])
    shares = context.Array("d", len(FLIGHTS))
    with ProcessPoolExecutor(os.cpu_count(), context, _share_progress, (shares,)) as pool:
        futures = {pool.submit(fly, f.number, settings.seed, settings.quick): f for f in wanted}
        waiting = set(futures)
        while waiting:
            done, waiting = wait(waiting, _POLL_S, FIRST_COMPLETED)
            _report(shares, settings.quick, [futures[f] for f in done])
        return [future.result() for future in futures]


def _report(shares: SynchronizedArray[float], quick: bool, done: Sequence[Flight]) -> None:
    """A bar on a terminal, a line for each flight that is done elsewhere."""
    frames = np.array([f.pictures(quick)[1] for f in FLIGHTS], float)
    share = float(frames @ np.array(shares[:]) / frames.sum())
    if sys.stderr.isatty():
        print(f"\r[{'#' * round(40 * share):40}] {share:4.0%}", end="", file=sys.stderr, flush=True)
    for flight in done:
        print(f"\r{share:4.0%} flown: sequence {flight.number}", file=sys.stderr, flush=True)


BENCHMARK = Benchmark("people", "people found and kept apart over four flights, as the paper's Table 2", run)
