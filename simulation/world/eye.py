"""One camera of the simulated vehicle: its colour picture at the end of the video link, and its depth picture."""

from __future__ import annotations

import math

import numpy as np

from common.geometry.camera import Camera, DepthCamera
from common.geometry.depth import to_mm
from simulation.world.depth_config import DepthFaultConfig
from simulation.world.depth_noise import DepthNoise
from simulation.world.noise import add_noise, break_blocks, exposure_gain, light_gain, noise_tile, shade, vignette_map
from simulation.world.radio import LinkState, next_fate
from simulation.world.renderer import Canvas, Renderer, camera_pose
from simulation.world.scenario import ScenarioConfig
from simulation.world.truth_filter import Motion


class ColourEye:
    """Colour pictures of one camera, with what light, sensor and video link do to them.

    Args:
        canvas: where to draw.
        scenario: light, sensor, link.
        camera: calibration and mounting.
        number: of the camera: each has randomness of its own.
    """

    def __init__(self, canvas: Canvas, scenario: ScenarioConfig, camera: Camera, number: int):
        self._scenario, self._camera = scenario, camera
        self._renderer = Renderer(canvas, camera)
        self._rng = np.random.default_rng(_seed(scenario.seed, number, 0))
        self._radio_rng = np.random.default_rng(_seed(scenario.seed, number, 1))
        sensor, width, height = scenario.sensor, camera.width, camera.height
        self._tile = noise_tile(self._rng, width, height, sensor.noise_sigma) if sensor.noise_sigma else None
        self._vignette = vignette_map(width, height, sensor.vignette) if sensor.vignette else None
        self._link = LinkState()
        self._last_picture: bytes | None = None
        self.lost = self.frozen = self.broken = 0
        """What the radio did to so many pictures."""

    def picture(self, motion: Motion, t_ns: int, world_s: float) -> bytes | None:
        """Pixels (H, W, 3), BGR, of the scene as it stands, at the end of the video link; None when lost there.

        Args:
            motion: of the vehicle.
            t_ns: instant, ns.
            world_s: time since the first instant, s.
        """
        self._link, fate = next_fate(self._link, self._scenario.radio, t_ns, self._radio_rng)
        if fate.lost:
            self.lost += 1
            return None
        if fate.frozen and self._last_picture is not None:
            self.frozen += 1
            return self._last_picture
        frame = self._renderer.render(*camera_pose(self._camera, motion.ned_p_m, motion.ned_q_body))
        exposure = exposure_gain(self._scenario.sensor, self._scenario.seed, world_s)
        blue, green, red = light_gain(self._scenario.light, world_s)
        frame = shade(frame, (blue * exposure, green * exposure, red * exposure), self._vignette)
        if self._tile is not None:
            frame = add_noise(frame, self._tile, self._rng)
        if fate.broken:
            self.broken += 1
            frame = break_blocks(frame, self._scenario.radio, self._rng)
        self._last_picture = frame.tobytes()
        return self._last_picture


class DepthEye:
    """Depth pictures of one camera, with the sensor's imperfections and failures.

    Args:
        canvas: where to draw.
        scenario: noise and faults.
        sensor: calibration, mounting, range.
        name: name of the camera, for its faults.
        number: of the camera: each has randomness of its own.
    """

    def __init__(self, canvas: Canvas, scenario: ScenarioConfig, sensor: DepthCamera, name: str, number: int):
        self._sensor = sensor
        self._renderer = Renderer(canvas, sensor.camera)
        self._noise = DepthNoise(scenario.depth, sensor, np.random.default_rng(_seed(scenario.seed, number, 2)))
        self._faults = [_Fault(f) for f in scenario.depth_faults if f.camera == name]
        self._last_picture: bytes | None = None

    def picture(self, motion: Motion, airborne_s: float, nearest_m: float) -> bytes | None:
        """Millimetres (H, W), 16-bit little-endian, 0 where nothing returns; None while the sensor is silent.

        Args:
            motion: of the vehicle.
            airborne_s: time since it was airborne, s; negative before.
            nearest_m: distance of the nearest barrel, wall or person, m.
        """
        faults = {fault.kind for fault in self._faults if fault.acts(airborne_s, nearest_m)}
        if "silent" in faults:
            return None
        if "zero" in faults:
            return bytes(2 * self._sensor.camera.width * self._sensor.camera.height)
        if "frozen" in faults and self._last_picture is not None:
            return self._last_picture
        pose = camera_pose(self._sensor.camera, motion.ned_p_m, motion.ned_q_body)
        true_m = self._renderer.depth(*pose, self._sensor.range_max_m)
        self._last_picture = to_mm(self._noise.applied(true_m)).tobytes()
        return self._last_picture


class _Fault:
    """One failure, and when it began."""

    def __init__(self, config: DepthFaultConfig):
        self._config = config
        self._since_s: float | None = None

    @property
    def kind(self) -> str:
        return self._config.kind

    def acts(self, airborne_s: float, nearest_m: float) -> bool:
        """Whether it acts at a time since the vehicle was airborne, s; asked once for each picture."""
        config = self._config
        if self._since_s is None and airborne_s >= 0.0:
            if config.at_s is not None and airborne_s >= config.at_s:
                self._since_s = config.at_s
            elif config.within_m is not None and nearest_m <= config.within_m:
                self._since_s = airborne_s
        return self._since_s is not None and airborne_s - self._since_s < (config.for_s or math.inf)


def _seed(seed: int, camera: int, purpose: int) -> int | tuple[int, ...]:
    """Seed of one random source: cameras and purposes do not share any."""
    if camera == 0:
        return (seed, purpose) if purpose else seed
    return (seed, purpose, camera)
