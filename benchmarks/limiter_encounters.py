"""Random encounters by the thousand: does the limiter ever come too near where that could be helped, and does it ever
stop, or slow down, for nothing?"""

from __future__ import annotations

import multiprocessing
import os
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed

import numpy as np

from benchmarks.base import Benchmark, Outcome, Settings
from benchmarks.encounter_scene import draw
from benchmarks.encounters import fly
from onboard.limiter.config import LimiterConfig

_ENCOUNTERS, _QUICK = 100_000, 5_000
_CHUNK = 500
_STRATEGIES = ("proposed", "tti", "dpf")
_STOOD_S = 1.0

Counts = dict[str, float]


def run(settings: Settings) -> Outcome:
    """Fly all encounters, strategies in turn, on every core."""
    total = _QUICK if settings.quick else _ENCOUNTERS
    chunks = [(settings.seed, index, _CHUNK) for index in range(total // _CHUNK)]
    sums: Counts = {}
    slowdowns: list[np.ndarray] = []
    printed: Counts = {}
    for done, (counts, slowed, alone) in enumerate(_each(chunks), start=1):
        for name, value in counts.items():
            sums[name] = sums.get(name, 0.0) + value
        for name, value in alone.items():
            printed[name] = printed.get(name, 0.0) + value
        slowdowns.append(slowed)
        _show(done, len(chunks))
    clear = max(sums["clear"], 1.0)
    results = {
        "encounters": sums["encounters"],
        "breaches_feasible": sums["breaches_feasible"],
        "breaches_infeasible": sums["breaches_infeasible"],
        "breaches_unshown": sums["breaches_unshown"],
        "breaches_between_pictures": sums["breaches_between_pictures"],
        "infeasible_fraction": sums["infeasible"] / sums["encounters"],
        "needless_stop_fraction": sums["needless_stops"] / clear,
        "median_slowdown": float(np.median(np.concatenate(slowdowns))),
        "conflict_fraction": sums["conflicts"] / sums["encounters"],
        "clear_fraction": sums["clear"] / sums["encounters"],
        "walkers_fraction": sums["walkers"] / sums["encounters"],
        **{f"breaches_feasible_{s}": sums[f"breaches_feasible_{s}"] for s in _STRATEGIES},
    }
    share = printed["breaches_feasible"] / printed["encounters"]
    baseline = {
        "name": "the curve alone, without bound, foresight and retreat, on one encounter in ten",
        "breaches_feasible_per_1000": 1e3 * share,
        "encounters": printed["encounters"],
        "ratio": (sums["breaches_feasible"] / sums["encounters"]) / share if share else float("nan"),
    }
    return Outcome(results, baseline)


def chunk(seed: int, index: int, count: int) -> tuple[Counts, np.ndarray, Counts]:
    """Counts of some encounters; the slowdown of each without a conflict; and counts of the curve alone.

    Args:
        seed: of the run.
        index: of the chunk; it chooses the strategy.
        count: encounters.
    """
    strategy = _STRATEGIES[index % len(_STRATEGIES)]
    counts, slowed = _flown(LimiterConfig(strategy=strategy), np.random.default_rng([seed, index]), count)
    counts |= {f"breaches_feasible_{s}": counts["breaches_feasible"] if s == strategy else 0.0 for s in _STRATEGIES}
    curve = LimiterConfig(
        strategy=strategy, stop_delay_s=0.0, stop_deceleration_m_s2=1e6, foresight_s=0.0, push_back_m_s=0.0
    )
    alone, _ = _flown(curve, np.random.default_rng([seed, index]), count // 10)
    return counts, slowed, alone


def _flown(config: LimiterConfig, rng: np.random.Generator, count: int) -> tuple[Counts, np.ndarray]:
    scene = draw(rng, count)
    ends = fly(scene, config, rng)
    # Breach: nearer than h_min. Infeasible: the oracle that braked fully, knowing the truth, came nearer as well.
    breach, infeasible = ends.nearest_m < config.h_min_m, ends.oracle_m < config.h_min_m
    missed = breach & ~infeasible
    feasible = missed.any(axis=1)
    # No conflict: without any limiter nothing would have come nearer than the beginning of the warning zone.
    clear = ends.ghost_m >= config.h_mid_m
    counts: Counts = {
        "encounters": count,
        "breaches_feasible": int(feasible.sum()),
        "breaches_infeasible": int((breach.any(axis=1) & ~feasible).sum()),
        "breaches_unshown": int((missed & (ends.unshown_m < config.h_min_m)).any(axis=1).sum()),
        "breaches_between_pictures": int((breach & ends.between).any(axis=1).sum()),
        "infeasible": int(infeasible.any(axis=1).sum()),
        "conflicts": int((ends.ghost_m < config.h_desired_m).sum()),
        "clear": int(clear.sum()),
        "needless_stops": int((ends.stood_s[clear] > _STOOD_S).sum()),
        "walkers": int(np.any(scene.velocities != 0.0, axis=(1, 2)).sum()),
    }
    return counts, 1.0 - ends.progress[clear]


def _each(chunks: list[tuple[int, int, int]]) -> Iterator[tuple[Counts, np.ndarray, Counts]]:
    workers = min(os.cpu_count() or 1, 8)
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        for future in as_completed([pool.submit(chunk, *c) for c in chunks]):
            yield future.result()


def _show(done: int, total: int) -> None:
    """A bar on a terminal, a line for each tenth elsewhere."""
    if sys.stderr.isatty():
        bar = "#" * (40 * done // total)
        print(
            f"\r  [{bar:40}] {done * _CHUNK} encounters", end="\n" if done == total else "", file=sys.stderr, flush=True
        )
    elif done % max(total // 10, 1) == 0:
        print(f"  {done * _CHUNK} of {total * _CHUNK} encounters", file=sys.stderr, flush=True)


BENCHMARK = Benchmark("limiter-encounters", "random encounters: breaches that could be helped, and needless stops", run)
