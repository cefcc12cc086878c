"""The floor's plane against planes in closed form: slopes, walls, noise, and when there is none."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.people_scene import DepthScene, crowd
from common.config import ConfigError, build
from common.geometry.rotation import quat_from_euler
from onboard.people.config import FloorConfig
from onboard.people.depth import RayTable
from onboard.people.floor import find_floor, up_in_camera

CONFIG = FloorConfig()
DOWN = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))


def _plane(tilt_deg: float, height_m: float, count: int = 3000, sigma_m: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) of a plane whose normal leans towards x, and the normal."""
    rng = np.random.default_rng(5)
    up = np.array([math.sin(math.radians(tilt_deg)), 0.0, -math.cos(math.radians(tilt_deg))])
    xy = rng.uniform(-0.6 * height_m, 0.6 * height_m, (count, 2))
    z = (-height_m - xy[:, 0] * up[0]) / up[2]
    points = np.column_stack((xy, z)) + up * rng.normal(size=(count, 1)) * sigma_m
    return points.astype(np.float32), up


@pytest.mark.parametrize("tilt_deg", [0.0, 5.0, -14.0])
@pytest.mark.parametrize("height_m", [2.0, 6.0, 12.0])
def test_a_plane_is_found_exactly(tilt_deg: float, height_m: float):
    points, up = _plane(tilt_deg, height_m)
    floor = find_floor(points, CONFIG, np.random.default_rng(0))
    assert floor is not None
    np.testing.assert_allclose(floor.up, up, atol=1e-5)
    assert floor.camera_height_m == pytest.approx(height_m, abs=1e-4)
    assert (floor.share, floor.band_m) == (1.0, CONFIG.least_band_m)
    np.testing.assert_allclose(floor.heights_m(points), 0.0, atol=1e-4)


def test_the_noise_is_measured_and_sets_the_band():
    points, up = _plane(3.0, 6.0, sigma_m=0.025)
    floor = find_floor(points, CONFIG, np.random.default_rng(0))
    assert floor is not None
    assert floor.sigma_m == pytest.approx(0.025, rel=0.1)
    assert floor.band_m == pytest.approx(3 * floor.sigma_m)
    assert math.degrees(math.acos(floor.up @ up)) < 0.1


def test_things_on_the_floor_do_not_lift_it():
    points, up = _plane(6.0, 5.0, sigma_m=0.01)
    rng = np.random.default_rng(1)
    lying = rng.choice(len(points), 1200, replace=False)
    points[lying] += (up * rng.uniform(0.02, 1.5, (1200, 1))).astype(np.float32)
    floor = find_floor(points, CONFIG, np.random.default_rng(0))
    assert floor is not None
    assert math.degrees(math.acos(floor.up @ up)) < 0.2
    assert floor.camera_height_m == pytest.approx(5.0, abs=0.01)


def test_a_steep_slope_needs_the_attitude():
    points, up = _plane(25.0, 5.0)
    assert find_floor(points, CONFIG, np.random.default_rng(0)) is None
    # The vehicle rolls to the left: what lies on its right hand, the picture's x axis, rises.
    known = up_in_camera(quat_from_euler(math.radians(-25.0), 0.0, 0.0), DOWN)
    np.testing.assert_allclose(known, up, atol=1e-9)
    floor = find_floor(points, CONFIG, np.random.default_rng(0), known)
    assert floor is not None
    np.testing.assert_allclose(floor.up, up, atol=1e-5)


def test_a_wall_with_more_points_is_not_the_floor():
    points, up = _plane(0.0, 5.0, count=1000)
    rng = np.random.default_rng(2)
    wall = np.column_stack((np.full(1800, 2.0), rng.uniform(-3, 3, 1800), rng.uniform(1, 5, 1800))).astype(np.float32)
    floor = find_floor(np.vstack((points, wall)), CONFIG, np.random.default_rng(0))
    assert floor is not None
    assert floor.up @ up > 0.9999
    assert floor.share == pytest.approx(0.36, abs=0.03)


def test_no_plane_no_floor():
    ball = np.random.default_rng(3).normal(size=(2000, 3)).astype(np.float32) * 2.0 + [0, 0, 8]
    assert find_floor(ball.astype(np.float32), CONFIG, np.random.default_rng(0)) is None
    assert find_floor(np.zeros((2, 3), np.float32), CONFIG, np.random.default_rng(0)) is None
    assert find_floor(np.ones((500, 3), np.float32), CONFIG, np.random.default_rng(0)) is None


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_noisy_picture_of_a_crowd(seed: int):
    rng = np.random.default_rng(seed)
    scene: DepthScene = crowd(rng, 6.0)
    cloud = RayTable.of(scene.camera).cloud(scene.render(rng)[0], 4, 0.4, 14.0)
    floor = find_floor(cloud.points_m, CONFIG, rng)
    assert floor is not None
    assert math.degrees(math.acos(floor.up @ scene.camera_R_floor[:, 2])) < 0.1
    assert floor.camera_height_m == pytest.approx(6.0, abs=0.02)


def test_bounds_the_wrong_way_round_are_refused():
    with pytest.raises(ConfigError, match=r"least_band_m: got 0\.2, expected at most band_m"):
        build(FloorConfig, {"least_band_m": 0.2}, "test")
    with pytest.raises(ConfigError, match="nearest_m: got 20"):
        build(FloorConfig, {"nearest_m": 20}, "test")
