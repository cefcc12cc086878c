"""Stabilisation and chase as the paper measured them, in both output forms, and the same chase with CamShift.

Each flight is an episode: the real algorithms, world, helm rules and autopilot in one process. What counts is defined
in `benchmarks.pursuit_count`, the scenes in `benchmarks.pursuit_road`.
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from multiprocessing import get_context
from multiprocessing.sharedctypes import SynchronizedArray
from typing import NamedTuple

import cv2
import numpy as np

from benchmarks.base import Benchmark, Outcome, Settings
from benchmarks.camshift import CamShiftTracker
from benchmarks.episode import Episode
from benchmarks.pursuit_count import Array, chase_figures, still_figures
from benchmarks.pursuit_plots import draw
from benchmarks.pursuit_road import chase_scenario, still_scenario
from benchmarks.pursuit_strips import Album, Strips, draw_strips
from common.processes import load_config

_CHASE_FRAMES, _QUICK_CHASE_FRAMES = 10_000, 1_200
_STILL_S, _QUICK_STILL_S = 60.0, 30.0
_RATE_HZ = 20.0
_WIND_M_S, _GUSTS_M_S, _ATTITUDE_NOISE_RAD = 1.0, 0.4, math.radians(0.5)
_STILL_HEIGHT_M = 1.9
_CHASE_HEIGHT_M, _HEIGHT_SWING_M, _HEIGHT_PERIOD_S = 3.0, 1.0, 40.0
_PAPER = {"stabilise_max_error_m": 0.10, "stabilise_max_yaw_deg": 3.0, "chase_max_error_m": 0.30}
_PREFIX = {"velocity": "", "orientation": "attitude_"}
_LOOK_S = 0.5


class Flight(NamedTuple):
    """One flight to fly."""

    scene: str
    """`still` or `chase`."""
    form: str
    """`pursuit.output`."""
    tracker: str
    """`particle filter` or `CamShift`."""
    seed: int
    duration_s: float
    pictures: bool = False
    """Whether to keep pictures of its events."""

    def __str__(self) -> str:
        return f"{self.scene}, {self.form} form, {self.tracker}"


class Flown(NamedTuple):
    """What came of it."""

    flight: Flight
    columns: dict[str, Array]
    strips: Strips

    def figures(self) -> dict[str, float]:
        """Its figures by name."""
        return still_figures(self.columns) if self.flight.scene == "still" else chase_figures(self.columns)


_shares: SynchronizedArray[float] | None = None


def _share_progress(shares: SynchronizedArray[float]) -> None:
    global _shares  # noqa: PLW0603 the only way to hand an array to the workers of a pool
    _shares = shares


def fly(flight: Flight, index: int) -> Flown:
    """Fly one; runs in a process of its own."""
    cv2.setNumThreads(1)
    direction_rad = float(np.random.default_rng((flight.seed, 413)).uniform(-math.pi, math.pi))
    wind = [_WIND_M_S * math.cos(direction_rad), _WIND_M_S * math.sin(direction_rad), 0.0]
    overrides = [
        f"pursuit.output={flight.form}",
        f"autopilot.attitude_noise_rad={_ATTITUDE_NOISE_RAD:.5f}",
        f"autopilot.wind_ned_m_s={wind}",
        f"autopilot.gust_std_m_s={_GUSTS_M_S}",
    ]
    still = flight.scene == "still"
    scenario = still_scenario(flight.seed) if still else chase_scenario(flight.seed)
    course, top_m = (_still_height_m, _STILL_HEIGHT_M) if still else (_height_m, _CHASE_HEIGHT_M + _HEIGHT_SWING_M)
    episode = Episode(load_config("kite", overrides), scenario, flight.seed, course, top_m)
    if flight.tracker == "CamShift":
        episode.use(CamShiftTracker)

    album = Album()
    if flight.pictures:
        episode.watch = album.take

    def note(share: float) -> None:
        if _shares is not None:
            _shares[index] = min(share, 1.0)

    episode.fly(flight.duration_s, note)
    trace = episode.trace
    columns = {name: trace.column(name).astype(float) for name in trace.rows[0]}
    return Flown(flight, columns, album.strips(columns) if flight.pictures else {})


def _still_height_m(_t_s: float) -> float:
    return _STILL_HEIGHT_M


def _height_m(t_s: float) -> float:
    """Height of the chase, m: from 3 up to 4, down to 2, and so on."""
    return _CHASE_HEIGHT_M + _HEIGHT_SWING_M * math.sin(2.0 * math.pi * t_s / _HEIGHT_PERIOD_S)


def flights(settings: Settings) -> list[Flight]:
    """What is flown; the long ones first."""
    frames = _QUICK_CHASE_FRAMES if settings.quick else _CHASE_FRAMES
    chase_s, still_s = frames / _RATE_HZ, _QUICK_STILL_S if settings.quick else _STILL_S
    seed = 1000 * (settings.seed + 1)
    return [
        Flight("chase", "velocity", "particle filter", seed, chase_s, settings.plots is not None),
        Flight("chase", "orientation", "particle filter", seed, chase_s, settings.plots is not None),
        Flight("chase", "velocity", "CamShift", seed, chase_s),
        Flight("still", "velocity", "particle filter", seed, still_s),
        Flight("still", "orientation", "particle filter", seed, still_s),
    ]


def run(settings: Settings) -> Outcome:
    """Fly them all, as many at a time as there are cores."""
    flown = _fly_all(flights(settings))
    results: dict[str, float] = {}
    for form, prefix in _PREFIX.items():
        for one in flown:
            if one.flight.form == form and one.flight.tracker != "CamShift":
                results |= {prefix + name: value for name, value in one.figures().items()}
    plain = next(f for f in flown if f.flight.tracker == "CamShift").figures()
    ratio = plain["chase_rms_error_m"] / results["chase_rms_error_m"]
    baseline = {"name": f"CamShift of OpenCV {cv2.__version__}, velocity form, the same chase", **plain}
    if settings.plots is not None:
        draw(
            [(f.flight.scene, f.flight.form, f.columns) for f in flown if f.flight.tracker != "CamShift"],
            settings.plots,
        )
        draw_strips([f.strips for f in flown], flown[0].flight.seed, settings.plots)
    paper = {prefix + name: value for prefix in _PREFIX.values() for name, value in _PAPER.items()}
    return Outcome(results, {**baseline, "ratio_rms_error": ratio}, paper)


def _fly_all(wanted: Sequence[Flight]) -> list[Flown]:
    os.environ["LP_NUM_THREADS"] = "1"  # Mesa takes every core for every renderer otherwise
    context = get_context("spawn")
    shares = context.Array("d", len(wanted))
    with ProcessPoolExecutor(os.cpu_count(), context, _share_progress, (shares,)) as pool:
        futures = {pool.submit(fly, flight, index): flight for index, flight in enumerate(wanted)}
        waiting = set(futures)
        while waiting:
            done, waiting = wait(waiting, _LOOK_S, FIRST_COMPLETED)
            _report(shares, wanted, [futures[f] for f in done])
        return [future.result() for future in futures]


def _report(shares: SynchronizedArray[float], wanted: Sequence[Flight], done: Sequence[Flight]) -> None:
    """A bar on a terminal, a line for each flight that is done elsewhere."""
    share = sum(f.duration_s * s for f, s in zip(wanted, shares[:], strict=True)) / sum(f.duration_s for f in wanted)
    if sys.stderr.isatty():
        print(f"\r[{'#' * round(40 * share):40}] {share:4.0%}", end="", file=sys.stderr, flush=True)
    for flight in done:
        print(f"\r{share:4.0%} flown: {flight}", file=sys.stderr, flush=True)


BENCHMARK = Benchmark("pursuit", "stabilisation and chase as the paper measured them, in both output forms", run)
