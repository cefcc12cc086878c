"""How long one step of the pursuit's tracker takes, beside the plain NumPy loop over particles and kernels."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence

import cv2
import msgspec
import numpy as np

from benchmarks.base import Benchmark, Outcome, Settings
from benchmarks.painted_scene import CAR_PX, RATE_HZ, Pose, Scene, winding
from common.processes import load_config
from common.tracking.config import ParticleFilterConfig
from common.tracking.histogram import LAYOUTS, Backend, learn_model
from common.tracking.particle_filter import ParticleFilterTracker
from common.tracking.particles import likelihood_weights

_STEPS, _QUICK_STEPS = 400, 120
_WARM_UP = 10
_LOOP_EVERY = 8
"""The plain loop runs on one picture of so many, in turn with the others; it has as little variance as they."""
_MANY = 2000
_EVERY_PIXEL = 1e9
_PLAIN = {"turn_sweep_rad": 0.0, "line_reach_rad": 0.0}
"""Without the turn sweep and the target's lines."""

Frames = Sequence[tuple[int, np.ndarray, Pose]]


def run(settings: Settings) -> Outcome:
    """Track one car with each form, picture by picture in turn: as the demonstration's vehicle has it, and varied."""
    cv2.setNumThreads(1)
    steps = _QUICK_STEPS if settings.quick else _STEPS
    frames = list(Scene(winding(), settings.seed).frames((steps + _WARM_UP + 1) / RATE_HZ))
    shipped = load_config("kite").section(ParticleFilterConfig)
    trackers = {
        "shipped": _tracker(shipped, settings.seed, frames),
        "colours": _tracker(shipped, settings.seed, frames, **_PLAIN),
        "full": _tracker(shipped, settings.seed, frames, kernel_pixels=_EVERY_PIXEL),
        "many": _tracker(shipped, settings.seed, frames, particles=_MANY),
        "loop": _tracker(shipped, settings.seed, frames, backend="numpy", kernel_pixels=_EVERY_PIXEL),
    }
    times: dict[str, list[float]] = {name: [] for name in trackers}
    for index, (t_ns, frame, _) in enumerate(frames[1:]):
        for name, tracker in trackers.items():
            if name == "loop" and index % _LOOP_EVERY:
                continue
            picture = frame.copy()  # as the decoder leaves it: just written, for each form alike
            start = time.perf_counter()
            tracker.update(picture, t_ns)
            if index >= _WARM_UP:
                times[name].append(1e3 * (time.perf_counter() - start))
    median = {name: float(np.median(values)) for name, values in times.items()}
    results = {
        "step_ms_median": median["shipped"],
        "step_ms_p99": float(np.quantile(times["shipped"], 0.99)),
        "step_ms_colours_alone": median["colours"],
        "step_ms_full": median["full"],
        "step_ms_2000_particles": median["many"],
        "speedup": median["loop"] / median["shipped"],
        **_agreement(shipped, frames, settings.seed),
    }
    loop = {"name": f"per-particle NumPy {np.__version__} loop, bincount per kernel", "step_ms_median": median["loop"]}
    return Outcome(results, {**loop, "ratio": results["speedup"]}, {"step_ms_median": 50.0})


def _tracker(shipped: ParticleFilterConfig, seed: int, frames: Frames, **options: object) -> ParticleFilterTracker:
    tracker = ParticleFilterTracker(msgspec.structs.replace(shipped, **options), np.random.default_rng(seed))
    t_ns, frame, pose = frames[0]
    tracker.init(frame, pose.box(), pose.angle_rad, t_ns)
    return tracker


def _agreement(shipped: ParticleFilterConfig, frames: Frames, seed: int) -> dict[str, float]:
    """Greatest difference of the weights to the plain loop's, and what the shipped lattice changes."""
    rng = np.random.default_rng(seed)
    _, frame, pose = frames[0]
    size = math.sqrt(CAR_PX[0] * CAR_PX[1])
    state = np.array([pose.x_px, pose.y_px, pose.angle_rad, 1.0 / size])
    states = state + rng.normal(size=(shipped.particles, 4)) * [0.2 * size, 0.2 * size, 0.2, 0.05 / size]
    kernels = LAYOUTS[shipped.kernels]
    thinning = kernels.thinning(state, shipped.kernel_pixels)
    backends: tuple[Backend, Backend] = ("compiled", "numpy")
    compiled, loop = (learn_model(frame, state, CAR_PX[1] / CAR_PX[0], kernels, backend) for backend in backends)
    full, plain = compiled.distances(frame, states), loop.distances(frame, states)
    lattice = compiled.distances(frame, states, thinning=thinning)
    weights, expected = (likelihood_weights(distances, shipped.likelihood_lambda) for distances in (full, plain))
    return {
        "weights_max_difference": float(np.abs(weights - expected).max()),
        "sampling_rms": float(np.sqrt(np.mean((lattice - full) ** 2))),
    }


BENCHMARK = Benchmark("pursuit-speed", "one step of the pursuit's tracker, beside a plain NumPy loop", run)
