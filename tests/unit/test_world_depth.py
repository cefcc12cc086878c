"""Depth pictures of the simulated world against closed forms; noise and failures of the sensor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from common.config import build
from common.geometry.camera import DepthCamera
from common.geometry.config import CameraConfig, CamerasConfig
from common.geometry.depth import in_m, to_image
from common.geometry.rotation import quat_from_euler
from common.messages import Image
from simulation.world.config import WorldConfig
from simulation.world.depth_config import DepthFaultConfig, DepthNoiseConfig
from simulation.world.depth_noise import DepthNoise
from simulation.world.objects_config import BarrelConfig, PersonConfig, WallConfig
from simulation.world.path_config import PathConfig, WaypointConfig
from simulation.world.renderer import Canvas, Renderer, camera_pose
from simulation.world.scenario import GroundConfig, ScenarioConfig
from simulation.world.scene import CarPose, Scene
from simulation.world.stage import Stage
from simulation.world.truth_filter import Motion

PLAIN = GroundConfig(kind="snow", size_m=20.0, texture_px=256, trees=0, houses=0, road=False)
FRONT = {"width": 160, "height": 120, "fx_px": 100.0, "fy_px": 100.0, "cx_px": 79.5, "cy_px": 59.5}
VEHICLE = {"front": {**FRONT, "depth": {"range_max_m": 8.0}}}
SEC = 1_000_000_000
WALL = WallConfig(start=(5.0, -20.0), end=(5.0, 20.0), thickness_m=0.2, height_m=6.0)


def cameras(tables: dict) -> CamerasConfig:
    """Section `[camera]` from plain data."""
    return build(CamerasConfig, tables, "test")


def at(north: float, up: float, t_s: float = 0.0, yaw: float = 0.0) -> Motion:
    """A level vehicle, at rest."""
    attitude = quat_from_euler(0.0, 0.0, yaw)
    return Motion(int(t_s * SEC) + 1, np.array([north, 0.0, -up]), np.zeros(3), attitude, np.zeros(3))


class Look:
    """A stage and its front depth, in metres."""

    def __init__(self, scenario: ScenarioConfig, vehicle: dict | None = None) -> None:
        section = cameras(vehicle or VEHICLE)
        found = section.by_name()["front"].depth_camera()
        assert found is not None
        self.sensor: DepthCamera = found
        self.stage = Stage(WorldConfig(), scenario, section)

    def depth(self, motion: Motion) -> np.ndarray:
        self.stage.place(motion)
        data = self.stage.depth(motion.t_ns, "front")
        assert data is not None
        c = self.sensor.camera
        return in_m(Image(camera="front", width=c.width, height=c.height, encoding="depth_mm", data=data))


@pytest.fixture
def close() -> Iterator[list[Look]]:
    made: list[Look] = []
    yield made
    for look in made:
        look.stage.close()


def test_a_wall_has_one_depth_all_over_and_the_ground_its_own_by_row(close: list[Look]) -> None:
    look = Look(ScenarioConfig(ground=PLAIN, walls=(WALL,)))
    close.append(look)
    depth = look.depth(at(0.0, 2.0))
    camera = look.sensor.camera
    wall_m = 4.9 - camera.body_p_camera_m[0]
    # Depth runs along the optical axis, not along the ray: the same in the corners as in the middle.
    np.testing.assert_allclose(depth[:60], wall_m, atol=0.002)
    rows = np.arange(camera.height)
    with np.errstate(divide="ignore"):
        ground_m = 2.0 / ((rows - camera.cy_px) / camera.fy_px)  # z = height / tangent of the row
    below = rows[(rows > camera.cy_px) & (ground_m < wall_m - 0.05)]
    assert len(below) > 10
    np.testing.assert_allclose(depth[below], np.repeat(ground_m[below][:, None], camera.width, 1), atol=0.004)


def test_beyond_the_range_and_in_the_sky_there_is_nothing(close: list[Look]) -> None:
    look = Look(ScenarioConfig(ground=PLAIN, walls=(WALL,)))
    close.append(look)
    depth = look.depth(at(-3.5, 2.0))  # the wall is 8.3 m away
    ground_m = 2.0 / ((np.arange(60, 120) - 59.5) / 100.0)
    assert np.isnan(depth[:60]).all()
    assert np.isnan(depth[60:][ground_m > 8.01]).all()
    assert np.isfinite(depth[60:][ground_m < 7.99]).all()
    assert np.isnan(look.depth(at(4.75, 2.0))).sum() > 3000, "nearer than range_min there is nothing either"


def test_depth_is_aligned_with_colour(close: list[Look]) -> None:
    """The outline of a magenta barrel is the same in both pictures, at half the size too."""
    barrel = BarrelConfig(north_m=3.0, east_m=0.4, radius_m=0.3, height_m=3.0, colour="#ff00ff")
    half = {"front": {**FRONT, "depth": {"width": 80, "height": 60}}}
    look = Look(ScenarioConfig(ground=PLAIN, barrels=(barrel,)), half)
    close.append(look)
    motion = at(0.0, 1.5, yaw=0.1)
    depth = look.depth(motion)
    data = look.stage.picture(motion.t_ns, "front")
    assert data is not None
    bgr = np.frombuffer(data, np.uint8).reshape(120, 160, 3).astype(int)
    in_colour = (bgr[..., 2] - bgr[..., 1] > 40) & (bgr[..., 0] - bgr[..., 1] > 40)
    in_depth = depth < 3.05
    columns = [np.flatnonzero(mask[10:20].any(axis=0)) for mask in (in_colour, in_depth)]
    assert len(columns[1]) > 5
    # A pixel of half the size covers columns 2 c and 2 c + 1.
    assert abs(columns[0].min() - 2 * columns[1].min()) <= 2
    assert abs(columns[0].max() - (2 * columns[1].max() + 1)) <= 2


def test_a_sensor_with_its_own_mounting_sees_from_there(close: list[Look]) -> None:
    own = {**FRONT, "aligned": False, "camera_p_depth_m": (0.0, 0.0, 0.5)}
    look = Look(ScenarioConfig(ground=PLAIN, walls=(WALL,)), {"front": {**FRONT, "depth": own}})
    close.append(look)
    assert look.depth(at(0.0, 2.0))[10, 80] == pytest.approx(4.9 - 0.1 - 0.5, abs=0.002)


def test_a_distorted_lens_bends_the_depth_picture(close: list[Look]) -> None:
    bent = {"front": {**FRONT, "distortion": (-0.2, 0.05, 0.0, 0.0, 0.0), "depth": {}}}
    look = Look(ScenarioConfig(ground=PLAIN), bent)
    close.append(look)
    depth = look.depth(at(0.0, 2.0))
    camera = look.sensor.camera
    pixels = np.array([(c, r) for r in (90, 100, 115) for c in (5, 40, 80, 155)], float)
    expected = 2.0 / camera.rays(pixels)[:, 1]
    for (column, row), z in zip(pixels.astype(int), expected, strict=True):
        assert depth[row, column] == pytest.approx(z, rel=0.02)


SENSOR = DepthCamera(CameraConfig(width=320, height=240, cx_px=159.5, cy_px=119.5).camera(), 0.3, 8.0)


def measured(config: DepthNoiseConfig, true_m: np.ndarray, seed: int = 1) -> np.ndarray:
    return DepthNoise(config, SENSOR, np.random.default_rng(seed)).applied(true_m.astype(np.float32))


def test_noise_grows_with_the_square_of_the_range_and_is_seeded() -> None:
    config = DepthNoiseConfig(noise_m=0.004, noise_per_m=0.001)
    for z in (1.0, 3.0, 6.0):
        error = measured(config, np.full((240, 320), z)) - z
        assert float(error.std()) == pytest.approx(0.004 + 0.001 * z * z, rel=0.05)
        assert abs(float(error.mean())) < 0.001
    flat = np.full((240, 320), 2.0)
    np.testing.assert_array_equal(measured(config, flat), measured(config, flat))
    assert (measured(config, flat) != measured(config, flat, seed=2)).mean() > 0.9


def test_edges_have_flying_pixels_between_the_sides_and_holes_and_nothing_else_does() -> None:
    true_m = np.full((240, 320), 6.0)
    true_m[:, 100:200] = 2.0
    got = measured(DepthNoiseConfig(flying=0.4, edge_holes=0.2), true_m)
    on_edge = np.zeros_like(true_m, bool)
    on_edge[:, [99, 100, 199, 200]] = True
    np.testing.assert_array_equal(got[~on_edge], true_m[~on_edge].astype(np.float32))
    values = got[on_edge]
    between = (values > 2.0) & (values < 6.0)
    assert 0.3 < between.mean() < 0.5
    assert 0.1 < np.isnan(values).mean() < 0.3


def test_holes_become_more_with_the_range_and_steps_round() -> None:
    config = DepthNoiseConfig(holes=0.2, step_m=0.05)
    near, far = (measured(config, np.full((240, 320), z)) for z in (2.02, 7.98))
    assert np.isnan(near).mean() == pytest.approx(0.2 * (2.02 / 8) ** 2, rel=0.2)
    assert np.isnan(far).mean() == pytest.approx(0.2, rel=0.1)
    assert set(np.round(near[np.isfinite(near)], 3)) == {np.float32(2.0)}


@pytest.mark.parametrize("kind", ["frozen", "zero", "silent"])
def test_a_fault_begins_on_approach_and_ends_in_time(close: list[Look], kind: str) -> None:
    fault = DepthFaultConfig(kind=kind, within_m=3.0, for_s=1.0)  # type: ignore[arg-type]
    look = Look(ScenarioConfig(ground=PLAIN, walls=(WALL,), depth_faults=(fault,)))
    close.append(look)

    def data(north: float, t_s: float) -> bytes | None:
        motion = at(north, 2.0, t_s)
        look.stage.place(motion)
        return look.stage.depth(motion.t_ns, "front")

    healthy = data(0.0, 0.0)
    faulty = data(2.5, 1.0)
    assert faulty == {"frozen": healthy, "zero": bytes(len(healthy or b"")), "silent": None}[kind]
    assert data(3.0, 1.9) == faulty
    later = data(3.0, 2.1)
    assert later not in (None, faulty) and len(later) == 160 * 120 * 2


def test_truth_tells_how_near_every_surface_is(close: list[Look]) -> None:
    walk = PathConfig(
        mode="ping_pong",
        waypoints=(WaypointConfig(north_m=4.0, east_m=0.0), WaypointConfig(north_m=4.0, east_m=6.0)),
    )
    scenario = ScenarioConfig(
        ground=PLAIN,
        walls=(WALL,),
        barrels=(BarrelConfig(north_m=-3.0, east_m=0.0, radius_m=0.5, height_m=1.0),),
        people=(PersonConfig(north_m=0.0, east_m=2.0), PersonConfig(path=walk)),
    )
    look = Look(scenario)
    close.append(look)
    truth = {o.label: o for o in look.stage.place(at(0.0, 2.0)).obstacles}
    assert set(truth) == {"wall 1", "barrel 1", "person 1", "person 2"}
    assert truth["wall 1"].distance_m == pytest.approx(4.9, abs=1e-3)
    assert truth["wall 1"].ned_nearest_m == pytest.approx((4.9, 0.0, -2.0), abs=1e-2)
    assert truth["barrel 1"].distance_m == pytest.approx(np.hypot(2.5, 1.0), abs=1e-3)  # the rim of its lid
    assert 1.5 < truth["person 1"].distance_m < 2.0
    moving = {o.label: o for o in look.stage.place(at(0.0, 2.0, t_s=3.0)).obstacles}["person 2"]
    assert moving.ned_v_m_s == pytest.approx((0.0, 1.0, 0.0), abs=1e-6)
    assert moving.ned_p_m[1] == pytest.approx(2.5, abs=0.1)  # 1 m/s, after half a metre of speeding up
    assert moving.distance_m < truth["person 2"].distance_m + 2.5


def test_limbs_swing_only_while_someone_walks() -> None:
    walk = PathConfig(waypoints=tuple(WaypointConfig(north_m=n, east_m=e) for n, e in ((0, 0), (0, 9), (9, 9))))
    scene = Scene(ScenarioConfig(ground=PLAIN, people=(PersonConfig(path=walk), PersonConfig())), 64, 48)
    poses = []
    for t_s in (-1.0, 2.1, 2.6):
        scene.place(CarPose((0.0, -9.0), 0.0), [], (0.0, 0.0, -5.0), t_s)
        poses.append(scene.data.qpos.copy())
    joint = scene.model.joint
    first, walker = scene.model.nq // 2, {side: int(joint(f"person 1 thigh_{side}").qposadr[0]) for side in ("l", "r")}
    assert np.abs(poses[1][:first] - poses[0][:first]).max() > 0.05
    assert not np.allclose(poses[1][:first], poses[2][:first])
    change = [poses[2][walker[side] + 2] - poses[1][walker[side] + 2] for side in ("l", "r")]
    assert change[0] * change[1] < 0, "the legs swing against each other"
    np.testing.assert_array_equal(poses[1][first:], poses[0][first:])
    np.testing.assert_array_equal(poses[2][first:], poses[0][first:])


def test_depth_of_a_range_survives_the_way_over_the_bus() -> None:
    depth = np.array([[0.0004, 0.3, 7.9996], [np.nan, 65.6, -1.0]], np.float32)
    back = in_m(to_image("front", depth))
    np.testing.assert_allclose(back[0, 1:], [0.3, 8.0], atol=1e-4)
    assert np.isnan(back[0, 0]) and np.isnan(back[1]).all()


def test_a_camera_whose_colour_is_larger_shares_the_canvas() -> None:
    scene = Scene(ScenarioConfig(ground=PLAIN, walls=(WALL,)), 320, 240)
    canvas = Canvas(scene)
    try:
        small, large = CameraConfig(**FRONT).camera(), CameraConfig(**FRONT).camera().resized(320, 240)
        mounted = [replace(c, body_q_camera=(0.5, 0.5, 0.5, 0.5)) for c in (small, large)]
        renderers = [Renderer(canvas, c) for c in mounted]
        scene.place(CarPose((-9.0, 0.0), 0.0), [], (0.0, 0.0, -2.0))
        pose = camera_pose(mounted[0], (0.0, 0.0, -2.0), quat_from_euler(0.0, 0.0, 0.0))
        for renderer in (*renderers, *renderers):
            assert float(renderer.depth(*pose, 8.0)[5, 5]) == pytest.approx(4.9, abs=0.002)
            assert renderer.render(*pose).any()
    finally:
        canvas.close()
