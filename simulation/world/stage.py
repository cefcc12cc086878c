"""The simulated world as the vehicle's cameras see it at a given motion: no clock, no bus, no thread of its own."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np

from common.geometry.camera import Camera
from common.geometry.config import CamerasConfig
from common.geometry.rotation import as_quat, as_vec3
from common.topics import CAMERAS
from common.truth import Truth
from simulation.world.config import WorldConfig
from simulation.world.eye import ColourEye, DepthEye
from simulation.world.path import CarPath
from simulation.world.renderer import Canvas, camera_pose, ned_to_pixels
from simulation.world.scenario import ScenarioConfig
from simulation.world.scene import CarPose, Scene
from simulation.world.truth_filter import Motion

_MOSTLY = 0.5


class Stage:
    """Scene, cameras, light and video link of one scenario; the same motions give the same pictures.

    Args:
        config: when cars and people set off.
        scenario: what is there.
        cameras: calibration and mounting of each.

    Raises:
        GlMissingError: no headless OpenGL; the text names the packages.
    """

    def __init__(self, config: WorldConfig, scenario: ScenarioConfig, cameras: CamerasConfig):
        self._config, self._scenario = config, scenario
        self._camera: Camera = cameras.down.camera()
        colour = {name: section.camera() for name, section in cameras.by_name().items()}
        depth = {name: section.depth_camera() for name, section in cameras.by_name().items()}
        sizes = [*colour.values(), *(sensor.camera for sensor in depth.values() if sensor)]
        self._scene = Scene(scenario, max(c.width for c in sizes), max(c.height for c in sizes))
        self._canvas = Canvas(self._scene)
        number = {name: index for index, name in enumerate(CAMERAS)}
        self._colour = {name: ColourEye(self._canvas, scenario, c, number[name]) for name, c in colour.items()}
        self._depth = {
            name: DepthEye(self._canvas, scenario, sensor, name, number[name])
            for name, sensor in depth.items()
            if sensor is not None
        }
        self._motion: Motion | None = None
        self._nearest_m = math.inf
        self._first_ns: int | None = None
        self._start_ns: int | None = None
        self._airborne_ns: int | None = None
        self.covered = 0.0
        """Share of the car's top that something above it hides from the camera, whether or not it is in the picture."""

    def place(self, motion: Motion) -> Truth:
        """Move everything to where it is at the vehicle's motion, and tell the truth about it."""
        if self._first_ns is None:
            self._first_ns = motion.t_ns
        airborne = -motion.ned_p_m[2] > self._config.airborne_height_m
        if self._airborne_ns is None and airborne:
            self._airborne_ns = motion.t_ns
        if self._start_ns is None and (airborne or self._config.car_start == "immediately"):
            self._start_ns = motion.t_ns
        moving_s = _since(self._start_ns, motion.t_ns)
        car, velocity = _pose_on(self._scene.path, moving_s)
        distractors = [_pose_on(path, moving_s)[0] for path in self._scene.distractor_paths]
        self._scene.place(car, distractors, motion.ned_p_m, moving_s)
        self._motion = motion
        self._eye = camera_pose(self._camera, motion.ned_p_m, motion.ned_q_body)
        truth = self._truth(motion, car, velocity, moving_s)
        self._nearest_m = min((o.distance_m for o in truth.obstacles), default=math.inf)
        return truth

    def picture(self, t_ns: int, camera: str = "down") -> bytes | None:
        """Pixels (H, W, 3), BGR, of what was placed, at the end of the video link; None when the frame is lost there.

        Args:
            t_ns: instant of the motion that was placed, ns.
            camera: name of the camera.
        """
        return self._colour[camera].picture(self._placed(), t_ns, max(_since(self._first_ns, t_ns), 0.0))

    def depth(self, t_ns: int, camera: str) -> bytes | None:
        """Depth (H, W), 16-bit little-endian mm, 0 where nothing returns, of what was placed; None: sensor silent.

        Args:
            t_ns: instant of the motion that was placed, ns.
            camera: name of a camera with depth.
        """
        return self._depth[camera].picture(self._placed(), _since(self._airborne_ns, t_ns), self._nearest_m)

    def metrics(self) -> dict[str, float]:
        """What the radio did."""
        total: Counter[str] = Counter()
        for eye in self._colour.values():
            total.update(lost=eye.lost, frozen=eye.frozen, broken=eye.broken)
        return {name: float(total[name]) for name in ("lost", "frozen", "broken")}

    def close(self) -> None:
        """Free the renderer."""
        self._canvas.close()

    def _placed(self) -> Motion:
        if self._motion is None:
            raise RuntimeError("nothing was placed yet: call `place` first")
        return self._motion

    def _truth(self, motion: Motion, car: CarPose, velocity: np.ndarray, moving_s: float) -> Truth:
        corners = ned_to_pixels(self._camera, *self._eye, self._scene.outline(car))
        samples = self._scene.samples(car)
        pixels = ned_to_pixels(self._camera, *self._eye, samples)
        # NaN (behind the camera) compares as outside.
        inside = ((pixels > -0.5) & (pixels < np.array([self._camera.width, self._camera.height]) - 0.5)).all(axis=1)
        hidden = self._scene.occluded(self._eye[0], samples)
        self.covered = float(hidden.mean())
        seen = inside & ~hidden
        shown = inside.any() and bool(np.isfinite(corners).all())
        return Truth(
            ned_p_m=as_vec3(motion.ned_p_m),
            ned_v_m_s=as_vec3(motion.ned_v_m_s),
            ned_q_body=as_quat(motion.ned_q_body),
            target_ned_p_m=(car.ned_p_m[0], car.ned_p_m[1], -self._scenario.car.height_m / 2),
            target_ned_v_m_s=(float(velocity[0]), float(velocity[1]), 0.0),
            target_heading_rad=car.heading_rad,
            target_corners_px=tuple((float(x), float(y)) for x, y in corners) if shown else (),
            target_visible=bool(seen.mean() >= _MOSTLY),
            obstacles=self._scene.obstacles(moving_s),
        )


def _since(start_ns: int | None, t_ns: int) -> float:
    """Time since a start, s; -1 before it."""
    return -1.0 if start_ns is None else (t_ns - start_ns) / 1e9


def _pose_on(path: CarPath, driven_s: float) -> tuple[CarPose, np.ndarray]:
    """Pose and velocity (2,), m/s, of a car at a time since it set off, s."""
    motion = path.at(driven_s)
    north, east = (float(c) for c in motion.ned_p_m[0])
    return CarPose((north, east), float(motion.heading_rad[0])), motion.ned_v_m_s[0]
