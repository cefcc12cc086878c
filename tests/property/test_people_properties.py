"""Clusters are those of the definition whatever the order; the pose filter sees neither rotation nor scale."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from onboard.people.association import pose_dissimilarity
from onboard.people.compiled import dbscan
from onboard.people.config import PoseFilterConfig
from onboard.people.pose_filter import pose_refusal, upright
from tests.unit.people_bodies import STANDING, moved, pose, region_of


def _points(seed: int, count: int, spread_m: float) -> np.ndarray:
    rng = np.random.default_rng(seed)
    middles = rng.uniform(-spread_m, spread_m, (4, 3))
    return (middles[rng.integers(4, size=count)] + rng.normal(size=(count, 3)) * 0.3).astype(np.float32)


def _by_definition(points: np.ndarray, radius: float, least: int) -> tuple[np.ndarray, list[set[int]]]:
    """Core points, and the sets of them that are joined: by brute force."""
    gaps = np.sum((points[:, None].astype(np.float32) - points[None]) ** 2, axis=2)
    near = gaps <= np.float32(radius * radius)
    core = near.sum(axis=1) >= least
    left, groups = set(np.flatnonzero(core).tolist()), []
    while left:
        group, todo = set(), [left.pop()]
        while todo:
            i = todo.pop()
            group.add(i)
            fresh = [j for j in np.flatnonzero(near[i] & core).tolist() if j in left]
            left -= set(fresh)
            todo += fresh
        groups.append(group)
    return core, groups


@settings(max_examples=60)
@given(st.integers(0, 10_000), st.integers(1, 90), st.floats(0.05, 2.0), st.integers(1, 6))
def test_clusters_are_those_of_the_definition(seed: int, count: int, radius: float, least: int):
    points = _points(seed, count, 3.0)
    labels = dbscan(points, radius, least)
    core, groups = _by_definition(points, radius, least)
    assert {frozenset(g) for g in groups} == {
        frozenset(np.flatnonzero(core & (labels == k)).tolist()) for k in range(labels.max() + 1)
    }
    for i in np.flatnonzero(~core):
        reachable = {
            int(labels[j])
            for j in np.flatnonzero(core)
            if np.sum((points[i] - points[j]) ** 2) <= np.float32(radius * radius)
        }
        assert labels[i] in reachable if reachable else labels[i] == -1


@settings(max_examples=30)
@given(st.integers(0, 10_000), st.integers(2, 200), st.floats(0.1, 1.0))
def test_the_order_of_the_points_does_not_matter(seed: int, count: int, radius: float):
    points = _points(seed, count, 2.0)
    order = np.random.default_rng(seed).permutation(count)
    # Every point is a core point, so that no border point can go to either side.
    straight, shuffled = dbscan(points, radius, 1), dbscan(np.ascontiguousarray(points[order]), radius, 1)
    pairs = set(zip(straight[order].tolist(), shuffled.tolist(), strict=True))
    assert len(pairs) == len({a for a, _ in pairs}) == len({b for _, b in pairs})


@settings(max_examples=60)
@given(
    st.integers(0, 10_000),
    st.floats(-math.pi, math.pi),
    st.floats(0.7, 4.0),
    st.tuples(st.floats(-200, 200), st.floats(-200, 200)),
)
def test_the_pose_filter_does_not_see_rotation_translation_and_scale(
    seed: int, angle_rad: float, scale: float, shift: tuple[float, float]
):
    rng = np.random.default_rng(seed)
    joints = STANDING + rng.normal(size=(15, 2)) * rng.uniform(0.0, 12.0)
    config = PoseFilterConfig(least_region_px=1.0, least_filled=0.01, most_filled=100.0)
    plain = pose_refusal(pose(joints), region_of(STANDING), config)
    changed = moved(joints, angle_rad, scale, shift)
    assert pose_refusal(pose(changed), region_of(moved(STANDING, angle_rad, scale, shift)), config) == plain
    np.testing.assert_allclose(
        upright(changed) - changed[0], scale * (upright(joints) - joints[0]), atol=1e-6 * scale * 1e3
    )


@settings(max_examples=60)
@given(
    st.integers(0, 10_000),
    st.floats(-math.pi, math.pi),
    st.floats(0.2, 5.0),
    st.tuples(st.floats(-200, 200), st.floats(-200, 200)),
)
def test_the_pose_distance_does_not_see_rotation_translation_and_scale(
    seed: int, angle_rad: float, scale: float, shift: tuple[float, float]
):
    rng = np.random.default_rng(seed)
    one, other = (STANDING + rng.normal(size=(15, 2)) * 10.0 for _ in range(2))
    plain = pose_dissimilarity(pose(one), pose(other))
    assert plain == pytest.approx(pose_dissimilarity(pose(other), pose(one)))
    assert pose_dissimilarity(pose(moved(one, angle_rad, scale, shift)), pose(other)) == pytest.approx(plain, abs=1e-9)
