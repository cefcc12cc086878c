"""The node `world`: pictures of the simulated world as the vehicle's cameras see it, and the truth beside them."""

from __future__ import annotations

import logging
import statistics
import time
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import cv2
import msgspec

from common.config import Config
from common.geometry.camera import Camera
from common.geometry.config import CamerasConfig
from common.messages import Image
from common.node import Every, Inputs, Node, Output
from common.topics import CAMERAS
from simulation.world.config import WorldConfig
from simulation.world.scenario import load_scenario
from simulation.world.stage import Stage
from simulation.world.truth_filter import Motion
from simulation.world.truth_port import TruthPort

log = logging.getLogger(__name__)

_WINDOW = 1200


@dataclass
class _Stream:
    """Pictures of one kind from one camera."""

    topic: str
    name: str
    camera: Camera
    depth: bool
    next_ns: int = 0

    def due(self, t_ns: int) -> bool:
        """Whether the next picture is due at an instant, ns; if so, the one after it is a period later."""
        period_ns = round(1e9 / self.camera.rate_hz)
        # Half a period early is early enough, as the world steps on a grid of its own; see the camera node.
        if t_ns < self.next_ns - period_ns // 2:
            return False
        self.next_ns = max(self.next_ns + period_ns, t_ns)
        return True


class WorldNode(Node):
    """Renders what the vehicle's cameras see at its true pose, a little in the past.

    Raises:
        ConfigError: bad scenario, port in use, no headless OpenGL.
    """

    outputs = (*(f"sim/camera/{name}{part}" for name in CAMERAS for part in ("", "/depth")), "truth")

    def __init__(self, config: Config, name: str = "world"):
        super().__init__(config, name)
        self._config = config.section(WorldConfig)
        cameras = config.section(CamerasConfig)
        self._streams = list(_streams(cameras))
        self._rate_hz = max(stream.camera.rate_hz for stream in self._streams)
        self._exposure_delay_ns = int(cameras.down.exposure_delay_ms * 1e6)
        self.trigger = Every(1.0 / self._rate_hz)
        cv2.setNumThreads(1)
        scenario = load_scenario(self._config.scenario)
        if self._config.seed is not None:
            scenario = msgspec.structs.replace(scenario, seed=self._config.seed)
        self._stage = Stage(self._config, scenario, cameras)
        self._last_instant_ns = self._last_step_ns = 0
        self._missed: deque[int] = deque(maxlen=_WINDOW)
        self._picture_ms: deque[float] = deque(maxlen=_WINDOW)
        self._depth_ms: deque[float] = deque(maxlen=_WINDOW)
        self._stale = 0
        self._truth = TruthPort(self._config)
        log.info(
            "scenario %s; waiting for the vehicle's pose on UDP %s:%d",
            self._config.scenario,
            self._config.host,
            self._config.port,
        )

    def step(self, inputs: Inputs, t_ns: int) -> Iterable[Output]:
        """Pictures, unless nobody reads them or the link loses them, and truth; nothing while the pose is stale."""
        self._note_lateness(t_ns)
        motion = self._motion(t_ns)
        if motion is None:
            self._stale += 1
            return []
        truth = Output("truth", self._stage.place(motion), motion.t_ns + self._exposure_delay_ns)
        pictures = (self._taken(stream, motion.t_ns) for stream in self._streams)
        return [*(picture for picture in pictures if picture is not None), truth]

    def metrics(self) -> dict[str, float]:
        """Late frames, frames without a pose, time to render, and what the radio did."""
        steps = len(self._missed)
        missed = sum(self._missed)
        return {
            "late_fraction": missed / (steps + missed) if steps else 0.0,
            "stale": float(self._stale),
            "truth_rate_hz": self._truth.rate_hz,
            "picture_ms_median": statistics.median(self._picture_ms) if self._picture_ms else 0.0,
            "depth_ms_median": statistics.median(self._depth_ms) if self._depth_ms else 0.0,
            **self._stage.metrics(),
        }

    def close(self) -> None:
        """Close the truth port and the renderer."""
        self._truth.close()
        self._stage.close()

    def _taken(self, stream: _Stream, t_ns: int) -> Output | None:
        """Picture of a stream, when it is due, somebody reads it, and it arrives."""
        if not stream.due(t_ns) or not self.has_reader(stream.topic):
            return None
        started = time.perf_counter()
        taken = self._stage.depth(t_ns, stream.name) if stream.depth else self._stage.picture(t_ns, stream.name)
        (self._depth_ms if stream.depth else self._picture_ms).append((time.perf_counter() - started) * 1e3)
        if taken is None:
            return None
        camera = stream.camera
        encoding = "depth_mm" if stream.depth else "bgr8"
        image = Image(camera=stream.name, width=camera.width, height=camera.height, encoding=encoding, data=taken)
        return Output(stream.topic, image, t_ns + int(camera.exposure_delay_ms * 1e6))

    def _note_lateness(self, t_ns: int) -> None:
        """Count the frames that fell out since the step before."""
        if self._last_step_ns:
            periods = (t_ns - self._last_step_ns) / 1e9 * self._rate_hz
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


def _streams(cameras: CamerasConfig) -> Iterator[_Stream]:
    """All pictures of all cameras: colour and depth of the same rate are taken at the same instants."""
    for name, section in cameras.by_name().items():
        yield _Stream(f"sim/camera/{name}", name, section.camera(), depth=False)
        sensor = section.depth_camera()
        if sensor is not None:
            yield _Stream(f"sim/camera/{name}/depth", name, sensor.camera, depth=True)
