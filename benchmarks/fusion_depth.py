"""Distance from a time-of-flight camera and from scale, through the camera's limit and back (Echeverri 2016, 3.6)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import spearmanr

from benchmarks.base import Benchmark, Outcome, Settings
from benchmarks.tof_sensor import RANGE_M, read_depths
from onboard.fusion.config import DepthConfig
from onboard.fusion.depth import DepthFusion, size_ratio
from onboard.fusion.motion import MotionFilter

_RATE_HZ = 30.0
_RUNS, _QUICK_RUNS = 40, 10
_IMAGE_PX = (320.0, 240.0)
_PATCH = (12, 12)
_SHARED_M = 0.005
"""Standard deviation of the error that all pixels of a depth picture have, m."""
_SIZE_NOISE, _SIZE_WANDER, _WANDER_S = 0.03, 0.03, 2.0
"""Relative error of a tracker's box: from picture to picture, and slowly wandering with a time constant, s."""
_LEAST_NEAR, _NEAR_M = 15, 0.1
"""Readings that a step of distance must have to count in the correlation, and how far within the sensor's range a
reading is a good one, m."""


@dataclass(frozen=True)
class Course:
    """One run."""

    t_ns: np.ndarray
    """Stamps, (T,), ns."""
    z_m: np.ndarray
    """True distance, (T,), m."""
    patches_m: np.ndarray
    """Depth inside the box, (T, 12, 12), m; 0 for none."""
    sizes_px: np.ndarray
    """Width and height of the box, (T, 2), px."""


def course(seed: tuple[int, int]) -> Course:
    """A target that stands near, moves out through the sensor's limit in about ten seconds, stays, and comes back."""
    rng = np.random.default_rng(seed)
    near, far = rng.uniform(0.55, 0.7), rng.uniform(1.4, 1.8)
    stops = np.cumsum(rng.uniform([2.0, 7.0, 5.0, 4.0, 2.0], [4.0, 11.0, 9.0, 8.0, 4.0]))
    t_s = np.arange(0.0, stops[-1], 1.0 / _RATE_HZ)
    share = np.interp(t_s, stops[:4], [0.0, 1.0, 1.0, 0.0])
    z_m = near + (far - near) * 0.5 * (1.0 - np.cos(np.pi * share))
    z_m += 0.02 * np.sin(2 * np.pi * t_s / rng.uniform(2.0, 4.0))
    patches = np.array([read_depths(rng, np.full(_PATCH, z), _SHARED_M) for z in z_m])
    wander, keep = 0.0, math.exp(-1.0 / (_WANDER_S * _RATE_HZ))
    sizes = np.empty((len(z_m), 2))
    target_m, focal_px = rng.uniform(0.12, 0.25, 2), 250.0
    for index, z in enumerate(z_m):
        wander = keep * wander + _SIZE_WANDER * math.sqrt(1 - keep**2) * rng.normal()
        sizes[index] = focal_px * target_m / z * (1.0 + wander + _SIZE_NOISE * rng.normal(size=2))
    return Course(np.round(t_s * 1e9).astype(np.int64), z_m, patches, np.maximum(sizes, 4.0))


def run(settings: Settings) -> Outcome:
    """Measure the distance over several courses with each way alone, and with both."""
    courses = [course((settings.seed, i)) for i in range(_QUICK_RUNS if settings.quick else _RUNS)]
    parts = [_estimates(one) for one in courses]
    z_m = np.concatenate([one.z_m for one in courses])
    answers = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    inside, beyond = z_m < RANGE_M, z_m >= RANGE_M
    regimes = {"": np.full(len(z_m), True), "_inside": inside, "_beyond": beyond}
    results = {
        f"rmse_{way}{regime}": float(np.sqrt(np.mean((answers[way] - z_m)[mask] ** 2)))
        for regime, mask in regimes.items()
        for way in ("fused", "tof", "scale", "scale_known")
    }
    for regime in ("_inside", "_beyond"):
        better = min(results[f"rmse_tof{regime}"], results[f"rmse_scale{regime}"], results[f"rmse_scale_known{regime}"])
        results[f"fused_over_better{regime}"] = results[f"rmse_fused{regime}"] / better
    results["tof_error_confidence_spearman"] = float(
        np.mean([_correlation(one, part) for one, part in zip(courses, parts, strict=True)])
    )
    results["runs"] = float(len(courses))
    if settings.plots is not None:
        _draw(courses[0], parts[0], settings.plots)
    scale = {
        "name": "distance from scale alone (K_z of the first reading), in the same filter",
        "rmse": results["rmse_scale"],
    }
    return Outcome(results, {**scale, "ratio": results["rmse_scale"] / results["rmse_fused"]})


