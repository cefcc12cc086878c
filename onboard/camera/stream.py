"""What one camera sends: pictures raw and compressed, depth, and its calibration once a second. Pure but for OpenCV."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator

import cv2
import numpy as np

from common.geometry.camera import Camera
from common.messages import Image
from common.node import Output
from onboard.camera.config import VideoConfig

log = logging.getLogger(__name__)

_INFO_PERIOD_NS = 1_000_000_000
PRIMARY = "down"
"""The camera whose pictures go to the ground whether or not a reader is seen there."""


class CameraStream:
    """Turns pictures of one camera into what goes out.

    Args:
        name: the camera's name.
        camera: its calibration.
        video: quality and rate for the ground.
        has_reader: whether anyone reads a topic.
    """

    def __init__(self, name: str, camera: Camera, video: VideoConfig, has_reader: Callable[[str], bool]):
        self._name, self._calibrated, self.camera = name, camera, camera
        self._has_reader = has_reader
        self._jpeg_parameters = [cv2.IMWRITE_JPEG_QUALITY, video.jpeg_quality]
        self._jpeg_period_ns = int(1e9 / video.jpeg_rate_hz)
        self._next_jpeg_ns = 0
        self._next_info_ns = 0
        self.frames = 0
        """Pictures so far, without depth."""

    def fit(self, width: int, height: int) -> None:
        """Scale the calibration to pictures of this size, px, where they have another one than before."""
        if (width, height) == (self.camera.width, self.camera.height):
            return
        calibrated = self._calibrated
        self.camera = calibrated.resized(width, height)
        self._next_info_ns = 0
        if self.camera is not calibrated:
            log.warning(
                "the calibration is for %dx%d, the pictures are %dx%d: scaled to fit",
                calibrated.width,
                calibrated.height,
                width,
                height,
            )

    def colour(self, image: Image, capture_ns: int, t_ns: int) -> Iterator[Output]:
        """Raw when somebody on board reads it, JPEG within the configured rate, calibration at 1 Hz.

        Args:
            image: the picture, `bgr8`.
            capture_ns: its stamp.
            t_ns: now.
        """
        self.frames += 1
        raw, jpeg = f"camera/{self._name}/raw", f"camera/{self._name}/jpeg"
        if self._has_reader(raw):
            yield Output(raw, image, capture_ns)
        if (self._name == PRIMARY or self._has_reader(jpeg)) and self._jpeg_is_due(capture_ns):
            yield Output(jpeg, self._compressed(image), capture_ns)
        yield from self._info(capture_ns, t_ns)

    def depth(self, image: Image, capture_ns: int, t_ns: int) -> Iterator[Output]:
        """Depth, and the calibration at 1 Hz; arguments as `colour`."""
        yield Output(f"camera/{self._name}/depth", image, capture_ns)
        yield from self._info(capture_ns, t_ns)

    def _info(self, capture_ns: int, t_ns: int) -> Iterator[Output]:
        if t_ns >= self._next_info_ns:
            self._next_info_ns = t_ns + _INFO_PERIOD_NS
            yield Output(f"camera/{self._name}/info", self.camera.info(self._name), capture_ns)

    def _jpeg_is_due(self, capture_ns: int) -> bool:
        """Whether the rate limit lets this picture go to the ground."""
        # Half a period early is early enough: a jittering 20 Hz source must not be thinned by a limit of 20 Hz. The
        # due times stay on their grid, so the mean rate keeps to the limit.
        if capture_ns < self._next_jpeg_ns - self._jpeg_period_ns // 2:
            return False
        self._next_jpeg_ns = max(self._next_jpeg_ns + self._jpeg_period_ns, capture_ns)
        return True

    def _compressed(self, image: Image) -> Image:
        pixels = np.frombuffer(image.data, np.uint8).reshape(image.height, image.width, 3)
        ok, jpeg = cv2.imencode(".jpg", pixels, self._jpeg_parameters)
        if not ok:
            raise RuntimeError(f"JPEG encoding failed for a {image.width}x{image.height} picture")
        return Image(camera=image.camera, width=image.width, height=image.height, encoding="jpeg", data=jpeg.tobytes())
