"""The simulated world as the vehicle's camera sees it at a given motion: no clock, no bus, no thread of its own."""

from __future__ import annotations

import numpy as np

from common.geometry.camera import Camera
from common.geometry.rotation import as_quat, as_vec3
from common.messages import Truth
from simulation.world.config import WorldConfig
from simulation.world.noise import add_noise, break_blocks, exposure_gain, light_gain, noise_tile, shade, vignette_map
from simulation.world.path import CarPath
from simulation.world.radio import LinkState, next_fate
from simulation.world.renderer import Renderer, camera_pose, ned_to_pixels
from simulation.world.scenario import ScenarioConfig
from simulation.world.scene import CarPose, Scene
from simulation.world.truth_filter import Motion

_MOSTLY = 0.5


class Stage:
    """Scene, camera, light and video link of one scenario; the same motions give the same pictures.

    Args:
        config: when the cars set off.
        scenario: what is there.
        camera: calibration and mounting.

    Raises:
        GlMissingError: no headless OpenGL; the text names the packages.
    """

    def __init__(self, config: WorldConfig, scenario: ScenarioConfig, camera: Camera):
        self._config, self._scenario, self._camera = config, scenario, camera
        self._scene = Scene(scenario, camera.width, camera.height)
        self._renderer = Renderer(self._scene, camera)
        self._rng = np.random.default_rng(scenario.seed)
        self._radio_rng = np.random.default_rng((scenario.seed, 1))
        sensor, width, height = scenario.sensor, camera.width, camera.height
        self._tile = noise_tile(self._rng, width, height, sensor.noise_sigma) if sensor.noise_sigma else None
        self._vignette = vignette_map(width, height, sensor.vignette) if sensor.vignette else None
        self._link = LinkState()
        self._last_picture: bytes | None = None
        self._first_ns: int | None = None
        self._car_start_ns: int | None = None
        self._lost = self._frozen = self._broken = 0
        self.covered = 0.0
        """Share of the car's top that something above it hides from the camera, whether or not it is in the picture."""

    def place(self, motion: Motion) -> Truth:
        """Move everything to where it is at the vehicle's motion, and tell the truth about it."""
        if self._first_ns is None:
            self._first_ns = motion.t_ns
        airborne = -motion.ned_p_m[2] > self._config.airborne_height_m
        if self._car_start_ns is None and (airborne or self._config.car_start == "immediately"):
            self._car_start_ns = motion.t_ns
        driven_s = -1.0 if self._car_start_ns is None else (motion.t_ns - self._car_start_ns) / 1e9
        car, velocity = _pose_on(self._scene.path, driven_s)
        self._scene.place(car, [_pose_on(path, driven_s)[0] for path in self._scene.distractor_paths], motion.ned_p_m)
        self._eye = camera_pose(self._camera, motion.ned_p_m, motion.ned_q_body)
        return self._truth(motion, car, velocity)

    def picture(self, t_ns: int) -> bytes | None:
        """Pixels (H, W, 3), BGR, of what was placed, at the end of the video link; None when the frame is lost there.

        Args:
            t_ns: instant of the motion that was placed, ns.
        """
        self._link, fate = next_fate(self._link, self._scenario.radio, t_ns, self._radio_rng)
        if fate.lost:
            self._lost += 1
            return None
        if fate.frozen and self._last_picture is not None:
            self._frozen += 1
            return self._last_picture
        frame = self._renderer.render(*self._eye)
        world_s = (t_ns - (self._first_ns or t_ns)) / 1e9
        exposure = exposure_gain(self._scenario.sensor, self._scenario.seed, world_s)
        blue, green, red = light_gain(self._scenario.light, world_s)
        frame = shade(frame, (blue * exposure, green * exposure, red * exposure), self._vignette)
        if self._tile is not None:
            frame = add_noise(frame, self._tile, self._rng)
        if fate.broken:
            self._broken += 1
            frame = break_blocks(frame, self._scenario.radio, self._rng)
        self._last_picture = frame.tobytes()
        return self._last_picture

    def metrics(self) -> dict[str, float]:
        """What the radio did."""
        return {"lost": float(self._lost), "frozen": float(self._frozen), "broken": float(self._broken)}

    def close(self) -> None:
        """Free the renderer."""
        self._renderer.close()

    def _truth(self, motion: Motion, car: CarPose, velocity: np.ndarray) -> Truth:
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
        )


def _pose_on(path: CarPath, driven_s: float) -> tuple[CarPose, np.ndarray]:
    """Pose and velocity (2,), m/s, of a car at a time since it set off, s."""
    motion = path.at(driven_s)
    north, east = (float(c) for c in motion.ned_p_m[0])
    return CarPose((north, east), float(motion.heading_rad[0])), motion.ned_v_m_s[0]