def _estimates(one: Course) -> dict[str, np.ndarray]:
    """Distances (T,) by each way alone, each in the same filter, and by both; R_ζ; the raw readings."""
    config = DepthConfig()
    fusion = DepthFusion(config, _IMAGE_PX)
    rows = []
    for t_ns, patch, size in zip(one.t_ns.tolist(), one.patches_m, one.sizes_px, strict=True):
        estimate = fusion.update(t_ns, (160.0, 120.0), (float(size[0]), float(size[1])), patch)
        if estimate is None:
            raise RuntimeError("the course begins within the sensor's range")
        rows.append((estimate.position[2], estimate.reliability, estimate.tof_m, estimate.scale_m))
    fused, doubt, raw_tof, raw_scale = np.array(rows).T
    # Scale alone has K_z of the first reading, as in the thesis; a second one, for comparison, that of the whole
    # stretch within range, which nobody has while it lasts.
    ratios = np.array([size_ratio((w, h), _IMAGE_PX) for w, h in one.sizes_px])
    near = one.z_m < RANGE_M - _NEAR_M
    first, known = ratios * raw_tof[0] / ratios[0], ratios * float(np.mean(raw_tof[near] / ratios[near]))
    return {
        "fused": fused,
        "tof": _filtered(one.t_ns, raw_tof, np.full(len(raw_tof), config.tof_noise_m**2), config),
        "scale": _filtered(one.t_ns, first, (config.scale_noise * first) ** 2, config),
        "scale_known": _filtered(one.t_ns, known, (config.scale_noise * known) ** 2, config),
        "doubt": doubt,
        "raw_tof": raw_tof,
        "raw_scale": raw_scale,
    }


def _filtered(t_ns: np.ndarray, readings_m: np.ndarray, variances: np.ndarray, config: DepthConfig) -> np.ndarray:
    """The readings (T,) through the fusion's own filter; one that is missing (NaN) is predicted."""
    density, start = np.array([config.acceleration_m_s**2]), np.array([config.acceleration_m_s])
    one = MotionFilter(readings_m[:1], int(t_ns[0]), np.sqrt(variances[:1]), start)
    answer = np.empty(len(readings_m))
    for index, (stamp, reading, variance) in enumerate(zip(t_ns.tolist(), readings_m, variances, strict=True)):
        one.predict(stamp, density)
        if index and math.isfinite(reading):
            one.update(np.array([reading]), np.array([variance]))
        answer[index] = one.value[0]
    return answer


def _correlation(one: Course, part: dict[str, np.ndarray]) -> float:
    """Rank correlation of the time-of-flight reading's error with R_ζ over steps of distance (figure 3.12)."""
    error = np.abs(part["raw_tof"] - one.z_m)
    bins = np.round(one.z_m / 0.05).astype(int)
    means = [
        (np.nanmean(error[bins == b]), part["doubt"][bins == b].mean())
        for b in np.unique(bins)
        if (bins == b).sum() >= _LEAST_NEAR and np.isfinite(error[bins == b]).any()
    ]
    errors, doubts = np.array(means).T
    return float(spearmanr(errors, doubts)[0])  # pyright: ignore[reportArgumentType]


def _draw(one: Course, part: dict[str, np.ndarray], folder: Path) -> None:
    """Figures 3.11 (readings and estimate over the frames) and 3.12 (error and R_ζ over the distance)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    frames = np.arange(len(one.z_m))
    left.plot(frames, part["raw_tof"], lw=0.6, color="C1", label="time of flight")
    left.plot(frames, part["raw_scale"], lw=0.6, color="C2", label="scale (eq. 3.11)")
    left.plot(frames, part["fused"], lw=1.4, color="C0", label="fused")
    left.plot(frames, one.z_m, "k--", lw=1.0, label="truth")
    left.axhline(RANGE_M, color="0.6", lw=0.8)
    left.set(xlabel="frame", ylabel="m", title="distance (figure 3.11)")
    left.legend(fontsize=8)
    order = np.argsort(one.z_m)
    right.plot(one.z_m[order], np.abs(part["raw_tof"] - one.z_m)[order], ".", ms=2, color="C1", label="error, m")
    right.plot(one.z_m[order], part["doubt"][order], ".", ms=2, color="C3", label="R_ζ (eq. 3.12)")
    right.set(xlabel="true distance, m", title="error of the time of flight, and its R_ζ (figure 3.12)")
    right.legend(fontsize=8)
    figure.savefig(folder / "fusion-depth.png", dpi=80)


BENCHMARK = Benchmark("fusion-depth", "distance from time of flight and scale through the sensor's limit", run)
