"""The node `world`: pictures of the simulated world as the vehicle's camera sees it, and the truth beside them."""

from __future__ import annotations

import logging
import statistics
import time
from collections import deque
from collections.abc import Iterable

import cv2
import msgspec

from common.config import Config
from common.geometry.config import CamerasConfig
from common.messages import Image
from common.node import Every, Inputs, Node, Output
from simulation.world.config import WorldConfig
from simulation.world.scenario import load_scenario
from simulation.world.stage import Stage
from simulation.world.truth_filter import Motion
from simulation.world.truth_port import TruthPort

log = logging.getLogger(__name__)

_WINDOW = 1200


class WorldNode(Node):
    """Renders the picture of the camera `down` at the vehicle's true pose, a little in the past.

    Raises:
        ConfigError: bad scenario, port in use, no headless OpenGL.
    """

    outputs = ("sim/camera/down", "truth")

    def __init__(self, config: Config, name: str = "world"):
        super().__init__(config, name)
        self._config = config.section(WorldConfig)
        self._camera = config.section(CamerasConfig).down.camera()
        self.trigger = Every(1.0 / self._camera.rate_hz)
        cv2.setNumThreads(1)
        scenario = load_scenario(self._config.scenario)
        if self._config.seed is not None:
            scenario = msgspec.structs.replace(scenario, seed=self._config.seed)
        self._stage = Stage(self._config, scenario, self._camera)
        self._last_instant_ns = self._last_step_ns = 0
        self._missed: deque[int] = deque(maxlen=_WINDOW)
        self._picture_ms: deque[float] = deque(maxlen=_WINDOW)
        self._stale = 0
        self._truth = TruthPort(self._config)
        log.info(
            "scenario %s; waiting for the vehicle's pose on UDP %s:%d",
            self._config.scenario,
            self._config.host,
            self._config.port,
        )

    def step(self, inputs: Inputs, t_ns: int) -> Iterable[Output]:
        """Picture, unless nobody reads it or the link loses it, and truth; nothing while the pose is stale."""
        self._note_lateness(t_ns)
        motion = self._motion(t_ns)
        if motion is None:
            self._stale += 1
            return []
        capture_ns = motion.t_ns + int(self._camera.exposure_delay_ms * 1e6)
        outputs = [Output("truth", self._stage.place(motion), capture_ns)]
        data = self._picture(motion.t_ns) if self.has_reader("sim/camera/down") else None
        if data is not None:
            image = Image(
                camera="down", width=self._camera.width, height=self._camera.height, encoding="bgr8", data=data
            )
            outputs.insert(0, Output("sim/camera/down", image, capture_ns))
        return outputs

    def metrics(self) -> dict[str, float]:
        """Late frames, frames without a pose, time to render, and what the radio did."""
        steps = len(self._missed)
        missed = sum(self._missed)
        return {
            "late_fraction": missed / (steps + missed) if steps else 0.0,
            "stale": float(self._stale),
            "truth_rate_hz": self._truth.rate_hz,
            "picture_ms_median": statistics.median(self._picture_ms) if self._picture_ms else 0.0,
            **self._stage.metrics(),
        }

    def close(self) -> None:
        """Close the truth port and the renderer."""
        self._truth.close()
        self._stage.close()

    def _picture(self, t_ns: int) -> bytes | None:
        started = time.perf_counter()
        data = self._stage.picture(t_ns)
        self._picture_ms.append((time.perf_counter() - started) * 1e3)
        return data

    def _note_lateness(self, t_ns: int) -> None:
        """Count the frames that fell out since the step before."""
        if self._last_step_ns:
            periods = (t_ns - self._last_step_ns) / 1e9 * self._camera.rate_hz
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
