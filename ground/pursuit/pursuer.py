"""The chase of one target, picture by picture: tracker and chase law together, without bus, clock or thread."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from common.geometry.camera import Camera
from common.tracking.base import Box, SearchingTracker, Tracker, TrackResult
from ground.pursuit.altitude import AltitudeLaw, height_over_size, is_cut
from ground.pursuit.config import PursuitConfig
from ground.pursuit.control import ChaseLaw, Wish
from ground.pursuit.view import Pose, View, look


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
        self._altitude = AltitudeLaw(config) if config.altitude == "scale" else None
        self._tracker: Tracker | None = None
        self._seeking = False
        self._newest_ns = 0

    @property
    def active(self) -> bool:
        """Whether there is a target."""
        return self._tracker is not None

    @property
    def seeking(self) -> bool:
        """Whether the target is known from a picture of it alone, and not found yet."""
        return self._seeking

    @property
    def reinitialisations(self) -> int:
        """How often a search of the whole picture found this target."""
        return self._tracker.reinitialisations if isinstance(self._tracker, SearchingTracker) else 0

    def seek(self, model: np.ndarray) -> None:
        """Take what a picture shows, (H, W, 3) uint8 BGR, as the target: filled by it, its front at the top.

        `find` then looks for it.

        Raises:
            ValueError: a picture that cannot serve, or a tracker that cannot search.
        """
        tracker = _searching(self._make_tracker())
        tracker.learn(model)
        self.drop()
        self._tracker, self._seeking = tracker, True

    def find(self, frame: np.ndarray, capture_ns: int) -> bool:
        """Search a whole picture for the target; True when the tracker starts anew on what it found.

        Args:
            frame: picture, (H, W, 3) uint8 BGR.
            capture_ns: its stamp, ns.

        Raises:
            ValueError: there is no target, the tracker cannot search, or the picture's size has changed.
        """
        if self._tracker is None:
            raise ValueError("got no target to search for; choose one first")
        if not _searching(self._tracker).find(frame, capture_ns):
            return False
        self._seeking = False
        self._newest_ns = capture_ns
        self._law.retarget()
        return True

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
        self._seeking = False
        self._reset_laws()

    def drop(self) -> None:
        """Forget the target."""
        self._tracker, self._seeking = None, False
        self._reset_laws()

    def _reset_laws(self) -> None:
        self._law.reset()
        if self._altitude is not None:
            self._altitude.reset()

    def delayed(self, request_s: float) -> None:
        """Reckon with a time from a picture's capture to the setpoint that comes of it, s."""
        self._law.delayed(request_s)

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
        if result.reinitialised:
            self._law.retarget()
        view = look(camera, pose, result.center_px, result.angle_rad, self._config.target_height_m)
        if result.state == "tracking" and view is not None and not result.repeated:
            wish = self._law.follow(view, pose, capture_ns, result.angle_std_rad)
        else:
            wish = self._law.coast(pose, capture_ns)
        if self._altitude is not None:
            wish = replace(wish, climb_m_s=self._climb_m_s(self._altitude, result, view, camera, pose, capture_ns))
        return Pursued(result, view, wish)

    def _climb_m_s(
        self, law: AltitudeLaw, result: TrackResult, view: View | None, camera: Camera, pose: Pose, capture_ns: int
    ) -> float:
        """Upward velocity that keeps the target's size; none while it is not seen, or not seen whole."""
        if result.state != "tracking" or result.repeated or view is None or is_cut(camera, result):
            return law.freeze()
        height_m = -float(pose.ned_p_m[2]) - self._config.target_height_m
        return law.climb(height_over_size(camera, view.tangents, result), height_m, capture_ns)


def _searching(tracker: Tracker) -> SearchingTracker:
    if not isinstance(tracker, SearchingTracker):
        raise ValueError(f"{type(tracker).__name__} cannot search a whole picture; choose the target by a box")
    return tracker
