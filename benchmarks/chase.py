"""How well the chase holds over roads, colours and faults that the seed draws, with CamShift on the same flights.

Every flight is an episode: the real algorithms, world, helm rules and autopilot in one process. The demonstration's
own road is not among them, so nothing can be tuned to what is measured here.
"""

from __future__ import annotations

import colorsys
import math
import os
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from typing import NamedTuple

import cv2
import msgspec
import numpy as np

from benchmarks.base import Benchmark, Outcome, Settings
from benchmarks.camshift import CamShiftTracker
from benchmarks.episode import Episode
from common.config import ConfigError
from common.processes import load_config
from simulation.demo.report import Criteria
from simulation.world.path_config import PathConfig, WaypointConfig
from simulation.world.scenario import (
    OccluderConfig,
    ScenarioConfig,
    load_scenario,
)

_FLIGHTS, _FLIGHT_S = 5, 120.0
_QUICK_FLIGHTS, _QUICK_FLIGHT_S = 2, 40.0
_CORNERS, _REACH_M = 9, 14.0
_START = (1.4, 0.0)
_OURS, _PLAIN = "particle filter", "CamShift"


class Flight(NamedTuple):
    """One flight to fly."""

    seed: int
    tracker: str
    duration_s: float


class Flown(NamedTuple):
    """What came of it."""

    flight: Flight
    summary: dict[str, float]
    held: bool


def drawn(base: ScenarioConfig, seed: int) -> ScenarioConfig:
    """The base scenario with another road, another car and the bridge elsewhere."""
    rng = np.random.default_rng((seed, 77))
    path = _road(rng)
    car = msgspec.structs.replace(base.car, path=path, **paint(rng))
    return msgspec.structs.replace(base, seed=seed, car=car, occluders=(_bridge(path, rng),))


def _road(rng: np.random.Generator) -> PathConfig:
    """A closed road that passes beside home on a straight, with turns, stops and changing speeds."""
    while True:
        heading = float(rng.uniform(-math.pi, math.pi))
        points, arrival = [_START], _ahead(_START, heading, -3.0)
        while len(points) < _CORNERS:
            turned = heading + (rng.uniform(-1.8, 1.8) if len(points) > 1 else 0.0)
            corner = _ahead(points[-1], turned, rng.uniform(3.0, 9.0))
            inside = max(map(abs, corner)) < _REACH_M
            if inside:
                points.append(corner)
            heading = turned if inside else heading + rng.uniform(1.0, 2.0)
        waypoints = tuple(
            WaypointConfig(
                north_m=north,
                east_m=east,
                speed_m_s=float(rng.uniform(0.7, 1.5)),
                stop_s=float(rng.choice([0.0, 0.0, 0.0, 3.0])),
            )
            for north, east in [*points, arrival]
        )
        path = PathConfig(waypoints=waypoints, turn_radius_m=float(rng.uniform(1.0, 2.5)), start_delay_s=3.0)
        try:
            path.check()
        except ConfigError:
            continue  # two corners in one place, or a turn on the spot
        return path


def _ahead(point: tuple[float, float], heading_rad: float, by_m: float) -> tuple[float, float]:
    return point[0] + by_m * math.cos(heading_rad), point[1] + by_m * math.sin(heading_rad)


def paint(rng: np.random.Generator) -> dict[str, str]:
    """Colours of the car's parts: two strong ones, a light roof, a stripe."""
    hue = float(rng.uniform())
    parts = {"bonnet": (hue, 0.85), "boot": (hue + rng.uniform(0.25, 0.75), 0.8), "stripe": (rng.uniform(), 0.9)}
    colours = {name: _colour(h % 1.0, s, float(rng.uniform(0.6, 0.9))) for name, (h, s) in parts.items()}
    return {**colours, "roof": _colour(0.0, 0.0, float(rng.uniform(0.75, 0.95)))}


def _colour(hue: float, saturation: float, value: float) -> str:
    return "#" + "".join(f"{round(255 * c):02x}" for c in colorsys.hsv_to_rgb(hue, saturation, value))


