"""How long one call of the limiter takes, beside alternating projections over the same half-spaces."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

import numpy as np

from benchmarks.base import Benchmark, Outcome, Settings
from common.messages import Vec3
from onboard.limiter.config import LimiterConfig
from onboard.limiter.constraints import Motion, obstacle_rows
from onboard.limiter.limiter import bounded, limit
from onboard.limiter.surroundings import Surroundings

T = TypeVar("T")
_CALLS, _QUICK_CALLS, _WARM_UP = 4000, 1000, 50
_POINTS = (1, 32, 1081)
_BASELINE_EVERY = 20
_SWEEPS, _SETTLED_M_S = 60, 1e-7


def run(settings: Settings) -> Outcome:
    """Time calls with 1, 32 and 1,081 points: a wall, posts in front of it, and a point that walks."""
    rng = np.random.default_rng(settings.seed)
    config = LimiterConfig()
    results: dict[str, float] = {}
    baseline: dict[str, float] = {}
    for points in _POINTS:
        ours: list[float] = []
        swept: list[float] = []
        differences: list[float] = []
        for index in range((_QUICK_CALLS if settings.quick else _CALLS) + _WARM_UP):
            around = _around(rng, points)
            asked = _drawn(rng, (0.5, -1.0, -0.3), (2.5, 1.0, 0.3))
            flown = _drawn(rng, (0.0, -0.5, -0.2), (2.0, 0.5, 0.2))
            took, limited = _timed(lambda: limit(asked, around, config, ned_vehicle_v_m_s=flown, dt_s=0.02))  # noqa: B023
            if index < _WARM_UP:
                continue
            ours.append(took)
            if index % _BASELINE_EVERY == 0:
                motion = Motion(*(np.array(v) for v in (asked, asked, flown, (0.0, 0.0, 0.0))))
                took, v = _timed(lambda: alternating(around, motion, config))  # noqa: B023
                swept.append(took)
                differences.append(float(np.abs(np.array(limited.ned_v_m_s) - v).max()))
        results[f"call_us_median_{points}"] = float(np.median(ours))
        results[f"call_us_p99_{points}"] = float(np.quantile(ours, 0.99))
        baseline[f"call_us_median_{points}"] = float(np.median(swept))
        results[f"difference_m_s_{points}"] = float(np.quantile(differences, 0.9))
    ratio = baseline[f"call_us_median_{_POINTS[-1]}"] / results[f"call_us_median_{_POINTS[-1]}"]
    name = f"Dykstra's alternating projections, NumPy {np.__version__}, {_SWEEPS} sweeps at most"
    return Outcome(results, {"name": name, **baseline, "ratio": ratio})


def alternating(around: Surroundings, motion: Motion, config: LimiterConfig) -> np.ndarray:
    """The same half-spaces, bounds not negative, by Dykstra's projections (DOI 10.1080/01621459.1983.10477029)."""
    rows = obstacle_rows(around.distance_m, around.ned_direction, around.ned_v_m_s, motion, config)
    _, rows = bounded(motion.asked, rows, config)
    bounds = np.maximum(rows.bounds_m_s, 0.0)
    v, kept = motion.asked.copy(), np.zeros(len(bounds))
    for _ in range(_SWEEPS):
        moved = 0.0
        for k, (n, bound) in enumerate(zip(rows.normals, bounds, strict=True)):
            excess = max(float(n @ v) + kept[k] - bound, 0.0)
            if change := kept[k] - excess:
                v = v + change * n
                kept[k] = excess
                moved = max(moved, abs(change))
        if moved < _SETTLED_M_S:
            break
    return v


def _around(rng: np.random.Generator, points: int) -> Surroundings:
    north = np.where(rng.random(points) < 0.3, rng.uniform(1.6, 4.0, points), 4.0)
    place = np.stack([north, rng.uniform(-4.0, 4.0, points), rng.uniform(-2.0, 2.0, points)], axis=1)
    distance = np.linalg.norm(place, axis=1)
    v = np.zeros((points, 3))
    v[0] = (-0.8, 0.4, 0.0)
    return Surroundings(distance, place / distance[:, None], v)


def _drawn(rng: np.random.Generator, low: Vec3, high: Vec3) -> Vec3:
    x, y, z = rng.uniform(low, high).tolist()
    return (x, y, z)


def _timed(call: Callable[[], T]) -> tuple[float, T]:
    start = time.perf_counter()
    result = call()
    return 1e6 * (time.perf_counter() - start), result


BENCHMARK = Benchmark("limiter-speed", "one call of the limiter for 1, 32 and 1,081 points, beside sweeps", run)
