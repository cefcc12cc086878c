"""A scene with depth and colour, and a pose network that knows who is painted how: for tests of the whole search."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np

from benchmarks.people_scene import KINECT_2, DepthScene, Thing
from common.geometry.camera import Camera
from onboard.people.findings import Frame
from onboard.people.pose_network import PoseNetwork
from onboard.people.sights import VehiclePose
from tests.unit.people_bodies import STANDING

SECOND = 1_000_000_000
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
_THING = (90, 110, 100)
_CLOTHES = ((40, 40, 200), (200, 60, 30), (60, 170, 40), (230, 230, 230), (20, 200, 220))
DOWN = Camera(
    KINECT_2.width,
    KINECT_2.height,
    KINECT_2.fx_px,
    KINECT_2.fy_px,
    KINECT_2.cx_px,
    KINECT_2.cy_px,
    KINECT_2.distortion,
    (0.5**0.5, 0.0, 0.0, 0.5**0.5),
    (0.0, 0.0, 0.05),
)
"""The scene's camera below a vehicle, top of the picture forward."""


def paint(scene: DepthScene) -> tuple[np.ndarray, np.ndarray]:
    """Colour (H, W, 3) and depth (H, W), m, of a scene: people in clothes of their own, things grey, the floor dark."""
    depth_m, shown = scene.render()
    palette = np.array([(70, 80, 75), *_colours(scene.things)], np.uint8)
    return palette[shown + 1], depth_m


def _colours(things: tuple[Thing, ...]) -> list[tuple[int, int, int]]:
    people = iter(_CLOTHES)
    return [next(people) if thing.kind == "person" else _THING for thing in things]


def frame(scene: DepthScene, t_s: float, vehicle: VehiclePose | None = None, **changes: Any) -> Frame:
    """What the camera gives at a time, s."""
    colour, depth_m = paint(scene)
    t_ns = round(t_s * SECOND)
    return Frame(
        **{"colour": colour, "capture_ns": t_ns, "depth": depth_m, "depth_ns": t_ns, "vehicle": vehicle} | changes
    )


def above(height_m: float, north_m: float = 0.0, east_m: float = 0.0) -> VehiclePose:
    """A level vehicle whose camera is at a height above home, nose north."""
    return VehiclePose(np.array([north_m, east_m, -height_m - DOWN.body_p_camera_m[2]]), LEVEL)


@dataclass
class Knower:
    """Stands for the network: an upright body in a crop whose middle shows clothes, nothing elsewhere."""

    looks: int = 0
    """Crops that it was shown."""
    seconds: float = 0.0
    """A clock that goes on by 20 ms with every crop."""
    model: Any = field(default_factory=lambda: type("Model", (), {"size_px": 64}))

    def __call__(self, crop: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Joints (15, 2), confidences (15,) and presence of a crop."""
        self.looks += 1
        self.seconds += 0.02
        middle = crop[24:40, 24:40].reshape(-1, 3).astype(int)
        share = max(float((np.abs(middle - clothes).max(axis=1) < 30).mean()) for clothes in _CLOTHES)
        joints = (STANDING - [0, 60]) * (0.9 / 1.3 * 64 / 120.0) + 31.5
        return joints, np.full(15, 0.9), 1.0 if share > 0.25 else 0.0

    def clock(self) -> float:
        """Seconds."""
        return self.seconds

    @property
    def network(self) -> PoseNetwork:
        """As what it stands for."""
        return cast(PoseNetwork, self)
