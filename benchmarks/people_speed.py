"""How long the stages of the search for people take; floor and clusters beside Open3D on the same clouds.

Everything runs on one core. Open3D gets the points, the band and the radius that ours used, as many hypotheses, and its
own containers filled before the clock starts; ours is timed from the same points to the plane and the labels. Then the
whole node (`people_node_speed`).
"""

from __future__ import annotations

import importlib
import importlib.metadata
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, TypeVar

import cv2
import numpy as np

from benchmarks.base import Benchmark, Outcome, Settings
from benchmarks.people_node_speed import measure
from benchmarks.people_scene import KINECT_2, crowd
from onboard.people.clusters import find_clusters, labels_above, spread
from onboard.people.compiled import dbscan
from onboard.people.config import ClusterConfig, FloorConfig
from onboard.people.depth import Cloud, Floats, Ints, RayTable, metres
from onboard.people.floor import Floor, find_floor

_HEIGHTS_M = (3.0, 5.0, 8.0)
_SCENES, _QUICK_SCENES = 24, 6
_REPEATS, _FULL_REPEATS = 9, 3
_LEAST_CLUSTER = 20
"""Points of a cluster whose agreement counts; smaller ones are noise to both."""
_MISSING = (
    "  Open3D is not installed, so there is no baseline: .venv/bin/python -m pip install -c constraints.txt "
    "-e '.[rivals]' brings it (600 MB)"
)


Result = TypeVar("Result")


@dataclass
class Times:
    """Milliseconds of each stage, and how far both answers agree."""

    ms: dict[str, list[float]] = field(default_factory=dict)
    plane_deg: list[float] = field(default_factory=list)
    iou: list[float] = field(default_factory=list)
    points: list[int] = field(default_factory=list)

    def of(self, stage: str, work: Callable[[], Result], repeats: int = 1) -> Result:
        """Do some work so many times, note the median time, return the last result."""
        taken, results = [], []
        for _ in range(repeats):
            start = time.perf_counter()
            results.append(work())
            taken.append(1e3 * (time.perf_counter() - start))
        self.ms.setdefault(stage, []).append(float(np.median(taken)))
        return results[-1]

    def median(self, stage: str) -> float:
        """Median of a stage, ms."""
        return float(np.median(self.ms[stage]))

    def per_frame(self, *stages: str) -> np.ndarray:
        """Sum of some stages, frame by frame, ms."""
        return np.sum([self.ms[stage] for stage in stages], axis=0)


def run(settings: Settings) -> Outcome:
    """Time both on the same clouds, scene by scene in turn."""
    cv2.setNumThreads(1)
    rival = _open3d()
    with _one_core():
        sampled, full = Times(), Times()
        scenes = _QUICK_SCENES if settings.quick else _SCENES
        for index, depth_m in enumerate(_depths(settings.seed, scenes)):
            kept = (sampled, full) if index else (Times(), Times())  # the first one warms up
            for strided, times in zip((True, False), kept, strict=True):
                _frame(depth_m, strided, times, rival, settings.seed + index)
        whole = measure(settings.seed, settings.quick)
    return _outcome(sampled, full, whole, rival)


def _open3d() -> Any:
    try:
        return importlib.import_module("open3d")
    except ImportError:
        return None


@contextmanager
def _one_core() -> Iterator[None]:
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(before)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def _depths(seed: int, scenes: int) -> Iterator[Floats]:
    for index in range(scenes + 1):
        rng = np.random.default_rng((seed, index))
        yield crowd(rng, _HEIGHTS_M[index % len(_HEIGHTS_M)]).render(rng)[0]


def _frame(depth: Floats, strided: bool, times: Times, rival: Any, seed: int) -> None:
    config, clustering, table = FloorConfig(), ClusterConfig(), RayTable.of(KINECT_2)
    repeats = _REPEATS if strided else _FULL_REPEATS

    def make_cloud() -> Cloud:
        depth_m = metres(depth, KINECT_2)
        bounds = config.nearest_m, config.farthest_m
        stride = table.stride_for(depth_m, config.spacing_m, *bounds) if strided else 1
        return table.cloud(depth_m, stride, *bounds)

    cloud = times.of("cloud", make_cloud, repeats)
    floor = times.of("floor", lambda: find_floor(cloud.points_m, config, np.random.default_rng(seed)), repeats)
    if floor is None:
        raise RuntimeError(f"people-speed: no floor found in the scene of seed {seed}")
    times.of("clusters", lambda: labels_above(cloud, floor, clustering), repeats)
    times.of("clusters_with_sizes", lambda: find_clusters(cloud, floor, clustering), repeats)
    times.points.append(len(cloud.points_m))
    if rival is not None:
        _compare(rival, cloud, floor, times, repeats)


