"""Regions of clusters in the colour picture: one camera, two cameras side by side, and the edge of the picture."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.people_scene import KINECT_2, Capsule, DepthScene, Thing, person
from common.geometry.camera import Camera
from common.geometry.rotation import quat_from_euler
from onboard.people.clusters import find_clusters
from onboard.people.config import ClusterConfig, FloorConfig
from onboard.people.depth import RayTable
from onboard.people.floor import find_floor
from onboard.people.regions import Region, Registration, find_regions

FLOOR = FloorConfig()
WIDE = Camera(960, 540, 530.0, 530.0, 479.5, 269.5, (0.0,) * 5, KINECT_2.body_q_camera, (0.0, 0.0, 0.0))  # pyright: ignore[reportArgumentType]
BASELINE_M = 0.052


def _regions(scene: DepthScene, registration: Registration, rng: np.random.Generator | None) -> list[Region | None]:
    depth_m, _ = scene.render(rng)
    table = RayTable.of(scene.camera)
    stride = table.stride_for(depth_m, FLOOR.spacing_m, FLOOR.nearest_m, FLOOR.farthest_m)
    cloud = table.cloud(depth_m, stride, FLOOR.nearest_m, FLOOR.farthest_m)
    floor = find_floor(cloud.points_m, FLOOR, np.random.default_rng(0))
    assert floor is not None
    clusters = find_clusters(cloud, floor, ClusterConfig())
    return find_regions(clusters, cloud, depth_m, floor, table, registration)


def _whole(region: Region, shape: tuple[int, int]) -> np.ndarray:
    x, y, w, h = region.box_px
    picture = np.zeros(shape, bool)
    picture[y : y + h, x : x + w] = region.mask
    return picture


def _iou(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.count_nonzero(a & b) / np.count_nonzero(a | b))


def _moved(thing: Thing, x_m: float) -> Thing:
    shift = np.array([x_m, 0.0, 0.0])
    shapes = tuple(
        Capsule(s.start_m + shift, s.end_m + shift, s.radius_m) for s in thing.shapes if isinstance(s, Capsule)
    )
    return Thing(thing.kind, shapes)


@pytest.mark.parametrize("height_m", [3.0, 6.0, 10.0])
def test_the_mask_of_an_aligned_sensor_is_the_body(height_m: float):
    scene = DepthScene((person("lying", 0.2, -0.1, 0.5),), height_m)
    registration = Registration.of(KINECT_2, KINECT_2)
    (region,) = _regions(scene, registration, np.random.default_rng(0))
    assert registration.aligned and region is not None and region.camera_p_m is not None
    truth = scene.render()[1] == 0
    assert _iou(_whole(region, truth.shape), truth) > 0.75
    assert region.camera_p_m[2] == pytest.approx(height_m - 0.2, abs=0.06)
    # The head lies where yaw points, at one of the axis' ends.
    head = scene.camera_R_floor @ [0.2 + 0.7 * math.cos(0.5), -0.1 + 0.7 * math.sin(0.5), -height_m + 0.1]
    assert min(np.linalg.norm(end - KINECT_2.project(head)[0]) for end in region.axis()) < 100.0 / height_m


def test_the_top_of_somebody_who_waves_is_the_head_and_not_the_hand():
    """`standing_apart` knows their trunk; the picture alone would take the hand, 0.5 m from the axis."""
    still = person("standing", 0.8, 0.5, 0.4)
    arm = Capsule(np.array([0.8, 0.72, 1.4]), np.array([0.8, 1.15, 2.05]), 0.045)
    crowns = []
    for thing in (still, Thing("person", (*still.shapes, arm))):
        depth_m, table = DepthScene((thing,), 6.0).render(np.random.default_rng(1))[0], RayTable.of(KINECT_2)
        cloud = table.cloud(depth_m, 2, FLOOR.nearest_m, FLOOR.farthest_m)
        floor = find_floor(cloud.points_m, FLOOR, np.random.default_rng(0))
        assert floor is not None
        clusters = [c for c in find_clusters(cloud, floor, ClusterConfig()) if c.trunk_m is not None]
        (region,) = find_regions(clusters, cloud, depth_m, floor, table, Registration.of(KINECT_2, KINECT_2))
        assert region is not None and region.crown is not None
        crowns.append(region.crown)
    assert np.linalg.norm(crowns[0].middle_px - crowns[1].middle_px) * 4.5 / KINECT_2.fx_px < 0.15


def test_two_cameras_side_by_side():
    """The colour camera sits to the right (body y of the mounting that looks along body z) and sees more pixels."""
    colour = replace(WIDE, body_p_camera_m=(BASELINE_M, 0.0, 0.0))
    scene = DepthScene((person("lying", 0.3, 0.2, -0.8),), 4.0)
    registration = Registration.of(KINECT_2, colour)
    (region,) = _regions(scene, registration, None)
    assert region is not None and not registration.aligned
    seen = DepthScene((_moved(scene.things[0], -BASELINE_M),), 4.0, camera=WIDE).render()[1] == 0
    assert _iou(_whole(region, seen.shape), seen) > 0.75
    unregistered = DepthScene((_moved(scene.things[0], BASELINE_M),), 4.0, camera=WIDE).render()[1] == 0
    assert _iou(_whole(region, seen.shape), unregistered) < _iou(_whole(region, seen.shape), seen) - 0.05


def test_registration_turns_and_shifts():
    quarter = quat_from_euler(0.0, 0.0, math.pi / 2)
    colour = replace(
        WIDE,
        body_q_camera=(float(quarter[0]), float(quarter[1]), float(quarter[2]), float(quarter[3])),
        body_p_camera_m=(0.0, 0.1, 0.0),
    )
    points = Registration.of(KINECT_2, colour).points([[1.0, 0.0, 5.0], [0.0, 0.1, 2.0]])
    np.testing.assert_allclose(points, [[-0.1, -1.0, 5.0], [0.0, 0.0, 2.0]], atol=1e-12)


def test_a_body_outside_the_colour_picture_has_no_region():
    narrow = replace(WIDE, fx_px=2500.0, fy_px=2500.0)
    scene = DepthScene((person("lying", 1.9, 0.0, math.pi / 2), person("lying", 0.0, 0.0, 0.0)), 5.0)
    regions = _regions(scene, Registration.of(KINECT_2, narrow), None)
    assert len(regions) == 2 and sum(r is None for r in regions) == 1
    (kept,) = [r for r in regions if r is not None]
    x, y, w, h = kept.box_px
    assert x >= 0 and y >= 0 and x + w <= 960 and y + h <= 540 and kept.mask.shape == (h, w)
