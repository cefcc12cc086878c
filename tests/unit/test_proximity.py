"""From depth pictures to nearest points: closed forms, flying pixels, ground, blindness, closing speed."""

from __future__ import annotations

import itertools
from typing import cast

import numpy as np
import pytest

from common.config import build
from common.geometry.camera import DepthCamera
from common.geometry.config import CamerasConfig
from common.geometry.depth import to_image, to_mm
from common.geometry.rotation import quat_from_euler, quat_rotate
from onboard.proximity.closing import closing_speeds
from onboard.proximity.config import ProximityConfig
from onboard.proximity.lookout import Lookout, Report
from onboard.proximity.pose import Pose, PoseTrack
from onboard.proximity.sectors import SectorGrid
from tests.flying import flying

MS = 1_000_000
FRONT = {
    "width": 320,
    "height": 240,
    "fx_px": 193.0,
    "fy_px": 193.0,
    "cx_px": 159.5,
    "cy_px": 119.5,
    "body_p_camera_m": (0.1, 0.0, 0.0),
    "depth": {"range_max_m": 8.0},
}
SENSOR = cast(DepthCamera, build(CamerasConfig, {"front": FRONT}, "test").by_name()["front"].depth_camera())
RAYS = SENSOR.camera.rays(np.stack(np.meshgrid(np.arange(320), np.arange(240)), -1).reshape(-1, 2)).reshape(240, 320, 3)
LEVEL = quat_from_euler(0.0, 0.0, 0.0)
CONFIG = ProximityConfig()


def scene(height_m: float = 2.0, wall_m: float | None = None) -> np.ndarray:
    """Depth (240, 320), m, of a level camera over flat ground, before a wall across everything at a depth."""
    with np.errstate(divide="ignore"):
        ground = np.where(RAYS[..., 1] > 0, height_m / RAYS[..., 1], np.inf)
    depth = ground if wall_m is None else np.minimum(ground, wall_m)
    return np.where(depth <= 8.0, depth, np.nan).astype(np.float32)


def looked(depth: np.ndarray, height_m: float = 2.0, ned_q_body: np.ndarray = LEVEL, config: ProximityConfig = CONFIG):
    return SectorGrid(SENSOR, config).look(to_mm(depth), ned_q_body, height_m)


def test_a_wall_ahead_is_as_near_as_it_is_in_every_cell_that_shows_it() -> None:
    sight = looked(scene(wall_m=4.0))
    distance = np.linalg.norm(sight.ned_points_m, axis=1)
    assert distance.min() == pytest.approx(4.1, abs=0.01), "from the vehicle's centre, 0.1 m behind the lens"
    np.testing.assert_allclose(sight.ned_points_m[:, 0], 4.1, atol=0.01)
    assert (sight.ned_points_m[:, 2] < 2.0 - CONFIG.ground_m).all(), "nothing of it lies on the ground"
    assert len(sight.ned_points_m) > 40
    assert sight.seen.reshape(8, 12)[2:6].all()


@pytest.mark.parametrize(("roll", "pitch", "yaw"), [(0.2, 0.0, 0.0), (0.0, -0.25, 1.0), (-0.1, 0.15, -2.0)])
def test_points_are_where_they_are_whatever_the_attitude(roll: float, pitch: float, yaw: float) -> None:
    """A ball of depth around the camera: each point lies along its own ray, turned by attitude and mounting."""
    attitude = quat_from_euler(roll, pitch, yaw)
    z = 3.0 / np.linalg.norm(RAYS, axis=-1)
    sight = looked(z.astype(np.float32), height_m=50.0, ned_q_body=attitude, config=ProximityConfig(clearance_m=9.0))
    lens = quat_rotate(attitude, (0.1, 0.0, 0.0))
    np.testing.assert_allclose(np.linalg.norm(sight.ned_points_m - lens, axis=1), 3.0, atol=0.01)
    forward = quat_rotate(attitude, (1.0, 0.0, 0.0))
    assert (sight.ned_points_m @ forward > 1.5).all()


def test_the_ground_brakes_nothing_and_a_thing_on_it_does() -> None:
    depth = scene(height_m=1.5)
    assert len(looked(depth, 1.5).ned_points_m) == 0
    tilted = looked(depth, 1.5, quat_from_euler(0.0, -0.02, 0.0))
    assert len(tilted.ned_points_m) == 0, "an attitude wrong by a degree makes no obstacle of it"
    depth[80:150, 150:170] = 3.0
    points = looked(depth, 1.5).ned_points_m
    assert len(points) >= 1
    np.testing.assert_allclose(points[:, 0], 3.1, atol=0.01)