def _bridge(path: PathConfig, rng: np.random.Generator) -> OccluderConfig:
    """A footbridge across the middle of the longest leg."""
    points = [(w.north_m, w.east_m) for w in path.waypoints]
    legs = list(zip(points, [*points[1:], points[0]], strict=True))[1:]  # not where the car is chosen
    a, b = max(legs, key=lambda leg: math.dist(*leg))
    along_deg = math.degrees(math.atan2(b[1] - a[1], b[0] - a[0]))
    return OccluderConfig(
        kind="bridge",
        north_m=(a[0] + b[0]) / 2,
        east_m=(a[1] + b[1]) / 2,
        heading_deg=along_deg + 90.0,
        span_m=4.6,
        width_m=float(rng.uniform(0.8, 1.3)),
        height_m=1.3,
    )


def fly(flight: Flight) -> Flown:
    """Fly one; runs in a process of its own."""
    cv2.setNumThreads(1)
    episode = Episode(load_config("kite", ()), drawn(load_scenario("chase"), flight.seed), flight.seed)
    if flight.tracker == _PLAIN:
        episode.use(CamShiftTracker)
    recorder = episode.fly(flight.duration_s)
    return Flown(flight, recorder.summary(), not recorder.faults(Criteria()))


def run(settings: Settings) -> Outcome:
    """Fly all seeds with both trackers."""
    count, duration_s = (_QUICK_FLIGHTS, _QUICK_FLIGHT_S) if settings.quick else (_FLIGHTS, _FLIGHT_S)
    seeds = [1000 * (settings.seed + 1) + i for i in range(count)]
    flights = [Flight(seed, tracker, duration_s) for tracker in (_OURS, _PLAIN) for seed in seeds]
    flown = _fly_all(flights)
    ours = [f for f in flown if f.flight.tracker == _OURS]
    plain = [f for f in flown if f.flight.tracker == _PLAIN]
    results = {"flights": float(count), "flight_s": duration_s, **_figures(ours)}
    theirs = _figures(plain)
    ratio = theirs["chase_rms_error_m_median"] / results["chase_rms_error_m_median"]
    baseline = {"name": f"CamShift of OpenCV {cv2.__version__}, the same flights", **theirs, "ratio_rms_error": ratio}
    return Outcome(results, baseline)


def _fly_all(flights: Sequence[Flight]) -> list[Flown]:
    """All flights, a process for each core; says when each is done."""
    flown: list[Flown] = []
    os.environ["LP_NUM_THREADS"] = "1"  # Mesa takes every core for every renderer otherwise
    with ProcessPoolExecutor(os.cpu_count(), mp_context=get_context("spawn")) as pool:
        for done in as_completed([pool.submit(fly, flight) for flight in flights]):
            flown.append(done.result())
            _report(flown[-1], len(flown), len(flights))
    return sorted(flown, key=lambda f: flights.index(f.flight))


def _report(flown: Flown, done: int, total: int) -> None:
    flight, s = flown.flight, flown.summary
    bar = f"[{'#' * done:{total}}] " if sys.stderr.isatty() else ""
    print(
        f"{bar}flight {done} of {total}: seed {flight.seed}, {flight.tracker}: rms {s['chase_rms_error_m']:.2f} m, "
        f"longest loss {s['longest_loss_s']:.1f} s, {'held' if flown.held else 'not held'}",
        file=sys.stderr,
        flush=True,
    )


def _figures(flown: Sequence[Flown]) -> dict[str, float]:
    """Median and worst over the flights."""
    figures = {"held_fraction": float(np.mean([f.held for f in flown]))}
    for name in ("chase_rms_error_m", "chase_p95_error_m", "chase_max_error_m", "longest_loss_s"):
        values = [f.summary[name] for f in flown]
        figures[f"{name}_median"], figures[f"{name}_worst"] = float(np.median(values)), float(max(values))
    figures["losses_median"] = float(np.median([f.summary["losses"] for f in flown]))
    return figures


BENCHMARK = Benchmark("chase", "the chase on roads and in colours drawn by the seed, with CamShift beside it", run)
