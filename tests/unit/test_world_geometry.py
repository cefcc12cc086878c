"""The renderer's pictures agree with the camera model that every algorithm uses."""

from dataclasses import replace

import numpy as np
import pytest

from common.geometry.camera import Camera
from common.geometry.config import CameraConfig
from common.geometry.rotation import quat_from_euler
from simulation.world.gl import mujoco
from simulation.world.renderer import Canvas, Renderer, camera_pose, ned_to_pixels
from simulation.world.scene import NWU_FROM_NED

# Colour (BGR) of each ball and its centre, NED, m.
BALLS = {
    (255, 0, 0): (1.2, 1.5, -0.2),
    (0, 255, 0): (-1.1, -1.9, -0.05),
    (0, 0, 255): (0.9, -1.6, -0.6),
    (255, 255, 0): (-1.0, 1.3, -0.3),
    (255, 0, 255): (0.1, 0.2, -0.4),
}
DOWN = CameraConfig().camera()
CAMERAS = {
    "default": DOWN,
    "off_centre": replace(DOWN, fx_px=430.0, fy_px=395.0, cx_px=301.0, cy_px=255.5),
    "small": replace(DOWN, width=320, height=200, fx_px=200.0, fy_px=210.0, cx_px=150.0, cy_px=108.0),
    "barrel": replace(DOWN, distortion=(-0.21, 0.05, 0.001, -0.002, 0.0)),
    "mounted": replace(DOWN, body_p_camera_m=(0.1, -0.05, 0.08)),
}
POSES = {
    "level": ((0.0, 0.0, -5.0), (0.0, 0.0, 0.0)),
    "turned": ((0.3, -0.2, -4.6), (0.0, 0.0, 2.1)),
    "tilted": ((-0.4, 0.3, -5.3), (0.14, -0.11, -0.8)),
}


class Balls:
    """Small bright balls above a black floor."""

    def __init__(self) -> None:
        spec = mujoco.MjSpec()
        spec.visual.quality.offsamples = 0
        spec.visual.global_.offwidth, spec.visual.global_.offheight = 640, 480
        spec.visual.headlight.ambient = [1.0, 1.0, 1.0]
        spec.visual.headlight.diffuse = spec.visual.headlight.specular = [0.0, 0.0, 0.0]
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[50, 50, 1], rgba=[0, 0, 0, 1])
        for (blue, green, red), ned in BALLS.items():
            spec.worldbody.add_geom(
                type=mujoco.mjtGeom.mjGEOM_SPHERE,
                size=[0.05, 0, 0],
                pos=np.array(ned) * NWU_FROM_NED,
                rgba=[red / 255, green / 255, blue / 255, 1],
            )
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        mujoco.mj_kinematics(self.model, self.data)

    def show_near(self, ned_m: object, radius_m: float) -> None:
        assert radius_m > 3.0, "the corners of the picture lie farther away than this"


def centroid(picture: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    """Centre of the pixels that lean towards a colour, (2,), px."""
    wanted = np.array(colour) > 0
    rows, columns = np.nonzero(((picture > 90) == wanted).all(axis=2))
    assert len(rows) >= 10, f"ball {colour} is not in the picture"
    return np.array([columns.mean(), rows.mean()])


@pytest.mark.parametrize("camera_name", CAMERAS)
def test_rendered_points_lie_where_the_camera_projects_them(camera_name: str) -> None:
    camera: Camera = CAMERAS[camera_name]
    canvas = Canvas(Balls())
    renderer = Renderer(canvas, camera)
    compared = 0
    try:
        for ned_p_body, euler in POSES.values():
            ned_eye, ned_q_eye = camera_pose(camera, ned_p_body, quat_from_euler(*euler))
            picture = renderer.render(ned_eye, ned_q_eye)
            assert picture.shape == (camera.height, camera.width, 3)
            expected = ned_to_pixels(camera, ned_eye, ned_q_eye, list(BALLS.values()))
            for colour, pixel in zip(BALLS, expected, strict=True):
                if 12 < pixel[0] < camera.width - 12 and 12 < pixel[1] < camera.height - 12:
                    assert np.linalg.norm(centroid(picture, colour) - pixel) < 0.5
                    compared += 1
    finally:
        canvas.close()
    assert compared >= 10


def test_camera_pose_puts_the_mounting_behind_the_attitude() -> None:
    camera = replace(DOWN, body_p_camera_m=(0.2, 0.0, 0.0))
    ned_eye, _ = camera_pose(camera, (1.0, 2.0, -3.0), quat_from_euler(0.0, 0.0, np.pi / 2))
    np.testing.assert_allclose(ned_eye, (1.0, 2.2, -3.0), atol=1e-9)
