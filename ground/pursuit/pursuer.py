"""The chase of one target, picture by picture: tracker and chase law together, without bus, clock or thread."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from common.geometry.camera import Camera
from common.tracking.base import Box, Tracker, TrackResult
from ground.pursuit.config import PursuitConfig
from ground.pursuit.control import ChaseLaw, Pose, View, Wish, look


@dataclass(frozen=True)
class Pursued:
    """What one picture gave."""

    result: TrackResult
    """The tracker's answer."""
    view: View | None
    """Where that is, seen from the vehicle; None without a pose, or too low."""
    wish: Wish | None
    """What to fly; None without a pose."""

    @property
    def seen(self) -> bool:
        """Whether the target was seen in this picture."""
        return self.result.state == "tracking"


class Pursuer:
    """Tracks one target and steers after it.

    Args:
        config: the chase law's settings.
        make_tracker: a fresh tracker for each target.
    """

    def __init__(self, config: PursuitConfig, make_tracker: Callable[[], Tracker]):
        self._config = config
        self._make_tracker = make_tracker
        self._law = ChaseLaw(config)
        self._tracker: Tracker | None = None
        self._newest_ns = 0

    @property
    def active(self) -> bool:
        """Whether there is a target."""
        return self._tracker is not None

    def select(self, frame: np.ndarray, box: Box, angle_rad: float, capture_ns: int) -> None:
        """Take what the picture shows in a box as the target.

        Args:
            frame: picture, (H, W, 3) uint8 BGR.
            box: x, y, width, height before the rotation, px.
            angle_rad: rotation of the box about its centre, rad.
            capture_ns: the picture's stamp, ns.

        Raises:
            ValueError: the box is refused; an earlier target stays.
        """
        tracker = self._make_tracker()
        tracker.init(frame, box, angle_rad, capture_ns)
        self._tracker, self._newest_ns = tracker, capture_ns
        self._law.reset()

    def drop(self) -> None:
        """Forget the target."""
        self._tracker = None
        self._law.reset()

    def step(self, frame: np.ndarray, capture_ns: int, camera: Camera | None, pose: Pose | None) -> Pursued | None:
        """Track, look, steer.

        Args:
            frame: the next picture, (H, W, 3) uint8 BGR.
            capture_ns: its stamp, ns.
            camera: its calibration; None while unknown.
            pose: the vehicle at that time; None while unknown: then the target is tracked and nothing is asked.

        Returns:
            None for a picture that is not newer than the last one: it says nothing about now.

        Raises:
            ValueError: there is no target, or the picture has another size than the one it was chosen in.
        """
        if self._tracker is None:
            raise ValueError("pursuit: step without a target; select one first")
        if capture_ns <= self._newest_ns:
            return None
        self._newest_ns = capture_ns
        if pose is None or camera is None:
            return Pursued(self._tracker.update(frame, capture_ns), None, None)
        expected = self._law.expected(camera, pose, capture_ns)
        if expected is not None:
            self._tracker.expect(expected)
        result = self._tracker.update(frame, capture_ns)
        view = look(camera, pose, result.center_px, result.angle_rad, self._config.target_height_m)
        if result.state == "tracking" and view is not None and not result.repeated:
            wish = self._law.follow(view, pose, capture_ns, result.angle_std_rad)
        else:
            wish = self._law.coast(pose, capture_ns)
        return Pursued(result, view, wish)