def test_what_level_flight_passes_over_or_under_is_reported_straight_beneath_or_overhead_and_only_near() -> None:
    high = scene(height_m=6.0)
    roof = np.where(RAYS[..., 1] > 0.4, 2.2 / np.maximum(RAYS[..., 1], 1e-3), np.nan)  # 2.2 m below, 3.8 m high
    depth = np.where(np.isfinite(roof), roof, high).astype(np.float32)
    sight = looked(depth, 6.0, config=ProximityConfig(beneath_m=6.0))
    np.testing.assert_allclose(sight.ned_points_m, [(0.0, 0.0, 2.2)], atol=0.05)
    assert sight.cells.tolist() == [-1]
    assert len(looked(depth, 6.0, config=ProximityConfig(beneath_m=2.0)).ned_points_m) == 0
    np.testing.assert_allclose(
        looked(np.flipud(depth), 20.0, config=ProximityConfig(beneath_m=6.0)).ned_points_m,
        [(0.0, 0.0, -2.2)],
        atol=0.05,
    )


def test_flying_and_single_pixels_are_no_obstacles_and_a_post_is_one() -> None:
    depth = scene(wall_m=6.0)
    rng = np.random.default_rng(4)
    rows, columns = rng.integers(5, 110, 300), rng.integers(5, 315, 300)
    flying = depth.copy()
    flying[rows, columns] = rng.uniform(1.0, 5.0, 300)
    near = np.linalg.norm(looked(flying).ned_points_m, axis=1).min()
    assert near == pytest.approx(6.1, abs=0.05)
    flying[20:100, 160:162] = 3.0  # 2 px: 3 cm across
    assert np.linalg.norm(looked(flying).ned_points_m, axis=1).min() == pytest.approx(3.1, abs=0.05)


def test_open_sky_is_free_and_ground_that_does_not_return_is_not() -> None:
    depth = scene(height_m=2.0)
    seen = looked(depth).seen.reshape(8, 12)
    assert seen[2:6, 2:10].all()
    depth[160:, 100:140] = np.nan
    blind = looked(depth).seen.reshape(8, 12)
    assert not blind[6, 4] and blind[6, 8]
    wary = looked(scene(height_m=2.0), config=ProximityConfig(empty_is_free=False)).seen.reshape(8, 12)
    assert not wary[:4].any() and wary[6, 2:10].all()


def test_corners_that_the_picture_does_not_cover_are_not_seen() -> None:
    seen = looked(scene(wall_m=3.0)).seen.reshape(8, 12)
    assert not seen[0, 0] and not seen[7, 11]
    assert seen[3, 0] and seen[4, 11] and seen[0, 6]


class Flight:
    """A lookout that is shown pictures at 20 Hz from poses."""

    def __init__(self, config: ProximityConfig = CONFIG) -> None:
        self.lookout = Lookout(SENSOR, config)
        self.index = itertools.count(1)
        self.rng = np.random.default_rng(1)

    def show(
        self,
        depth: np.ndarray,
        north: float = 0.0,
        noise_m: float = 0.005,
        stamp: int | None = None,
        ned_q_body: np.ndarray = LEVEL,
    ) -> Report:
        noisy = depth + self.rng.normal(0.0, noise_m, depth.shape) if noise_m else depth
        capture_ns = next(self.index) * 50 * MS if stamp is None else stamp
        pose = Pose(np.array([north, 0.0, -2.0]), ned_q_body)
        return self.lookout.look(to_image("front", noisy.astype(np.float32)), capture_ns, pose)


def test_a_frozen_picture_is_found_as_soon_as_the_vehicle_moves() -> None:
    flight, depth = Flight(), scene(wall_m=5.0)
    assert flight.show(depth, 0.0, noise_m=0.0).blind == ""
    assert flight.show(depth, 0.02, noise_m=0.0).blind == "", "it may stand still"
    report = flight.show(depth, 0.1, noise_m=0.0)
    assert report.blind == "frozen"
    assert not report.obstacles and not any(report.view.seen)
    assert flight.show(depth, 0.2).blind == "", "a new picture is news"


def test_a_picture_that_stays_the_same_too_long_is_frozen_at_rest_too() -> None:
    flight, depth = Flight(), scene(wall_m=5.0)
    reasons = [flight.show(depth, noise_m=0.0).blind for _ in range(14)]
    assert reasons[:10] == [""] * 10 and reasons[-3:] == ["frozen"] * 3


@pytest.mark.parametrize("value", [0.0, np.nan, 0.1, 9.0])
def test_a_picture_of_nothing_is_blind(value: float) -> None:
    """All zero, all NaN, all nearer or farther than the range."""
    report = Flight().show(np.full((240, 320), value), noise_m=0.0)
    assert report.blind == "empty"
    assert not report.obstacles and not any(report.view.seen)