def _compare(rival: Any, cloud: Cloud, floor: Floor, times: Times, repeats: int) -> None:
    """Open3D's plane and clusters of the same points, timed, and how far they agree with ours."""
    clustering = ClusterConfig()
    everything = _point_cloud(rival, cloud.points_m)

    def fit() -> tuple[np.ndarray, list[int], Any]:
        plane, inliers = everything.segment_plane(floor.band_m, 3, FloorConfig().hypotheses)
        return plane, inliers, everything.select_by_index(inliers, invert=True)

    plane, inliers, above = times.of("rival_floor", fit, repeats)
    cosine = abs(float(np.dot(plane[:3], floor.up)))
    times.plane_deg.append(float(np.degrees(np.arccos(min(1.0, cosine)))))
    places, radius_m = spread(cloud.rows(_rest(len(cloud.points_m), inliers)), floor, clustering)
    if len(above.points) != len(places):
        raise RuntimeError(f"people-speed: Open3D kept {len(above.points)} points, expected {len(places)}")
    above.points = rival.utility.Vector3dVector(places.astype(float))
    theirs = times.of("rival_clusters", lambda: above.cluster_dbscan(radius_m, clustering.neighbours), repeats)
    times.iou += _agreement(dbscan(places, radius_m, clustering.neighbours), np.asarray(theirs, np.int32))


def _point_cloud(rival: Any, points: Floats) -> Any:
    return rival.geometry.PointCloud(rival.utility.Vector3dVector(points.astype(float)))


def _rest(count: int, rows: list[int]) -> Ints:
    left = np.ones(count, bool)
    left[rows] = False
    return np.flatnonzero(left).astype(np.int32)


def _agreement(ours: Ints, theirs: Ints) -> list[float]:
    """Best IoU of each of their clusters with one of ours."""
    found = []
    for label in range(theirs.max(initial=-1) + 1):
        mask = theirs == label
        size = int(mask.sum())
        if size < _LEAST_CLUSTER:
            continue
        hits = np.bincount(ours[mask] + 1, minlength=2)[1:]
        best = int(np.argmax(hits))
        found.append(float(hits[best] / (size + np.count_nonzero(ours == best) - hits[best])))
    return found


def _outcome(sampled: Times, full: Times, whole: dict[str, float], rival: Any) -> Outcome:
    results = dict(whole)
    for name, times in (("", sampled), ("full_", full)):
        ours = times.per_frame("floor", "clusters")
        results |= {
            f"{name}points": float(np.median(times.points)),
            f"{name}cloud_ms": times.median("cloud"),
            f"{name}floor_ms": times.median("floor"),
            f"{name}clusters_ms": times.median("clusters"),
            f"{name}clusters_with_sizes_ms": times.median("clusters_with_sizes"),
            f"{name}floor_clusters_ms_p99": float(np.quantile(ours, 0.99)),
        }
        if rival is not None:
            theirs = times.per_frame("rival_floor", "rival_clusters")
            results |= {
                f"{name}open3d_floor_ms": times.median("rival_floor"),
                f"{name}open3d_clusters_ms": times.median("rival_clusters"),
                f"{name}speedup": float(np.median(theirs) / np.median(ours)),
                f"{name}plane_difference_deg_max": max(times.plane_deg),
                f"{name}cluster_iou_min": min(times.iou),
            }
    if rival is None:
        return Outcome(results, {"name": "none: Open3D is not installed"}, table=(*_lines(results), _MISSING))
    baseline = {"name": f"Open3D {importlib.metadata.version('open3d-cpu')} segment_plane + cluster_dbscan, one core"}
    return Outcome(results, {**baseline, "ratio": results["speedup"], "ratio_full": results["full_speedup"]})


def _lines(results: dict[str, float]) -> Iterator[str]:
    return (f"  {name:32} {value:10.3f}" for name, value in results.items())


BENCHMARK = Benchmark("people-speed", "stages of the search for people; floor and clusters beside Open3D", run)
