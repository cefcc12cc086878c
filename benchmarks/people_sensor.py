"""What the Kinect v2 of `outrider bench people` gives along a flight, and what was truly there."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.people_flights import Take
from common.geometry.camera import Camera, DepthCamera
from common.geometry.rotation import quat_from_euler, quat_multiply
from onboard.people.pose import Picture
from simulation.world.eye import ColourEye, DepthEye
from simulation.world.people_truth import SeenPerson, seen_people
from simulation.world.renderer import Canvas, Renderer, camera_pose
from simulation.world.scene import CarPose, Scene
from simulation.world.truth_filter import Motion

Array = NDArray[np.float64]

_DOWN = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
_STRAIGHT = (0.0, 0.0, 0.0, 0.0, 0.0)
COLOUR = Camera(960, 540, 540.0, 540.0, 479.5, 269.5, _STRAIGHT, _DOWN, (0.0, 0.0, 0.05))
"""A Kinect v2's colour camera at half its size, as the paper's sequences have it; the picture's top is forward."""
DEPTH = DepthCamera(
    Camera(512, 424, 365.0, 365.0, 255.5, 211.5, _STRAIGHT, _DOWN, (0.0, -0.052, 0.05)),
    range_min_m=0.5,
    range_max_m=8.0,
)
"""Its depth camera, 52 mm beside it."""
_EXPOSURE_S = 0.004
_LENS_SIGMA_PX = 0.6
_LEAST_BLUR_PX = 1.5
_DRIFT_M, _DRIFT_S, _ATTITUDE_RAD = 0.10, 8.0, math.radians(0.5)
_PARKED = CarPose((-34.0, -34.0), 0.0)


@dataclass(frozen=True)
class Shot:
    """One instant of a flight."""

    t_ns: int
    """When."""
    picture: Picture
    """(540, 960, 3) BGR."""
    depth_mm: NDArray[np.uint16]
    """(424, 512), 0 where nothing returns."""
    ned_p_m: Array
    """(3,) where the vehicle believes to be."""
    ned_q_body: Array
    """(4,) how it believes to be turned."""
    people: list[SeenPerson]
    """Everybody who is seen, truly."""
    blurred: bool
    """Whether the gimbal shakes."""


class _Belief:
    """The vehicle's own estimate: a position that drifts slowly, an attitude that is a little off."""

    def __init__(self, rng: np.random.Generator):
        self._rng, self._offset_m, self._tilt_rad = rng, np.zeros(3), np.zeros(3)

    def of(self, motion: Motion, period_s: float) -> tuple[Array, Array]:
        keep = math.exp(-period_s / _DRIFT_S)
        fresh = math.sqrt(1.0 - keep * keep)
        self._offset_m = keep * self._offset_m + fresh * self._rng.normal(0.0, _DRIFT_M, 3)
        self._tilt_rad = keep * self._tilt_rad + fresh * self._rng.normal(0.0, _ATTITUDE_RAD, 3)
        quat = quat_multiply(motion.ned_q_body, quat_from_euler(*(float(a) for a in self._tilt_rad)))
        return motion.ned_p_m + self._offset_m, quat


def shots(take: Take, rate_hz: float, frames: int, seed: int) -> Iterator[Shot]:
    """Every picture of a flight in its order.

    Args:
        take: scene and flight.
        rate_hz: pictures a second.
        frames: how many.
        seed: of noise, blur and the vehicle's errors.

    Raises:
        GlMissingError: no headless OpenGL; the text names the packages.
    """
    scene = Scene(take.scenario, COLOUR.width, COLOUR.height)
    canvas = Canvas(scene)
    try:
        colour = ColourEye(canvas, take.scenario, COLOUR, 0)
        depth = DepthEye(canvas, take.scenario, DEPTH, "down", 0)
        bodies = Renderer(canvas, COLOUR)
        rng = np.random.default_rng((seed, 31))
        belief = _Belief(rng)
        for index in range(frames):
            t_s = index / rate_hz
            motion = take.motion(t_s)
            scene.place(_PARKED, [], motion.ned_p_m, t_s)
            pose = camera_pose(COLOUR, motion.ned_p_m, motion.ned_q_body)
            people = seen_people(scene, COLOUR, *pose, bodies.bodies(*pose))
            picture = np.frombuffer(colour.picture(motion, motion.t_ns, t_s) or b"", np.uint8)
            picture = picture.reshape(COLOUR.height, COLOUR.width, 3)
            length_px = next((px for begin, end, px in take.shakes if begin <= t_s < end), 0.0)
            ranges = np.frombuffer(depth.picture(motion, t_s, math.inf) or b"", "<u2")
            ned_p_m, ned_q_body = belief.of(motion, 1.0 / rate_hz)
            yield Shot(
                motion.t_ns,
                _exposed(picture, motion, length_px, rng),
                ranges.reshape(DEPTH.camera.height, DEPTH.camera.width),
                ned_p_m,
                ned_q_body,
                people,
                length_px > 0,
            )
    finally:
        canvas.close()


def _exposed(picture: Picture, motion: Motion, shake_px: float, rng: np.random.Generator) -> Picture:
    """The picture behind a lens, smeared by flight and by a gimbal that shakes."""
    picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), _LENS_SIGMA_PX), np.uint8)
    height = max(float(-motion.ned_p_m[2]), 1.0)
    flown_px = float(np.linalg.norm(motion.ned_v_m_s[:2])) * _EXPOSURE_S * COLOUR.fx_px / height
    if shake_px:
        length, angle = shake_px * float(rng.uniform(0.7, 1.3)), float(rng.uniform(0.0, math.pi))
    else:
        length, angle = flown_px, 0.5 * math.pi  # forward is up the picture
    if length < _LEAST_BLUR_PX:
        return picture
    side = 2 * math.ceil(length / 2) + 3
    kernel, middle = np.zeros((side, side), np.float32), side / 2.0
    reach = 0.5 * length * np.array([math.cos(angle), math.sin(angle)])
    for share in np.linspace(-1.0, 1.0, 4 * side):
        x, y = middle + share * reach
        kernel[int(y), int(x)] += 1.0
    return np.asarray(cv2.filter2D(picture, -1, kernel / kernel.sum()), np.uint8)
