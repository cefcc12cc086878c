"""Closed loops through rendered pictures on the three platforms of the thesis: each tracker alone, and the fusion.

Echeverri 2016: the UAV of 4.5.3, the pan-tilt head of 4.5.2, the ground robot of 3.6. Trackers run one after the other
here; in flight each is a process of its own.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence

import numpy as np

from benchmarks import follow_ground, follow_pan_tilt, follow_uav
from benchmarks.base import Benchmark, Outcome, Settings
from benchmarks.beside import Part, results_of
from benchmarks.follow_score import Score
from common.config import Config, ConfigError, unknown_key_text
from common.processes import load_config
from common.tracking.base import Tracker
from common.tracking.registry import make_tracker
from onboard.fusion.config import HabDfConfig

PLATFORMS = ("uav", "pan-tilt", "ground")
_FUSION = "hab-df"
_AS_IN_FLIGHT = ("hab_df.outline=false",)
_UAV_FRAMES, _UAV_QUICK = 7200, 900
_HEAD_FRAMES, _HEAD_QUICK, _HEAD_RUNS, _HEAD_QUICK_RUNS = 900, 210, 5, 2
_GROUND_M, _GROUND_QUICK_M = 110.0, 7.0
_PAPER_UAV = {"uav_frames_followed": 7132.0, "uav_frames_best_member": 1738.0, "uav_frames_until_loss_ratio": 4.1}


def run(settings: Settings) -> Outcome:
    """One platform, or all three.

    Raises:
        ConfigError: unknown platform.
    """
    if settings.platform is not None and settings.platform not in PLATFORMS:
        raise ConfigError(f"platform: {unknown_key_text(settings.platform, PLATFORMS)}")
    wanted = PLATFORMS if settings.platform is None else (settings.platform,)
    config = load_config(None)
    runs = {"uav": _uav, "pan-tilt": _pan_tilt, "ground": _ground}
    results: dict[str, float] = {}
    for platform in wanted:
        results |= runs[platform](config, settings)
    best = {name: value for name, value in results.items() if "best_member" in name}
    paper = {name: value for name, value in _PAPER_UAV.items() if name in results}
    return Outcome(results, {"name": "the best member alone, in the same loop", **best}, paper)


def _names(config: Config) -> tuple[str, ...]:
    return (_FUSION, *config.section(HabDfConfig).members)


def _tracker(name: str, seed: Sequence[int]) -> Tracker:
    """A tracker with randomness of its own, the same alone in whatever order the parts are done."""
    rng = np.random.default_rng([*seed, zlib.crc32(name.encode())])
    return make_tracker(name, load_config(None, _AS_IN_FLIGHT), rng)


def _word(name: str) -> str:
    return name.replace("-", "_")


def _fly(name: str, seed: int, frames: int) -> Score:
    course = follow_uav.Course(seed, frames)
    return follow_uav.follow(course, _tracker(name, (seed, 1)), follow_uav.Quadrotor(seed), follow_uav.depth_eye(seed))


def _uav(config: Config, settings: Settings) -> dict[str, float]:
    """Frames until each member alone, and the fusion, has lost the person."""
    frames = _UAV_QUICK if settings.quick else _UAV_FRAMES
    names = _names(config)
    parts = [(name, settings.seed, frames) for name in names]
    scores = dict(zip(names, results_of(_fly, parts, _flown), strict=True))
    members = {name: score.followed for name, score in scores.items() if name != _FUSION}
    best = max(members.values())
    fused = scores[_FUSION]
    return {
        "uav_frames": float(frames),
        "uav_frames_followed": float(fused.followed),
        "uav_frames_until_loss_ratio": fused.followed / best,
        "uav_mean_image_error_px": fused.mean_error_px,
        "uav_mean_jaccard": float(np.mean(fused.overlaps)),
        "uav_frames_best_member": float(best),
        **{f"uav_frames_{_word(name)}": float(count) for name, count in members.items()},
    }


def _flown(part: Part, score: Score) -> str:
    name, _, frames = part
    return f"uav, {name}: {score.followed} of {frames} frames, {score.mean_error_px:.0f} px off the middle"


def _turn(target: str, name: str, seed: int, frames: int) -> Score:
    return follow_pan_tilt.follow(follow_pan_tilt.Course(target, seed, frames), _tracker(name, (seed, 2)))


def _pan_tilt(config: Config, settings: Settings) -> dict[str, float]:
    """Runs with each target: success and frames of each member alone and of the fusion."""
    frames = _HEAD_QUICK if settings.quick else _HEAD_FRAMES
    runs = range(_HEAD_QUICK_RUNS if settings.quick else _HEAD_RUNS)
    names = _names(config)
    parts = [(t, n, settings.seed * 100 + r, frames) for t in follow_pan_tilt.TARGETS for n in names for r in runs]
    done = results_of(_turn, parts, _turned)
    results: dict[str, float] = {}
    for target in follow_pan_tilt.TARGETS:
        success: dict[str, float] = {}
        for name in names:
            scores = [score for part, score in zip(parts, done, strict=True) if part[:2] == (target, name)]
            word = f"pan_tilt_{target}_{{}}_{_word(name)}"
            success[name] = float(np.mean([score.success(frames) for score in scores]))
            results[word.format("success")] = success[name]
            results[word.format("frames")] = float(np.mean([score.followed for score in scores]))
            results[word.format("jaccard")] = float(np.mean([np.mean(s.overlaps) for s in scores]))
            if name == _FUSION:
                results[f"pan_tilt_{target}_image_error_px"] = float(np.mean([s.mean_error_px for s in scores]))
        best = max(value for name, value in success.items() if name != _FUSION)
        results[f"pan_tilt_{target}_success_best_member"] = best
    return results


def _turned(part: Part, score: Score) -> str:
    target, name, _, frames = part
    return f"pan-tilt, {target}, {name}: success {score.success(frames):.2f}"


def _drive(name: str, seed: int, length_m: float) -> tuple[follow_ground.Driven, int]:
    course = follow_ground.Course(seed, length_m)
    return follow_ground.follow(course, _tracker(name, (seed, 3)), seed), course.frames


def _ground(config: Config, settings: Settings) -> dict[str, float]:
    """Whether the robot follows the bin to the end of its course."""
    length_m = _GROUND_QUICK_M if settings.quick else _GROUND_M
    names = _names(config)
    done = results_of(_drive, [(name, settings.seed, length_m) for name in names], _driven)
    results: dict[str, float] = {"ground_course_m": length_m}
    for name, (driven, _) in zip(names, done, strict=True):
        completed = float(not driven.score.lost)
        if name == _FUSION:
            results |= {
                "ground_completed": completed,
                "ground_distance_error_m": driven.distance_error_m,
                "ground_estimate_error_m": driven.estimate_error_m,
                "ground_beyond_range_fraction": driven.beyond,
                "ground_travelled_m": driven.travelled_m,
                "ground_image_error_px": driven.score.mean_error_px,
            }
        else:
            results[f"ground_completed_{_word(name)}"] = completed
    alone = [value for name, value in results.items() if name.startswith("ground_completed_")]
    results["ground_completed_best_member"] = max(alone, default=math.nan)
    return results


def _driven(part: Part, done: tuple[follow_ground.Driven, int]) -> str:
    driven, frames = done
    return f"ground, {part[0]}: {driven.score.followed} of {frames} frames, {driven.distance_error_m:.2f} m off"


BENCHMARK = Benchmark("follow", "UAV, pan-tilt and ground robot after a target: trackers alone, and fused", run)
