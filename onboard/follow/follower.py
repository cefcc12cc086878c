"""From pictures to a request: fused trackers, the target's place, the law. No bus, no thread; the node feeds it."""

from __future__ import annotations

import logging
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.config import Config
from common.geometry.camera import Camera
from common.messages import Request, Track
from common.tracking.base import Box
from onboard.follow.choice import Picture
from onboard.follow.config import FollowConfig
from onboard.follow.law import Vehicle
from onboard.follow.mount import Mount
from onboard.follow.steering import Steering
from onboard.fusion.center import SEVERAL, Fused
from onboard.fusion.config import DepthConfig, FusionConfig, HabDfConfig
from onboard.fusion.live import LiveHabDf
from onboard.fusion.members import MemberPool
from onboard.proximity.pose import Pose

log = logging.getLogger(__name__)


class Followed(NamedTuple):
    """What one picture gave."""

    track: Track
    """The fused target."""
    request: Request | None
    """What to ask of helm; None without a target, a pose, or once it has been away for too long."""


class Follower:
    """Follows one target.

    Args:
        config: all sections.
        camera: calibration of the pictures that are followed.

    Raises:
        ConfigError: unknown tracker.
    """

    def __init__(self, config: Config, camera: Camera):
        self._config = config.section(FollowConfig)
        boxes = config.section(HabDfConfig)
        pool = MemberPool(boxes.members, config, self._config.seed, camera.width * camera.height * 3)
        settings = self._config
        fusion = boxes.of_boxes(config.section(FusionConfig))
        self.fusion = LiveHabDf(pool, fusion, settings.answer_within_s, settings.frozen_after_s)
        """The fused trackers."""
        self._steering = Steering(settings, config.section(DepthConfig), camera)
        self._mount = Mount(camera)
        self.active = False
        """Whether there is a target."""

    def calibrate(self, camera: Camera) -> None:
        """Take another calibration; pictures larger than the trackers' memory are refused later, by name."""
        self._steering.calibrate(camera)
        self._mount.calibrate(camera)

    def select(self, picture: Picture, box: Box, angle_rad: float) -> None:
        """Take what a picture shows in a box as the target.

        Args:
            picture: the picture.
            box: x, y, width, height before the rotation, px.
            angle_rad: its rotation, rad; the trackers start on the upright box around it.

        Raises:
            ValueError: a picture that is too large, or a box that cannot be one.
        """
        t_ns, frame = picture
        if frame.size > self.fusion.pool.size:
            raise ValueError(
                f"got a picture of {frame.shape[1]}x{frame.shape[0]} px, larger than the camera's of the vehicle file; "
                "set its width and height there"
            )
        self.fusion.select(frame, box, angle_rad, t_ns)
        self._steering.reset()
        self.active = True

    def drop(self) -> None:
        """Forget the target."""
        self.active = False
        self.fusion.drop()

    def unobeyed(self, ned_v_m_s: NDArray[np.float64] | None, t_ns: int) -> None:
        """Helm flies something else: the next request begins at that, or at the vehicle's own velocity.

        Args:
            ned_v_m_s: velocity that helm sent last, (3,), NED, m/s; None: it sends none.
            t_ns: when, ns.
        """
        self._steering.restart(ned_v_m_s, t_ns)

    def step(
        self,
        frame: np.ndarray,
        t_ns: int,
        pose: Pose | None,
        vehicle: Vehicle | None,
        depth_m: NDArray[np.float64] | None = None,
    ) -> Followed:
        """One picture, (H, W, 3) uint8 BGR, of a stamp, ns.

        Args:
            frame: the picture.
            t_ns: its capture stamp.
            pose: the vehicle then; None while unknown: the target is tracked and nothing is asked.
            vehicle: the vehicle then, with its rates.
            depth_m: depth picture that belongs to it, (h, w), m, at any size; None without.
        """
        pose = self._mount.pose(frame, t_ns, pose, depth_m)
        fused = self.fusion.step(frame, t_ns, self._steering.expected(t_ns, pose, depth_m))
        box = self.fusion.box
        seen = box if fused.state == "tracking" else None
        request = self._steering.step(t_ns, seen, pose, vehicle, depth_m, sure=fused.confidence > SEVERAL)
        return Followed(_track(fused, self.fusion.sees(t_ns), box, self._steering.why_not), request)

    def close(self) -> None:
        """End the trackers."""
        self.fusion.close()


def _track(fused: Fused, seen: bool, box: Box | None, reason: str) -> Track:
    if box is None:
        return Track(state="lost", reason=reason or "nothing measured yet")
    return Track(
        state="tracking" if seen else "lost",
        x_px=box[0] + box[2] / 2,
        y_px=box[1] + box[3] / 2,
        width_px=box[2],
        height_px=box[3],
        distance=1.0 - fused.confidence,
        distance_limit=0.5,
        reason=reason,
    )