def test_a_repeated_stamp_is_no_news() -> None:
    flight = Flight()
    assert flight.show(scene(wall_m=5.0), stamp=100).blind == ""
    assert flight.show(scene(wall_m=4.0), stamp=100).blind == "repeated"
    assert flight.show(scene(wall_m=4.0), stamp=99).blind == "repeated"


def test_emptiness_is_not_free_where_something_was_close_a_moment_ago() -> None:
    flight, depth = Flight(), scene()
    depth[60:115, 140:180] = 0.6
    assert min(o.distance_m for o in flight.show(depth).obstacles) < 0.8
    depth[60:115, 140:180] = np.nan  # nearer than the sensor measures now
    seen = np.array(flight.show(depth).view.seen).reshape(8, 12)
    assert not seen[2:4, 5:7].any() and seen[2:4, 10].all()
    for _ in range(25):
        later = flight.show(depth)
    assert np.array(later.view.seen).reshape(8, 12)[2:4, 5:7].all()


@pytest.mark.parametrize(("own", "other"), [(0.0, 0.0), (1.5, 0.0), (0.0, 1.4), (1.0, 1.2), (-1.0, 0.0)])
def test_closing_speed_is_the_obstacles_own(own: float, other: float) -> None:
    flight = Flight()
    for index in range(12):
        t_s = 0.05 * index
        depth = scene()
        depth[20:118, 150:172] = 5.0 - (own + other) * t_s
        report = flight.show(depth, own * t_s)
    nearest = min(report.obstacles, key=lambda o: o.distance_m)
    towards = -float(np.dot(nearest.ned_v_m_s, nearest.ned_direction))
    assert towards == pytest.approx(other, abs=0.25)


def test_what_steps_into_the_line_of_sight_has_no_closing_speed() -> None:
    before = np.array([(8.0, 0.0, 0.0)])
    assert closing_speeds(np.array([(3.0, 0.0, 0.0)]), before, 0.3, 0.15, 0.3, 3.0).tolist() == [0.0]
    assert closing_speeds(np.array([(3.0, 0.0, 0.0)]), np.zeros((0, 3)), 0.3, 0.15, 0.3, 3.0).tolist() == [0.0]
    assert closing_speeds(np.zeros((0, 3)), before, 0.3, 0.15, 0.3, 3.0).shape == (0,)


@pytest.mark.parametrize("own_m_s", [-1.5, 0.0, 1.5])
def test_a_wall_that_comes_into_a_turning_view_does_not_rush_up(own_m_s: float) -> None:
    flight = Flight()
    for index in range(16):
        yaw, north = 0.025 * index, 0.05 * index * own_m_s  # 0.5 rad/s
        right = RAYS[..., 2] * np.sin(yaw) + RAYS[..., 0] * np.cos(yaw)
        ahead = RAYS[..., 2] * np.cos(yaw) - RAYS[..., 0] * np.sin(yaw)
        across = right + 0.5 * ahead
        with np.errstate(divide="ignore"):
            wall = np.where(across > 0, (4.0 - 0.5 * north) / across, np.inf)  # oblique, its near end to the right
        depth = np.where(wall <= 8.0, wall, np.nan)
        report = flight.show(depth, north, ned_q_body=quat_from_euler(0.0, 0.0, yaw))
        assert len(report.obstacles) > 5
        assert all(np.linalg.norm(o.ned_v_m_s) == 0.0 for o in report.obstacles), index


def test_noise_of_the_range_moves_the_distance_by_centimetres_at_most() -> None:
    rng = np.random.default_rng(7)
    for wall_m in (2.0, 5.0, 7.5):
        depth = scene(wall_m=wall_m)
        sigma = 0.004 + 0.0008 * wall_m**2
        near = [
            np.linalg.norm(looked((depth + rng.normal(0, sigma, depth.shape)).astype(np.float32)).ned_points_m, axis=1)
            for _ in range(5)
        ]
        assert abs(np.median([n.min() for n in near]) - wall_m - 0.1) < 0.02 + 2.5 * sigma


def test_poses_between_and_just_after_the_states_and_none_elsewhere() -> None:
    track = PoseTrack()
    assert track.at(0) is None
    track.add(100 * MS, flying(ned_p_m=(1.0, 0.0, -2.0)))
    track.add(200 * MS, flying(ned_p_m=(2.0, 0.0, -2.0)))
    track.add(150 * MS, flying(ned_p_m=(9.0, 0.0, -2.0)))  # late: dropped
    for t_ms, north in ((100, 1.0), (150, 1.5), (200, 2.0), (290, 2.0)):
        pose = track.at(t_ms * MS)
        assert pose is not None
        assert pose.ned_p_m[0] == pytest.approx(north)
    assert track.at(99 * MS) is None and track.at(301 * MS) is None
