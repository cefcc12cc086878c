"""Clusters above the floor: people of every posture from 2 to 12 m with one setting, sizes, and what is split."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from benchmarks.people_scene import Capsule, DepthScene, Thing, barrel, crowd, person, rock, wall
from common.config import ConfigError, build
from onboard.people.clusters import Cluster, find_clusters
from onboard.people.config import ClusterConfig, FloorConfig
from onboard.people.depth import Cloud, RayTable
from onboard.people.floor import find_floor

FLOOR, CONFIG = FloorConfig(), ClusterConfig()
UPRIGHT_LENGTH_M = 1.75


def _seen(scene: DepthScene, rng: np.random.Generator | None) -> tuple[list[Cluster], Cloud, np.ndarray]:
    """Clusters of a scene, its cloud, and which thing each point of the cloud belongs to."""
    depth_m, shown = scene.render(rng)
    table = RayTable.of(scene.camera)
    stride = table.stride_for(depth_m, FLOOR.spacing_m, FLOOR.nearest_m, FLOOR.farthest_m)
    cloud = table.cloud(depth_m, stride, FLOOR.nearest_m, FLOOR.farthest_m)
    floor = find_floor(cloud.points_m, FLOOR, np.random.default_rng(0))
    assert floor is not None
    return find_clusters(cloud, floor, CONFIG), cloud, shown[cloud.pixels[:, 1], cloud.pixels[:, 0]]


def _overlap(clusters: Sequence[Cluster], owner: np.ndarray, thing: int) -> tuple[float, Cluster]:
    """Best IoU, in points, of a thing with a cluster that may be a person, and that cluster."""
    true = owner == thing
    scored = []
    for cluster in clusters:
        if cluster.refusal(CONFIG):
            continue
        hits = int(true[cluster.members].sum())
        scored.append((hits / (len(cluster.members) + true.sum() - hits), cluster))
    return max(scored, key=lambda pair: pair[0])


@pytest.mark.parametrize("height_m", [4.0, 6.0, 8.0, 12.0])
def test_people_are_found_at_every_height_with_one_setting(height_m: float):
    rng = np.random.default_rng(int(height_m))
    scene = crowd(rng, height_m)
    clusters, _, owner = _seen(scene, rng)
    postures = {0: "lying", 1: "lying", 2: "sitting", 3: "standing", 4: "jumping"}
    checked = 0
    for number, posture in postures.items():
        # Those whom the picture's edge cuts are not asked for.
        if number < len(scene.things) and scene.things[number].kind == "person" and _inside(scene, number):
            overlap, _ = _overlap(clusters, owner, number)
            assert overlap > 0.6, f"{posture} at {height_m} m"
            checked += 1
    assert checked >= 2


def _inside(scene: DepthScene, number: int) -> bool:
    _, shown = DepthScene((scene.things[number],), scene.height_m, scene.tilt_rad, scene.camera).render()
    body = shown == 0
    return body.any() and not (body[0].any() or body[-1].any() or body[:, 0].any() or body[:, -1].any())


@pytest.mark.parametrize("height_m", [2.5, 5.0, 8.0, 12.0])
def test_sizes_do_not_change_with_the_distance(height_m: float):
    scene = DepthScene((person("lying", 0.1, -0.2, 0.7),), height_m)
    (cluster,), _, _ = _seen(scene, None)
    assert cluster.length_m == pytest.approx(1.65, abs=0.12)
    assert cluster.area_m2 == pytest.approx(0.64, abs=0.06)
    assert cluster.height_m == pytest.approx(0.25, abs=0.03)
    along = scene.camera_R_floor @ [math.cos(0.7), math.sin(0.7), 0.0]
    assert abs(cluster.long_axis @ along) > 0.99


def test_a_standing_person_is_as_high_as_it_is_tall():
    (cluster,), _, _ = _seen(DepthScene((person("standing", 1.0, 0.5, 0.0),), 7.0, (0.1, -0.1)), None)
    assert cluster.height_m == pytest.approx(UPRIGHT_LENGTH_M, abs=0.05)
    assert cluster.refusal(CONFIG) == ""


@pytest.mark.parametrize(
    ("thing", "said"),
    [
        (rock(0.0, 0.0, 0.2), "longest side"),
        (rock(0.0, 0.0, 1.2), "area"),
        (wall(0.0, 0.0, 5.0, 0.4), "area|length"),
        (wall(0.0, 0.0, 0.6, 3.4), "height"),
    ],
)
def test_what_has_not_the_size_of_a_person_is_refused_with_a_reason(thing: Thing, said: str):
    clusters, _, _ = _seen(DepthScene((thing,), 8.0), np.random.default_rng(0))
    reasons = [c.refusal(CONFIG) for c in clusters]
    assert reasons and any(part in reasons[0] for part in said.split("|")), reasons


@pytest.mark.parametrize("height_m", [4.0, 8.0])
@pytest.mark.parametrize(
    "pair",
    [
        (person("lying", 0.0, 0.0, 0.0), person("lying", 0.05, 0.62, 0.0)),
        (person("lying", -0.85, 0.0, 0.0), person("lying", 0.85, 0.1, 3.14)),
        (person("lying", 0.0, 0.0, 0.0), person("standing", 0.1, 0.45, 1.0)),
    ],
    ids=["side by side", "head to head", "one stands over the other"],
)
def test_touching_people_are_told_apart(pair: tuple[Thing, Thing], height_m: float):
    clusters, _, owner = _seen(DepthScene(pair, height_m), np.random.default_rng(1))
    overlaps = [_overlap(clusters, owner, number) for number in (0, 1)]
    assert overlaps[0][1] is not overlaps[1][1], "one cluster for both"
    assert min(o for o, _ in overlaps) > 0.6


@pytest.mark.parametrize("posture", ["lying", "sitting", "standing", "jumping"])
def test_one_person_stays_one(posture: str):
    for seed in range(3):
        scene = DepthScene((person(posture, 0.5, 0.4, 0.9 * seed, 1.95),), 5.0 + seed)
        clusters, _, _ = _seen(scene, np.random.default_rng(seed))
        assert [c.refusal(CONFIG) for c in clusters].count("") == 1


def test_a_person_beside_a_barrel_is_found():
    scene = DepthScene((person("lying", 0.0, 0.0, 0.0), barrel(0.3, 0.6)), 6.0)
    clusters, _, owner = _seen(scene, np.random.default_rng(0))
    overlap, _ = _overlap(clusters, owner, 0)
    assert overlap > 0.55


@pytest.mark.parametrize("height_m", [4.0, 7.0])
def test_somebody_on_whom_a_pipe_ends_is_told_from_it(height_m: float):
    pipe = Thing("pipe", (Capsule(np.array([0.8, 0.0, 0.12]), np.array([2.3, 0.15, 0.12]), 0.12),))
    clusters, _, owner = _seen(DepthScene((person("lying", 0.0, 0.0, 0.0), pipe), height_m), np.random.default_rng(2))
    overlaps = [_overlap(clusters, owner, number) for number in (0, 1)]
    assert overlaps[0][1] is not overlaps[1][1], "one cluster for both"
    assert min(o for o, _ in overlaps) > 0.6


def test_a_wall_is_not_cut_for_its_width():
    clusters, _, _ = _seen(DepthScene((wall(0.0, 0.0, 3.2, 0.5),), 6.0), np.random.default_rng(0))
    assert len(clusters) == 1 and "length" in clusters[0].refusal(CONFIG)


def test_an_empty_floor_has_no_clusters():
    clusters, _, _ = _seen(DepthScene((), 6.0), np.random.default_rng(0))
    assert clusters == []


def test_limits_the_wrong_way_round_are_refused():
    with pytest.raises(ConfigError, match="least_area_m2: got 2"):
        build(ClusterConfig, {"least_area_m2": 2.0}, "test")
    with pytest.raises(ConfigError, match="least_length_m: got 3"):
        build(ClusterConfig, {"least_length_m": 3.0}, "test")
