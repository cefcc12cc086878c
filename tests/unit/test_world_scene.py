"""The scene: where things are, what hides the car, what the pictures show."""

import numpy as np
import pytest

from common.geometry.config import CameraConfig, FrontCameraConfig
from common.geometry.rotation import quat_from_euler
from simulation.world.renderer import Canvas, Renderer, camera_pose, ned_to_pixels
from simulation.world.scenario import CarConfig, GroundConfig, OccluderConfig, ScenarioConfig, load_scenario
from simulation.world.scene import CarPose, Scene

PLAIN = GroundConfig(kind="snow", size_m=20.0, texture_px=256, trees=0, houses=0)
CAMERA = CameraConfig().camera()


def picture_of(
    scene: Scene, car: CarPose, eye: tuple[float, float, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Picture from a level vehicle, and the pose of its camera."""
    scene.place(car, [], eye)
    ned_eye, ned_q_eye = camera_pose(CAMERA, eye, quat_from_euler(0.0, 0.0, 0.0))
    canvas = Canvas(scene)
    renderer = Renderer(canvas, CAMERA)
    try:
        return renderer.render(ned_eye, ned_q_eye), ned_eye, ned_q_eye
    finally:
        canvas.close()


def test_the_parts_of_the_car_are_where_its_pose_puts_them() -> None:
    scene = Scene(ScenarioConfig(ground=PLAIN), CAMERA.width, CAMERA.height)
    car = CarPose((0.6, -0.8), np.deg2rad(140.0))
    picture, ned_eye, ned_q_eye = picture_of(scene, car, (0.0, 0.0, -4.0))

    def colour_at(forward_m: float, right_m: float, height_m: float) -> np.ndarray:
        c, s = np.cos(car.heading_rad), np.sin(car.heading_rad)
        point = (0.6 + c * forward_m - s * right_m, -0.8 + s * forward_m + c * right_m, -height_m)
        column, row = np.round(ned_to_pixels(CAMERA, ned_eye, ned_q_eye, [point])[0]).astype(int)
        return picture[row - 1 : row + 2, column - 1 : column + 2].reshape(-1, 3).mean(axis=0)

    bonnet, roof, boot = colour_at(0.36, 0.0, 0.17), colour_at(0.0, 0.0, 0.3), colour_at(-0.38, 0.0, 0.18)
    stripe = colour_at(0.36, 0.19, 0.16)
    assert bonnet[2] > 2 * max(bonnet[0], bonnet[1])  # red
    assert roof.min() > 150  # white
    assert boot[0] > 2 * boot[2]  # blue
    assert stripe[2] > 120 and stripe[1] > 90 and stripe[0] < 60  # yellow, on its right-hand side


def test_the_outline_encloses_the_car_in_the_picture() -> None:
    magenta = CarConfig(bonnet="#ff00ff", roof="#ff00ff", boot="#ff00ff", stripe="#ff00ff")
    scene = Scene(ScenarioConfig(ground=PLAIN, car=magenta), CAMERA.width, CAMERA.height)
    car = CarPose((0.4, 0.7), 0.0)
    picture, ned_eye, ned_q_eye = picture_of(scene, car, (0.0, 0.0, -5.0))
    blue, green, red = (picture[..., i].astype(int) for i in range(3))
    rows, columns = np.nonzero((red - green > 60) & (blue - green > 60))
    corners = ned_to_pixels(CAMERA, ned_eye, ned_q_eye, scene.outline(car))
    centre = np.array([columns.min() + columns.max(), rows.min() + rows.max()]) / 2
    # The car's height leans it outwards by a pixel or two.
    assert np.abs(centre - (corners.min(axis=0) + corners.max(axis=0)) / 2).max() < 2.5
    extent = np.array([np.ptp(columns), np.ptp(rows)])
    assert np.abs(extent - np.ptp(corners, axis=0)).max() < 4.0


def test_a_bridge_hides_the_car_under_it_and_nowhere_else() -> None:
    bridge = OccluderConfig(north_m=0.0, east_m=3.0, heading_deg=0.0, width_m=1.3, span_m=4.0, height_m=1.3)
    scene = Scene(ScenarioConfig(ground=PLAIN, occluders=(bridge,)), CAMERA.width, CAMERA.height)
    hidden = {}
    for east in (0.0, 2.2, 3.0):
        car = CarPose((0.0, east), np.pi / 2)
        scene.place(car, [], (0.0, east, -5.0))
        hidden[east] = scene.occluded((0.0, east, -5.0), scene.samples(car)).mean()
    assert hidden[0.0] == 0.0
    assert 0.0 < hidden[2.2] < 1.0
    assert hidden[3.0] == 1.0


def test_props_out_of_view_are_not_drawn_and_come_back() -> None:
    bridge = OccluderConfig(north_m=0.0, east_m=3.0)
    scene = Scene(ScenarioConfig(ground=PLAIN, occluders=(bridge,)), CAMERA.width, CAMERA.height)
    car = CarPose((0.0, 3.0), np.pi / 2)
    eye = (0.0, 3.0, -5.0)
    scene.show_near((-30.0, 0.0, -5.0), 5.0)
    assert not scene.occluded(eye, scene.samples(car)).any()
    scene.show_near(eye, 5.0)
    assert scene.occluded(eye, scene.samples(car)).all()


@pytest.mark.parametrize("kind", ["meadow", "gravel", "snow"])
def test_the_ground_has_texture(kind: str) -> None:
    ground = GroundConfig(kind=kind, size_m=12.0, texture_px=1024, trees=0, houses=0)  # type: ignore[arg-type]
    scene = Scene(ScenarioConfig(ground=ground), CAMERA.width, CAMERA.height)
    picture, _, _ = picture_of(scene, CarPose((50.0, 0.0), 0.0), (-2.5, -2.0, -3.0))
    patch = picture[:200, :200].astype(float)
    assert patch.std(axis=(0, 1)).min() > 3.0


def test_there_is_sky_above_the_horizon_and_the_ground_stays_as_it_is() -> None:
    scene = Scene(ScenarioConfig(ground=PLAIN), CAMERA.width, CAMERA.height)
    scene.place(CarPose((0.6, -0.8), 0.0), [], (0.0, 0.0, -3.0))
    ahead = FrontCameraConfig(width=160, height=120, fx_px=96.0, fy_px=96.0, cx_px=79.5, cy_px=59.5).camera()
    canvas = Canvas(scene)
    front = Renderer(canvas, ahead)
    try:
        picture = front.render(*camera_pose(ahead, (0.0, 0.0, -3.0), quat_from_euler(0.0, 0.0, 0.0))).astype(int)
        depth = front.depth(*camera_pose(ahead, (0.0, 0.0, -3.0), quat_from_euler(0.0, 0.0, 0.0)), 50.0)
    finally:
        canvas.close()
    sky, ground = picture[:58], picture[66:]
    assert (sky[..., 0] > sky[..., 2]).all() and sky.min() > 60, "blue"
    assert sky[0].mean() < sky[-1].mean(), "paler towards the horizon"
    assert (ground[..., 0] <= ground[..., 2] + 30).mean() > 0.9, "and below it what was there before"
    assert np.isnan(depth[:58]).all(), "nothing returns from the sky"


def test_a_seed_decides_the_scene() -> None:
    def look(seed: int) -> np.ndarray:
        ground = GroundConfig(size_m=16.0, texture_px=512, trees=6, houses=1)
        scene = Scene(ScenarioConfig(seed=seed, ground=ground), CAMERA.width, CAMERA.height)
        return picture_of(scene, CarPose((1.0, 0.0), 0.0), (0.0, 0.0, -6.0))[0]

    first = look(5)
    assert (first == look(5)).all()
    assert (first != look(6)).mean() > 0.3


@pytest.mark.parametrize("name", ["chase", "rough"])
def test_occluders_hide_the_car_from_five_metres_for_a_third_of_a_second_to_one(name: str) -> None:
    scenario = load_scenario(name)
    scene = Scene(scenario, 64, 48)
    path = scene.path
    lap_s = path.t_s[-1] - path.t_s[path.lap_from]
    times = path.delay_s + path.t_s[path.lap_from] + np.arange(0.0, lap_s, 0.05)
    motion = path.at(times)
    full = []
    for (north, east), heading in zip(motion.ned_p_m, motion.heading_rad, strict=True):
        car, eye = CarPose((north, east), heading), (north, east, -5.0)
        scene.show_near(eye, 6.0)
        full.append(scene.occluded(eye, scene.samples(car)).all())
    edges = np.diff(np.concatenate(([0], np.array(full, int), [0])))
    durations = (np.flatnonzero(edges == -1) - np.flatnonzero(edges == 1)) * 0.05
    assert len(durations) == len(scenario.occluders)
    assert durations.min() >= 0.3 and durations.max() <= 1.0
