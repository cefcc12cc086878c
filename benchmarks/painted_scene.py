"""A small synthetic world for the tracker: a painted car on textured ground, with exact truth and faults."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np

RATE_HZ = 20.0
WIDTH, HEIGHT = 640, 480
CAR_PX = (96, 48)
_NOISE_PLACES = 128
"""Rows and columns by which the field of noise is larger than a picture."""


@dataclass(frozen=True)
class Pose:
    """Where the car is: centre (px), rotation (rad), size against 96 x 48 px."""

    x_px: float
    y_px: float
    angle_rad: float = 0.0
    scale: float = 1.0

    def box(self) -> tuple[float, float, float, float]:
        """The car's rectangle before its rotation, px."""
        width, height = (side * self.scale for side in CAR_PX)
        return (self.x_px - width / 2, self.y_px - height / 2, width, height)


def car_picture(roof_bgr: tuple[int, int, int] = (40, 40, 190)) -> np.ndarray:
    """The car from above, nose to the right, (48, 96, 3): paint, dark windows, lamps."""
    picture = np.full((CAR_PX[1], CAR_PX[0], 3), roof_bgr, np.uint8)
    cv2.rectangle(picture, (58, 5), (70, 42), (60, 45, 35), -1)
    cv2.rectangle(picture, (14, 7), (22, 40), (60, 45, 35), -1)
    cv2.rectangle(picture, (91, 3), (95, 12), (220, 240, 240), -1)
    cv2.rectangle(picture, (91, 35), (95, 44), (220, 240, 240), -1)
    cv2.line(picture, (24, 24), (56, 24), (200, 200, 200), 3)
    return picture


def ground_picture(rng: np.random.Generator) -> np.ndarray:
    """Grey-green ground with blotches and grain, (480, 640, 3)."""
    ground = np.full((HEIGHT, WIDTH, 3), (95, 120, 110), np.float32)
    for sigma, shrunk, strength in ((40, 16, 18), (8, 4, 14), (1.5, 1, 10)):
        small = rng.standard_normal((HEIGHT // shrunk, WIDTH // shrunk, 3), np.float32)
        blotches = cv2.resize(cv2.GaussianBlur(small, (0, 0), sigma / shrunk), (WIDTH, HEIGHT))
        ground += strength * blotches / blotches.std()
    return np.clip(ground, 0, 255).astype(np.uint8)


def paint(frame: np.ndarray, picture: np.ndarray, pose: Pose) -> None:
    """Draw a picture of an object, centred and turned as the pose says, into the frame."""
    height, width = picture.shape[:2]
    reach = math.hypot(height, width) * pose.scale / 2 + 2
    left, top = max(0, int(pose.x_px - reach)), max(0, int(pose.y_px - reach))
    window = frame[top : max(0, int(pose.y_px + reach)), left : max(0, int(pose.x_px + reach))]
    if window.size == 0:
        return
    cosine, sine = pose.scale * math.cos(pose.angle_rad), pose.scale * math.sin(pose.angle_rad)
    matrix = np.array([[cosine, -sine, pose.x_px - left], [sine, cosine, pose.y_px - top]])
    matrix[:, 2] -= matrix[:, :2] @ [(width - 1) / 2, (height - 1) / 2]
    size = (window.shape[1], window.shape[0])
    mask = cv2.warpAffine(np.full((height, width), 255, np.uint8), matrix, size, flags=cv2.INTER_LINEAR) > 127
    window[mask] = cv2.warpAffine(picture, matrix, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[mask]


@dataclass(frozen=True)
class Scene:
    """A path of the car and what happens to the pictures; the same seed gives the same pictures."""

    path: Callable[[float], Pose]
    """Pose of the car at a time, s."""
    seed: int = 0
    gain: Callable[[float], float] = lambda t_s: 1.0
    """Brightness at a time, against the first."""
    decorate: Callable[[np.ndarray, float], None] | None = None
    """Draws into the picture over the car: an occluder, a distractor."""
    noise: float = 4.0
    """Standard deviation of the sensor noise, grey levels."""

    def frames(self, duration_s: float) -> Iterator[tuple[int, np.ndarray, Pose]]:
        """Stamp (ns), picture and truth, picture after picture at 20 Hz."""
        rng = np.random.default_rng(self.seed)
        ground, car = ground_picture(rng), car_picture()
        # One field of noise, read at another place for each picture: drawing anew takes ten times as long as tracking.
        field = self.noise * rng.standard_normal((HEIGHT + _NOISE_PLACES, WIDTH + _NOISE_PLACES, 3), np.float32)
        for index in range(int(duration_s * RATE_HZ)):
            t_s = index / RATE_HZ
            pose = self.path(t_s)
            frame = ground.copy()
            paint(frame, car, pose)
            if self.decorate is not None:
                self.decorate(frame, t_s)
            row, column = rng.integers(0, _NOISE_PLACES, 2)
            noise = field[row : row + HEIGHT, column : column + WIDTH]
            lit = frame * np.float32(self.gain(t_s)) + noise
            yield int(t_s * 1e9), np.clip(lit, 0, 255, out=lit).astype(np.uint8), pose


def winding(speed_px_s: float = 120.0, turn_s: float = 6.0, swing_rad: float = 1.0) -> Callable[[float], Pose]:
    """Path of a car that drives a ring of the picture with its heading along its path."""
    radius = 130.0
    rate = speed_px_s / radius

    def pose(t_s: float) -> Pose:
        phase = rate * t_s
        wobble = swing_rad * 0.15 * math.sin(2 * math.pi * t_s / turn_s)
        x = WIDTH / 2 + (radius + 60) * math.cos(phase)
        y = HEIGHT / 2 + radius * math.sin(phase)
        heading = math.atan2(radius * math.cos(phase), -(radius + 60) * math.sin(phase)) + wobble
        return Pose(x, y, heading, 1.0 + 0.15 * math.sin(0.7 * t_s))

    return pose


def straight(speed_px_s: float, y_px: float = HEIGHT / 2, start_px: float = 80.0) -> Callable[[float], Pose]:
    """Path along a row of the picture."""
    return lambda t_s: Pose(start_px + speed_px_s * t_s, y_px)
