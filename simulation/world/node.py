"""The node `world`: pictures of the simulated world as the vehicle's camera sees it, and the truth beside them."""

from __future__ import annotations

import logging
import statistics
import time
from collections import deque
from collections.abc import Iterable

import cv2
import msgspec
import numpy as np

from common.config import Config
from common.geometry.config import CamerasConfig
from common.geometry.rotation import as_quat, as_vec3
from common.messages import Image, Truth
from common.node import Every, Inputs, Node, Output
from simulation.world.config import WorldConfig
from simulation.world.noise import add_noise, break_blocks, exposure_gain, light_gain, noise_tile, shade, vignette_map
from simulation.world.path import CarPath
from simulation.world.radio import LinkState, next_fate
from simulation.world.renderer import Renderer, camera_pose, ned_to_pixels
from simulation.world.scenario import load_scenario
from simulation.world.scene import CarPose, Scene
from simulation.world.truth_filter import Motion
from simulation.world.truth_port import TruthPort

log = logging.getLogger(__name__)

_WINDOW = 1200
_MOSTLY = 0.5


class WorldNode(Node):
    """Renders the picture of the camera `down` at the vehicle's true pose, a little in the past.

    Raises:
        ConfigError: bad scenario, port in use, no headless OpenGL.
    """

    outputs = ("sim/camera/down", "truth")

    def __init__(self, config: Config, name: str = "world"):
        super().__init__(config, name)
        self._config = config.section(WorldConfig)
        self._camera = config.section(CamerasConfig).down.camera()
        self.trigger = Every(1.0 / self._camera.rate_hz)
        cv2.setNumThreads(1)
        self._scenario = load_scenario(self._config.scenario)
        if self._config.seed is not None:
            self._scenario = msgspec.structs.replace(self._scenario, seed=self._config.seed)
        width, height = self._camera.width, self._camera.height
        self._scene = Scene(self._scenario, width, height)
        self._renderer = Renderer(self._scene, self._camera)
        self._rng = np.random.default_rng(self._scenario.seed)
        self._radio_rng = np.random.default_rng((self._scenario.seed, 1))
        sensor = self._scenario.sensor
        self._tile = noise_tile(self._rng, width, height, sensor.noise_sigma) if sensor.noise_sigma else None
        self._vignette = vignette_map(width, height, sensor.vignette) if sensor.vignette else None
        self._link = LinkState()
        self._last_picture: bytes | None = None
        self._last_instant_ns = self._last_step_ns = 0
        self._first_ns: int | None = None
        self._car_start_ns: int | None = None
        self._missed: deque[int] = deque(maxlen=_WINDOW)
        self._render_ms: deque[float] = deque(maxlen=200)
        self._stale = self._lost = self._frozen = self._broken = 0
        self._truth = TruthPort(self._config)
        log.info(
            "scenario %s; waiting for the vehicle's pose on UDP %s:%d",
            self._config.scenario,
            self._config.host,
            self._config.port,
        )

    def step(self, inputs: Inputs, t_ns: int) -> Iterable[Output]:
        """Picture, unless nobody reads it or the link loses it, and truth; nothing while the pose is stale."""
        self._note_lateness(t_ns)
        motion = self._motion(t_ns)
        if motion is None:
            self._stale += 1
            return []
        if self._first_ns is None:
            self._first_ns = motion.t_ns
        car = self._place_cars(motion)
        ned_eye, ned_q_eye = camera_pose(self._camera, motion.ned_p_m, motion.ned_q_body)
        capture_ns = motion.t_ns + int(self._camera.exposure_delay_ms * 1e6)
        outputs = []
        if self.has_reader("sim/camera/down"):
            data = self._picture(ned_eye, ned_q_eye, motion.t_ns)
            if data is not None:
                outputs.append(
                    Output(
                        "sim/camera/down",
                        Image(
                            camera="down",
                            width=self._camera.width,
                            height=self._camera.height,
                            encoding="bgr8",
                            data=data,
                        ),
                        capture_ns,
                    )
                )
        outputs.append(Output("truth", self._truth_message(motion, car, ned_eye, ned_q_eye), capture_ns))
        return outputs

    def metrics(self) -> dict[str, float]:
        """Late frames, time to render, frames without a pose, and what the radio did."""
        steps = len(self._missed)
        missed = sum(self._missed)
        return {
            "late_fraction": missed / (steps + missed) if steps else 0.0,
            "render_ms_median": statistics.median(self._render_ms) if self._render_ms else 0.0,
            "stale": float(self._stale),
            "lost": float(self._lost),
            "frozen": float(self._frozen),
            "broken": float(self._broken),
            "truth_rate_hz": self._truth.rate_hz,
        }

    def close(self) -> None:
        """Close the truth port and the renderer."""
        self._truth.close()
        self._renderer.close()

    def _note_lateness(self, t_ns: int) -> None:
        """Count the frames that fell out since the step before."""
        if self._last_step_ns:
            periods = (t_ns - self._last_step_ns) / 1e9 * self._camera.rate_hz
            self._missed.append(max(round(periods) - 1, 0))
        self._last_step_ns = t_ns

    def _motion(self, t_ns: int) -> Motion | None:
        """Motion at the instant to be pictured, or None when there is no newer one than last time."""
        newest_ns = self._truth.newest_ns
        if newest_ns is None:
            return None
        # When poses come late the picture is taken as late as they allow, and its stamp says so.
        instant_ns = min(
            t_ns - int(self._config.render_delay_ms * 1e6), newest_ns + int(self._config.longest_extrapolation_ms * 1e6)
        )
        if instant_ns <= self._last_instant_ns:
            return None
        motion = self._truth.motion_at(instant_ns)
        if motion is not None:
            self._last_instant_ns = instant_ns
        return motion

    def _place_cars(self, motion: Motion) -> tuple[CarPose, np.ndarray]:
        """Move everything to its place at an instant; pose and velocity (2,) of the chased car."""
        airborne = -motion.ned_p_m[2] > self._config.airborne_height_m
        if self._car_start_ns is None and (airborne or self._config.car_start == "immediately"):
            self._car_start_ns = motion.t_ns
        driven_s = -1.0 if self._car_start_ns is None else (motion.t_ns - self._car_start_ns) / 1e9
        car, velocity = _pose_on(self._scene.path, driven_s)
        self._scene.place(car, [_pose_on(path, driven_s)[0] for path in self._scene.distractor_paths], motion.ned_p_m)
        return car, velocity

    def _picture(self, ned_eye: np.ndarray, ned_q_eye: np.ndarray, instant_ns: int) -> bytes | None:
        """Pixels that arrive at the end of the video link, None when this frame is lost on it."""
        self._link, fate = next_fate(self._link, self._scenario.radio, instant_ns, self._radio_rng)
        if fate.lost:
            self._lost += 1
            return None
        if fate.frozen and self._last_picture is not None:
            self._frozen += 1
            return self._last_picture
        started = time.perf_counter()
        frame = self._renderer.render(ned_eye, ned_q_eye)
        world_s = (instant_ns - (self._first_ns or instant_ns)) / 1e9
        exposure = exposure_gain(self._scenario.sensor, self._scenario.seed, world_s)
        blue, green, red = light_gain(self._scenario.light, world_s)
        frame = shade(frame, (blue * exposure, green * exposure, red * exposure), self._vignette)
        if self._tile is not None:
            frame = add_noise(frame, self._tile, self._rng)
        if fate.broken:
            self._broken += 1
            frame = break_blocks(frame, self._scenario.radio, self._rng)
        self._last_picture = frame.tobytes()
        self._render_ms.append((time.perf_counter() - started) * 1e3)
        return self._last_picture

    def _truth_message(
        self, motion: Motion, car: tuple[CarPose, np.ndarray], ned_eye: np.ndarray, ned_q_eye: np.ndarray
    ) -> Truth:
        pose, velocity = car
        corners = ned_to_pixels(self._camera, ned_eye, ned_q_eye, self._scene.outline(pose))
        samples = self._scene.samples(pose)
        pixels = ned_to_pixels(self._camera, ned_eye, ned_q_eye, samples)
        # NaN (behind the camera) compares as outside.
        inside = ((pixels > -0.5) & (pixels < np.array([self._camera.width, self._camera.height]) - 0.5)).all(axis=1)
        seen = inside & ~self._scene.occluded(ned_eye, samples) if inside.any() else inside
        shown = inside.any() and bool(np.isfinite(corners).all())
        return Truth(
            ned_p_m=as_vec3(motion.ned_p_m),
            ned_v_m_s=as_vec3(motion.ned_v_m_s),
            ned_q_body=as_quat(motion.ned_q_body),
            target_ned_p_m=(pose.ned_p_m[0], pose.ned_p_m[1], -self._scenario.car.height_m / 2),
            target_ned_v_m_s=(float(velocity[0]), float(velocity[1]), 0.0),
            target_heading_rad=pose.heading_rad,
            target_corners_px=tuple((float(x), float(y)) for x, y in corners) if shown else (),
            target_visible=bool(seen.mean() >= _MOSTLY),
        )


def _pose_on(path: CarPath, driven_s: float) -> tuple[CarPose, np.ndarray]:
    """Pose and velocity (2,), m/s, of a car at a time since it set off, s."""
    motion = path.at(driven_s)
    north, east = (float(c) for c in motion.ned_p_m[0])
    return CarPose((north, east), float(motion.heading_rad[0])), motion.ned_v_m_s[0]
