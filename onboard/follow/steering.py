"""From a box to a request: where the target is, how it moves, and the law. The same in flight and in a simulation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.geometry.camera import Camera
from common.messages import Request
from common.tracking.base import Box
from onboard.follow.config import FollowConfig
from onboard.follow.law import FollowLaw, Vehicle
from onboard.follow.sight import Sight, TargetPlace, looks_ahead, whole_from_m
from onboard.fusion.depth import DepthConfig
from onboard.proximity.pose import Pose

Array = NDArray[np.float64]


class Steering:
    """Flies after one target.

    Args:
        config: poles, limits and times.
        depth: of the distance.
        camera: calibration of the pictures that the boxes are of.
    """

    def __init__(self, config: FollowConfig, depth: DepthConfig, camera: Camera):
        self._config, self._depth, self._camera = config, depth, camera
        self._law = FollowLaw(config, looks_ahead(camera))
        self._place = TargetPlace(config)
        self.reset()

    def calibrate(self, camera: Camera) -> None:
        """Take another calibration, which says anew how far the target is; what is kept is kept."""
        if camera != self._camera:
            self._camera = camera
            self._sight = Sight(camera, self._config, self._depth)

    def reset(self) -> None:
        """Forget the target."""
        self._law.reset()
        self._place.reset()
        self._sight = Sight(self._camera, self._config, self._depth)
        self._measured_ns = 0
        self.why_not = ""
        """Why nothing is asked; empty while something is."""

    def restart(self) -> None:
        """The last request was not flown: the next one begins at the vehicle's own velocity."""
        self._law.restart()

    def step(
        self,
        t_ns: int,
        box: Box | None,
        pose: Pose | None,
        vehicle: Vehicle | None,
        depth_m: Array | None = None,
    ) -> Request | None:
        """What to ask of helm; None, and `why_not`, without a target, a pose, or once it has been away for too long.

        Args:
            t_ns: capture stamp of the picture, ns.
            box: x, y, width, height of the target in it, px; None while it is not seen.
            pose: the vehicle then; None while unknown.
            vehicle: the vehicle then, with its rates.
            depth_m: depth inside the box, (h, w), m, 0 for none; None without a depth camera.
        """
        self.why_not = "" if pose is not None and vehicle is not None else "no vehicle state for this picture"
        if box is not None and pose is not None:
            self._look(t_ns, box, pose, depth_m)
        state = self._place.at(t_ns)
        away_s = (t_ns - self._measured_ns) / 1e9
        if state is not None and vehicle is not None and away_s <= self._config.coast_s:
            self.why_not = ""
            return self._law.ask(state, vehicle, t_ns)
        self.why_not = self.why_not or f"target not seen for {min(away_s, 999.0):.1f} s"
        return None

    def _look(self, t_ns: int, box: Box, pose: Pose, depth_m: Array | None) -> None:
        found = self._sight.place(t_ns, box, pose, depth_m)
        if found is None:
            self.why_not = self._sight.why_not
            return
        if self._measured_ns == 0 and self._config.keep == "whole" and looks_ahead(self._camera):
            level_m = float(np.hypot(*(found - pose.ned_p_m)[:2]))
            self._law.least_m = whole_from_m(self._camera, box, pose, level_m, self._config.slew_m_s2)
        self._place.measure(found, t_ns)
        self._measured_ns = t_ns
