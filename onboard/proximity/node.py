"""The node `proximity`: depth pictures in, the nearest points by direction and what was seen out, for the limiter."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Iterable

import cv2
import numpy as np

from common.config import Config, ConfigError
from common.geometry.config import CamerasConfig
from common.header import Received
from common.messages import Image, Obstacles, VehicleState
from common.node import Inputs, Node, On, Output
from common.topics import CAMERAS
from onboard.limiter.config import LimiterConfig
from onboard.proximity.blindness import REASONS, Blind
from onboard.proximity.config import ProximityConfig
from onboard.proximity.lookout import Lookout, Report
from onboard.proximity.pose import PoseTrack

log = logging.getLogger(__name__)
_STEP_S = 0.1
_SAY_EVERY_NS = 2_000_000_000
"""On a machine that is too slow a sensor goes blind and sees again by the picture: the log has one line for many."""
_LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


class ProximityNode(Node):
    """Publishes `obstacles/depth` for each depth picture, and ten times a second while there are none.

    Every camera with a depth part contributes. A vehicle without any publishes nothing: to the limiter there is then no
    such sensor, rather than a blind one.

    Raises:
        ConfigError: `proximity.clearance_m` is not above `limiter.h_desired_m`.
    """

    inputs = (*(f"camera/{name}/depth" for name in CAMERAS), "helm/state")
    outputs = ("obstacles/depth",)
    trigger = On(tuple(f"camera/{name}/depth" for name in CAMERAS), at_least_every_s=_STEP_S)

    def __init__(self, config: Config, name: str):
        super().__init__(config, name)
        cv2.setNumThreads(1)
        self._config = config.section(ProximityConfig)
        desired_m = config.section(LimiterConfig).h_desired_m
        if self._config.clearance_m <= desired_m:
            raise ConfigError(
                f"proximity.clearance_m: got {self._config.clearance_m}, expected more than limiter.h_desired_m = "
                f"{desired_m:g}, or a surface could be too near without braking anything"
            )
        sections = config.section(CamerasConfig).by_name()
        sensors = {name: section.depth_camera() for name, section in sections.items()}
        self._eyes = {name: Lookout(sensor, self._config) for name, sensor in sensors.items() if sensor is not None}
        pictures = tuple(f"camera/{name}/depth" for name in self._eyes)
        self.inputs = (*pictures, "helm/state") if pictures else ()
        self.trigger = On(pictures, at_least_every_s=_STEP_S if pictures else None)
        self._poses = PoseTrack()
        self._taken: dict[str, Received[Image]] = {}
        self._reports: dict[str, tuple[int, int, Report]] = {}
        self._blind: dict[str, Blind] = dict.fromkeys(self._eyes, "silent")
        self._said: dict[str, tuple[Blind, int]] = dict.fromkeys(self._eyes, ("silent", -_SAY_EVERY_NS))
        self._counts: Counter[str] = Counter()
        if not self._eyes:
            log.info("no camera with depth in the vehicle's file: nothing to do")

    def step(self, inputs: Inputs, t_ns: int) -> Iterable[Output]:
        """What all sensors show now; a sensor that is silent or blind shows nothing, and says so."""
        if not self._eyes:
            return
        for received in inputs.drain("helm/state", VehicleState):
            self._poses.add(received.header.capture_ns, received.message)
        fresh = [name for name in self._eyes if self._look(name, inputs, t_ns)]
        silent = [name for name in self._eyes if self._fall_silent(name, t_ns)]
        if fresh or silent:
            reports = [self._reports[name] for name in self._eyes if name in self._reports]
            yield Output(
                "obstacles/depth",
                Obstacles(
                    obstacles=tuple(o for _, _, report in reports for o in report.obstacles),
                    views=tuple(report.view for _, _, report in reports),
                ),
                min(capture_ns for capture_ns, _, _ in reports),
            )

    def metrics(self) -> dict[str, float]:
        """Pictures so far, how many of them were blind and why, and how many sensors are blind now."""
        blind = {f"blind_{reason}": float(self._counts[reason]) for reason in REASONS}
        return {
            "pictures": float(self._counts["pictures"]),
            **blind,
            "blind_now": float(sum(1 for reason in self._blind.values() if reason)),
        }

    def _look(self, name: str, inputs: Inputs, t_ns: int) -> bool:
        """Read a sensor's newest picture; whether there was one."""
        topic = f"camera/{name}/depth"
        received = inputs.peek(topic, Image)
        if received is None or received is self._taken.get(name):
            return False
        self._taken[name] = received
        if inputs.latest(topic, Image) is None:
            return False
        self._counts["pictures"] += 1
        capture_ns = received.header.capture_ns
        pose = self._poses.at(capture_ns)
        eye = self._eyes[name]
        report = eye.blind(_LEVEL, "no_pose") if pose is None else eye.look(received.message, capture_ns, pose)
        self._note(name, report, t_ns if report.blind else capture_ns, t_ns)
        return True

    def _fall_silent(self, name: str, t_ns: int) -> bool:
        """Report a sensor that sends nothing, at each step; whether it is one."""
        last = self._reports.get(name)
        if last is not None and t_ns - last[1] < self._config.silent_s * 1e9 and last[2].blind != "silent":
            return False
        pose = self._poses.at(t_ns)
        attitude = _LEVEL if pose is None else pose.ned_q_body
        self._note(name, self._eyes[name].blind(attitude, "silent"), t_ns, t_ns)
        return True

    def _note(self, name: str, report: Report, capture_ns: int, t_ns: int) -> None:
        self._reports[name] = (capture_ns, t_ns, report)
        if report.blind:
            self._counts[report.blind] += 1
        self._blind[name] = report.blind
        said, said_ns = self._said[name]
        if report.blind != said and t_ns - said_ns >= _SAY_EVERY_NS:
            self._said[name] = (report.blind, t_ns)
            if report.blind:
                log.warning("%s: the depth pictures show nothing: %s", name, report.blind.replace("_", " "))
            else:
                log.info("%s: the depth pictures show something", name)
