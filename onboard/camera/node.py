"""The camera node: pictures from cameras, simulated or real, or a file go out raw on board, as JPEG to the ground."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Iterator

import cv2
import numpy as np

from common.config import Config
from common.geometry.config import CameraConfig, CamerasConfig
from common.header import Received
from common.messages import Image
from common.node import Every, Inputs, Node, On, Output
from common.topics import CAMERAS
from common.video import FileSource
from onboard.camera.config import VideoConfig
from onboard.camera.source import LiveSource, is_live, without_password
from onboard.camera.stream import PRIMARY, CameraStream

log = logging.getLogger(__name__)
_SIMULATED = f"sim/camera/{PRIMARY}"
_POLL_S = 0.004
"""How often a live camera is asked for a new picture; its stamp is taken when it arrives."""
_PARTS = ("raw", "jpeg", "info", "depth")


class CameraNode(Node):
    """Publishes `camera/<name>/raw`, `jpeg`, `depth` and, once a second while any of them come, `info`.

    The pictures of `down` come from `video.source`; those of other cameras, and depth, from the simulation, where
    somebody reads them.
    """

    outputs = tuple(f"camera/{name}/{part}" for name in CAMERAS for part in _PARTS)

    def __init__(self, config: Config, name: str):
        super().__init__(config, name)
        cv2.setNumThreads(1)
        self._video = config.section(VideoConfig)
        cameras = config.section(CamerasConfig).by_name()
        self._sections = cameras
        self._file: FileSource | None = None
        self._live: LiveSource | None = None
        down = cameras[PRIMARY].camera()
        others = _from_simulation(cameras)
        if self._video.source == "sim":
            self.trigger = On((_SIMULATED, *others))
            self.inputs = (_SIMULATED, *others)
        elif is_live(self._video.source):
            self._live = LiveSource(self._video.source, down.width, down.height, down.rate_hz)
            self.trigger = Every(_POLL_S)
            self.inputs = tuple(others)
            log.info("pictures from %s", without_password(self._video.source))
        else:
            self._file = FileSource(self._video.source, self._video.loop)
            rate_hz = self._file.rate_hz or down.rate_hz
            down = dataclasses.replace(down, rate_hz=rate_hz)
            self.trigger = Every(1.0 / rate_hz)
            self.inputs = tuple(others)
            log.info(
                "pictures from %s: %dx%d at %.1f Hz", self._video.source, self._file.width, self._file.height, rate_hz
            )
        self.on_demand = others
        calibrations = {name: section.camera() for name, section in cameras.items()} | {PRIMARY: down}
        self._streams = {
            name: CameraStream(name, camera, self._video, lambda topic: self.has_reader(topic))
            for name, camera in calibrations.items()
        }
        if self._file is not None:
            self._streams[PRIMARY].fit(self._file.width, self._file.height)
        self._taken: dict[str, Received[Image]] = {}
        self._ended = False

    def step(self, inputs: Inputs, t_ns: int) -> Iterator[Output]:
        """Whatever pictures have come since the last step."""
        if self._live is not None:
            taken = self._from_camera(self._live)
        elif self._file is not None:
            taken = self._from_file(self._file, t_ns)
        else:
            taken = self._simulated(inputs, _SIMULATED, PRIMARY)
        if taken is not None:
            yield from self._streams[PRIMARY].colour(*taken, t_ns)
        for topic in self.on_demand:
            camera, depth = topic.split("/")[2], topic.endswith("/depth")
            taken = self._simulated(inputs, topic, camera)
            if taken is not None:
                stream = self._streams[camera]
                yield from (stream.depth if depth else stream.colour)(*taken, t_ns)

    def metrics(self) -> dict[str, float]:
        """Frames so far, pictures of a folder that could not be decoded, and a live camera's losses."""
        live = self._live
        return {
            "frames": sum(stream.frames for stream in self._streams.values()),
            "corrupt": self._file.corrupt if self._file else 0,
            "skipped": live.skipped if live else 0,
            "reconnects": live.reconnects if live else 0,
        }

    def close(self) -> None:
        """Release the file or the camera."""
        if self._file is not None:
            self._file.close()
        if self._live is not None:
            self._live.close()

    def _simulated(self, inputs: Inputs, topic: str, camera: str) -> tuple[Image, int] | None:
        """Newest picture of a simulated camera and its capture time, once."""
        received = inputs.peek(topic, Image)
        if received is None or received is self._taken.get(topic):
            return None
        self._taken[topic] = received
        if inputs.latest(topic, Image) is None:
            return None  # too old
        delay_ns = int(self._sections[camera].exposure_delay_ms * 1e6)
        return received.message, received.header.capture_ns - delay_ns

    def _from_camera(self, live: LiveSource) -> tuple[Image, int] | None:
        taken = live.take()
        if taken is None:
            return None
        height, width = taken.frame.shape[:2]
        stream = self._streams[PRIMARY]
        stream.fit(width, height)
        delay_ns = int((self._video.latency_ms + stream.camera.exposure_delay_ms) * 1e6)
        return _image(taken.frame), taken.arrived_ns - delay_ns

    def _from_file(self, file: FileSource, t_ns: int) -> tuple[Image, int] | None:
        frame = file.next()
        if frame is None:
            if not self._ended and not self._video.loop:
                log.info("%s has ended", self._video.source)
                self._ended = True
            return None
        return _image(frame), t_ns


def _from_simulation(cameras: dict[str, CameraConfig]) -> dict[str, tuple[str, ...]]:
    """Simulated streams that are read on demand, and the outputs that ask for them."""
    found = {}
    for name, section in cameras.items():
        if name != PRIMARY:
            found[f"sim/camera/{name}"] = (f"camera/{name}/raw", f"camera/{name}/jpeg")
        if section.depth is not None:
            found[f"sim/camera/{name}/depth"] = (f"camera/{name}/depth",)
    return found


def _image(frame: np.ndarray) -> Image:
    height, width = frame.shape[:2]
    return Image(camera=PRIMARY, width=width, height=height, encoding="bgr8", data=frame.tobytes())
