"""The camera node: pictures from a camera, simulated or real, or a file go out raw on board, as JPEG to the ground."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Iterator

import cv2
import numpy as np

from common.config import Config
from common.geometry.camera import Camera
from common.geometry.config import CamerasConfig
from common.messages import Image
from common.node import Every, Inputs, Node, On, Output
from common.video import FileSource
from onboard.camera.config import VideoConfig
from onboard.camera.source import LiveSource, is_live, without_password

log = logging.getLogger(__name__)
_INFO_PERIOD_NS = 1_000_000_000
_SIMULATED = "sim/camera/down"
_POLL_S = 0.004
"""How often a live camera is asked for a new picture; its stamp is taken when it arrives."""


class CameraNode(Node):
    """Publishes `camera/down/raw`, `camera/down/jpeg` and, once a second while pictures come, `camera/down/info`."""

    outputs = ("camera/down/raw", "camera/down/jpeg", "camera/down/info")

    def __init__(self, config: Config, name: str):
        super().__init__(config, name)
        cv2.setNumThreads(1)
        self._video = config.section(VideoConfig)
        self._calibrated = self._camera = config.section(CamerasConfig).down.camera()
        self._file: FileSource | None = None
        self._live: LiveSource | None = None
        if self._video.source == "sim":
            self.inputs = (_SIMULATED,)
            self.trigger = On((_SIMULATED,))
        elif is_live(self._video.source):
            camera = self._camera
            self._live = LiveSource(self._video.source, camera.width, camera.height, camera.rate_hz)
            self.trigger = Every(_POLL_S)
            log.info("pictures from %s", without_password(self._video.source))
        else:
            self._file = FileSource(self._video.source, self._video.loop)
            self._camera = _scaled(self._camera, self._file.width, self._file.height)
            rate_hz = self._file.rate_hz or self._camera.rate_hz
            self._camera = dataclasses.replace(self._camera, rate_hz=rate_hz)
            self.trigger = Every(1.0 / rate_hz)
            log.info(
                "pictures from %s: %dx%d at %.1f Hz", self._video.source, self._file.width, self._file.height, rate_hz
            )
        self._jpeg_parameters = [cv2.IMWRITE_JPEG_QUALITY, self._video.jpeg_quality]
        self._next_jpeg_ns = 0
        self._next_info_ns = 0
        self._frames = 0
        self._ended = False

    def step(self, inputs: Inputs, t_ns: int) -> Iterator[Output]:
        """One picture: raw when somebody on board reads it, JPEG within the configured rate, calibration at 1 Hz."""
        if self._live is not None:
            taken = self._from_camera(self._live)
        else:
            taken = self._simulated(inputs) if self._file is None else self._from_file(t_ns)
        if taken is None:
            return
        image, capture_ns = taken
        self._frames += 1
        if self.has_reader("camera/down/raw"):
            yield Output("camera/down/raw", image, capture_ns)
        if self._jpeg_is_due(capture_ns):
            yield Output("camera/down/jpeg", self._compressed(image), capture_ns)
        if t_ns >= self._next_info_ns:
            self._next_info_ns = t_ns + _INFO_PERIOD_NS
            yield Output("camera/down/info", self._camera.info("down"), capture_ns)

    def metrics(self) -> dict[str, float]:
        """Frames so far, pictures of a folder that could not be decoded, and a live camera's losses."""
        live = self._live
        return {
            "frames": self._frames,
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

    def _simulated(self, inputs: Inputs) -> tuple[Image, int] | None:
        received = inputs.latest(_SIMULATED, Image)
        if received is None:
            return None
        delay_ns = int(self._camera.exposure_delay_ms * 1e6)
        return received.message, received.header.capture_ns - delay_ns

    def _from_camera(self, live: LiveSource) -> tuple[Image, int] | None:
        taken = live.take()
        if taken is None:
            return None
        height, width = taken.frame.shape[:2]
        if (width, height) != (self._camera.width, self._camera.height):
            self._camera = _scaled(self._calibrated, width, height)
            self._next_info_ns = 0
        delay_ns = int((self._video.latency_ms + self._camera.exposure_delay_ms) * 1e6)
        return _image(taken.frame), taken.arrived_ns - delay_ns

    def _from_file(self, t_ns: int) -> tuple[Image, int] | None:
        frame = self._file.next() if self._file is not None else None
        if frame is None:
            if not self._ended and not self._video.loop:
                log.info("%s has ended", self._video.source)
                self._ended = True
            return None
        return _image(frame), t_ns

    def _jpeg_is_due(self, capture_ns: int) -> bool:
        """Whether the rate limit lets this picture go to the ground."""
        period_ns = int(1e9 / self._video.jpeg_rate_hz)
        # Half a period early is early enough: a jittering 20 Hz source must not be thinned by a limit of 20 Hz. The
        # due times stay on their grid, so the mean rate keeps to the limit.
        if capture_ns < self._next_jpeg_ns - period_ns // 2:
            return False
        self._next_jpeg_ns = max(self._next_jpeg_ns + period_ns, capture_ns)
        return True

    def _compressed(self, image: Image) -> Image:
        pixels = np.frombuffer(image.data, np.uint8).reshape(image.height, image.width, 3)
        ok, jpeg = cv2.imencode(".jpg", pixels, self._jpeg_parameters)
        if not ok:
            raise RuntimeError(f"JPEG encoding failed for a {image.width}x{image.height} picture")
        return Image(camera=image.camera, width=image.width, height=image.height, encoding="jpeg", data=jpeg.tobytes())


def _image(frame: np.ndarray) -> Image:
    height, width = frame.shape[:2]
    return Image(camera="down", width=width, height=height, encoding="bgr8", data=frame.tobytes())


def _scaled(camera: Camera, width: int, height: int) -> Camera:
    """The calibration for pictures of another size, as a resize of the calibrated ones would give."""
    sx, sy = width / camera.width, height / camera.height
    if (sx, sy) == (1.0, 1.0):
        return camera
    log.warning(
        "the calibration is for %dx%d, the pictures are %dx%d: scaled to fit",
        camera.width,
        camera.height,
        width,
        height,
    )
    return dataclasses.replace(
        camera,
        width=width,
        height=height,
        fx_px=camera.fx_px * sx,
        fy_px=camera.fy_px * sy,
        cx_px=(camera.cx_px + 0.5) * sx - 0.5,
        cy_px=(camera.cy_px + 0.5) * sy - 0.5,
    )
