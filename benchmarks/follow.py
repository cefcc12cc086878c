"""Closed loops through rendered pictures on the three platforms of the thesis: each tracker alone, and the fusion.

Echeverri 2016: the UAV of 4.5.3, the pan-tilt head of 4.5.2, the ground robot of 3.6. Trackers run one after the other
here; in flight each is a process of its own.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence

import numpy as np

from benchmarks import follow_ground, follow_pan_tilt, follow_uav
from benchmarks.base import Benchmark, Outcome, Settings
from benchmarks.follow_score import Score
from common.config import Config, ConfigError, unknown_key_text
from common.processes import load_config
from common.tracking.base import Tracker
from common.tracking.registry import make_tracker
from onboard.fusion.config import HabDfConfig

PLATFORMS = ("uav", "pan-tilt", "ground")
_FUSION = "hab-df"
_UAV_FRAMES, _UAV_QUICK = 7200, 900
_HEAD_FRAMES, _HEAD_QUICK, _HEAD_RUNS = 900, 210, 5
_GROUND_M, _GROUND_QUICK_M = 110.0, 7.0
_PAPER_UAV = {"uav_frames_followed": 7132.0, "uav_frames_best_member": 1738.0, "uav_frames_until_loss_ratio": 4.1}
_BAR = 24


class Progress:
    """A bar on a terminal, a line for each part elsewhere.

    Args:
        total: parts.
    """

    def __init__(self, total: int):
        self._total, self._done = total, 0

    def part(self, share: float) -> None:
        """So much of the present part is done."""
        if sys.stderr.isatty():
            filled = int(_BAR * (self._done + share) / self._total)
            print(f"\r[{'#' * filled:{_BAR}}]", end="", file=sys.stderr, flush=True)

    def done(self, text: str) -> None:
        """The present part is done."""
        self._done += 1
        start = "\r" if sys.stderr.isatty() else ""
        print(f"{start}follow: {self._done} of {self._total}: {text}", file=sys.stderr, flush=True)


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
    return (*config.section(HabDfConfig).members, _FUSION)


def _tracker(name: str, config: Config, seed: Sequence[int]) -> Tracker:
    return make_tracker(name, config, np.random.default_rng(list(seed)))


def _word(name: str) -> str:
    return name.replace("-", "_")


def _uav(config: Config, settings: Settings) -> dict[str, float]:
    """Frames until each member alone, and the fusion, has lost the person."""
    frames = _UAV_QUICK if settings.quick else _UAV_FRAMES
    names = _names(config)
    progress = Progress(len(names))
    scores: dict[str, Score] = {}
    for number, name in enumerate(names):
        course = follow_uav.Course(settings.seed, frames, settings.quick)
        tracker = _tracker(name, config, (settings.seed, number))
        score = scores[name] = follow_uav.follow(course, tracker, follow_uav.Quadrotor(settings.seed), progress.part)
        progress.done(f"uav, {name}: {score.followed} of {frames} frames, {score.mean_error_px:.0f} px off the middle")
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


def _pan_tilt(config: Config, settings: Settings) -> dict[str, float]:
    """Five runs with each target: success and frames of each member alone and of the fusion."""
    frames = _HEAD_QUICK if settings.quick else _HEAD_FRAMES
    names = _names(config)
    progress = Progress(len(follow_pan_tilt.TARGETS) * len(names))
    results: dict[str, float] = {}
    for target in follow_pan_tilt.TARGETS:
        success: dict[str, float] = {}
        for number, name in enumerate(names):
            scores = []
            for run_ in range(_HEAD_RUNS):
                seed = settings.seed * 100 + run_
                course = follow_pan_tilt.Course(target, seed, frames)
                scores.append(follow_pan_tilt.follow(course, _tracker(name, config, (seed, number))))
                progress.part((run_ + 1) / _HEAD_RUNS)
            word = f"pan_tilt_{target}_{{}}_{_word(name)}"
            success[name] = float(np.mean([score.success(frames) for score in scores]))
            results[word.format("success")] = success[name]
            results[word.format("frames")] = float(np.mean([score.followed for score in scores]))
            results[word.format("jaccard")] = float(np.mean([np.mean(s.overlaps) for s in scores]))
            progress.done(f"pan-tilt, {target}, {name}: success {success[name]:.2f} over {_HEAD_RUNS} runs")
            if name == _FUSION:
                results[f"pan_tilt_{target}_image_error_px"] = float(np.mean([s.mean_error_px for s in scores]))
        best = max(value for name, value in success.items() if name != _FUSION)
        results[f"pan_tilt_{target}_success_best_member"] = best
    return results


def _ground(config: Config, settings: Settings) -> dict[str, float]:
    """Whether the robot follows the bin to the end of its course."""
    length_m = _GROUND_QUICK_M if settings.quick else _GROUND_M
    names = _names(config)
    progress = Progress(len(names))
    results: dict[str, float] = {"ground_course_m": length_m}
    for number, name in enumerate(names):
        course = follow_ground.Course(settings.seed, length_m)
        tracker = _tracker(name, config, (settings.seed, number))
        driven = follow_ground.follow(course, tracker, settings.seed, progress.part)
        completed = float(not driven.score.lost)
        progress.done(
            f"ground, {name}: {driven.score.followed} of {course.frames} frames, "
            f"{driven.distance_error_m:.2f} m off the distance"
        )
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


BENCHMARK = Benchmark("follow", "UAV, pan-tilt and ground robot after a target: trackers alone, and fused", run)
