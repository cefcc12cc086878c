"""How long one step of the fusion takes, and how many pictures a second its trackers follow, at 640 x 480."""

from __future__ import annotations

import time

import cv2
import numpy as np
from filterpy.kalman import KalmanFilter

from benchmarks.base import Benchmark, Outcome, Settings
from benchmarks.painted_scene import RATE_HZ, Scene, straight
from common.processes import load_config
from common.tracking.registry import make_tracker
from onboard.fusion.center import Fusion
from onboard.fusion.config import FusionConfig
from onboard.fusion.source import Measurement, Source

_STEPS, _QUICK_STEPS = 4000, 1500
_FRAMES, _QUICK_FRAMES = 90, 50
_WARM_UP = 20
_SOURCES = 3
_PERIOD_NS = 33_333_333


def run(settings: Settings) -> Outcome:
    """Time the fusion of three boxes, in turn with one bare filterpy step, then each tracker on a painted car."""
    cv2.setNumThreads(1)
    step_us, bare_us = _step_times(settings.seed, _QUICK_STEPS if settings.quick else _STEPS)
    results = {
        "fusion_step_us": float(np.median(step_us)),
        "fusion_step_us_p99": float(np.quantile(step_us, 0.99)),
        "fusion_step_over_filter_step": float(np.median(step_us) / np.median(bare_us)),
    }
    frames = list(Scene(straight(60.0), settings.seed).frames((_QUICK_FRAMES if settings.quick else _FRAMES) / RATE_HZ))
    for name in ("dsst", "cmt", "struck", "tld", "particle_filter", "mil", "hab-df"):
        tracker = make_tracker(name, load_config(None), np.random.default_rng(settings.seed))
        tracker.init(frames[0][1], frames[0][2].box(), 0.0, 0)
        times = []
        for t_ns, frame, _ in frames[1:]:
            start = time.perf_counter()
            tracker.update(frame, t_ns)
            times.append(time.perf_counter() - start)
        results[f"fps_{name.replace('-', '_')}"] = float(1.0 / np.median(times[_WARM_UP:]))
    baseline = {"name": "filterpy predict and update, 8 states", "step_us": float(np.median(bare_us))}
    return Outcome(results, {**baseline, "ratio": results["fusion_step_over_filter_step"]})


def _step_times(seed: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Times, us, of a fusion step of three boxes, and of predict and update of one filter of the same size."""
    rng = np.random.default_rng(seed)
    fusion = Fusion([Source(f"s{i}", (0.05,) * 4) for i in range(_SOURCES)], FusionConfig())
    fusion.unit = np.full(4, 60.0)
    bare = KalmanFilter(dim_x=8, dim_z=4)
    bare.H = np.eye(4, 8)
    transition, noise, variance = np.eye(8) + np.eye(8, k=4) * 0.033, 0.1 * np.eye(8), 9.0 * np.eye(4)
    fused, plain = [], []
    for index in range(count):
        t_ns = index * _PERIOD_NS
        boxes = rng.normal([320.0, 240.0, 50.0, 80.0], 3.0, (_SOURCES, 4))
        said = [Measurement(f"s{i}", t_ns, box) for i, box in enumerate(boxes)]
        start = time.perf_counter()
        fusion.step(said, t_ns)
        middle = time.perf_counter()
        bare.predict(F=transition, Q=noise)
        bare.update(boxes[0].reshape(-1, 1), R=variance)
        fused.append(1e6 * (middle - start))
        plain.append(1e6 * (time.perf_counter() - middle))
    return np.array(fused[_WARM_UP:]), np.array(plain[_WARM_UP:])


BENCHMARK = Benchmark("fusion-speed", "one step of the fusion, and pictures a second of its trackers", run)
