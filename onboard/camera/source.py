"""Pictures from a camera that runs by itself: a V4L2 device or an RTSP stream, always the newest one."""

from __future__ import annotations

import logging
import os
import re
import stat
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import cv2
import numpy as np

from common.config import ConfigError
from common.video import Frame

log = logging.getLogger(__name__)
_BACK_OFF_S = (0.5, 1.0, 2.0, 4.0)
_OPEN_TIMEOUT_MS = 4000
_READ_TIMEOUT_MS = 2000
"""A stream that is silent for so long is taken as lost."""
_JOIN_S = 5.0
_V4L2_MAJOR = 81
"""Number of V4L2's character devices (Linux, Documentation/admin-guide/devices.txt)."""


class Taken(NamedTuple):
    """One picture."""

    frame: Frame
    """(H, W, 3), BGR."""
    arrived_ns: int
    """When it had arrived and was decoded, monotonic, ns."""


class Capture(Protocol):
    """What of OpenCV's `VideoCapture` is used."""

    def isOpened(self) -> bool:
        """Whether there is a connection."""
        ...

    def read(self) -> tuple[bool, Any]:
        """Wait for the next picture."""
        ...

    def release(self) -> None:
        """Close."""
        ...


def is_live(source: str) -> bool:
    """Whether a `--source` names a camera rather than a file."""
    return source.startswith(("rtsp://", "rtsps://", "v4l2:", "/dev/"))


class LiveSource:
    """Reads a camera in a thread of its own and keeps the newest picture alone; comes back when it was lost.

    Args:
        source: `rtsp://…`, `/dev/videoN` or `v4l2:N`.
        width: wanted width of a V4L2 device, px; a stream comes as it is.
        height: wanted height, px.
        rate_hz: wanted rate, Hz.
        opener: makes the connection; None takes OpenCV's.

    Raises:
        ConfigError: a device that is absent, forbidden or no video device. A stream may come later: it is waited for.
    """

    def __init__(
        self, source: str, width: int, height: int, rate_hz: float, opener: Callable[[], Capture] | None = None
    ):
        self._name = without_password(source)
        if opener is None:
            opener = _stream_opener(source) if "://" in source else _device_opener(source, width, height, rate_hz)
        self._opener = opener
        self._stop = threading.Event()
        self._lock = threading.Lock()
        self._newest: Taken | None = None
        self.skipped = 0
        """Pictures that a newer one replaced before they were taken."""
        self.reconnects = 0
        """How often the camera came back after it was lost."""
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)
        self._thread.start()

    def take(self) -> Taken | None:
        """The newest picture that was not taken yet; None when there is none."""
        with self._lock:
            taken, self._newest = self._newest, None
        return taken

    def close(self) -> None:
        """End the thread; a connection that hangs is left to its time-out."""
        self._stop.set()
        self._thread.join(_JOIN_S)

    def _run(self) -> None:
        failures, since_s, ever = 0, time.monotonic(), False
        while not self._stop.is_set():
            capture = self._opener()
            arrived = self._drain(capture, failures, since_s, ever) if capture.isOpened() else 0
            capture.release()
            if self._stop.is_set():
                return
            if arrived:
                failures, since_s, ever = 0, time.monotonic(), True
            if failures == 0:
                what = "was lost" if ever else "cannot be reached"
                log.warning("the camera at %s %s; trying again until it answers", self._name, what)
            self._stop.wait(_BACK_OFF_S[min(failures, len(_BACK_OFF_S) - 1)])
            failures += 1

    def _drain(self, capture: Capture, failures: int, since_s: float, ever: bool) -> int:
        """Keep the newest picture until the camera is lost; the number of those that came."""
        arrived = 0
        while not self._stop.is_set():
            ok, frame = capture.read()
            if not ok or frame is None:
                break
            taken = Taken(_in_colour(np.asarray(frame)), time.monotonic_ns())
            with self._lock:
                self.skipped += self._newest is not None
                self._newest = taken
            if arrived == 0:
                height, width = taken.frame.shape[:2]
                again = f"is back after {time.monotonic() - since_s:.1f} s" if ever and failures else "answers"
                log.info("the camera at %s %s: %dx%d", self._name, again, width, height)
                self.reconnects += ever
            arrived += 1
        return arrived


def check_live(source: str) -> None:
    """Raise ConfigError for a device that is absent, forbidden or no video device; a stream may come later."""
    if "://" not in source:
        _check_device(_device_path(source))


def without_password(source: str) -> str:
    """The source as it may be logged: without user and password."""
    return re.sub(r"^(\w+://)[^/@]*@", r"\1", source)


def _in_colour(frame: np.ndarray) -> Frame:
    if frame.ndim == 2:
        frame = np.asarray(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
    return np.ascontiguousarray(frame, dtype=np.uint8)


def _stream_opener(url: str) -> Callable[[], Capture]:
    # FFmpeg reads these when a stream is opened: TCP, so that a lost packet costs no picture, and no buffer.
    os.environ.setdefault("OPENCV_FFMPEG_CAPTURE_OPTIONS", "rtsp_transport;tcp|fflags;nobuffer|flags;low_delay")
    limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, _OPEN_TIMEOUT_MS, cv2.CAP_PROP_READ_TIMEOUT_MSEC, _READ_TIMEOUT_MS]
    return lambda: cv2.VideoCapture(url, cv2.CAP_FFMPEG, limits)


def _device_opener(source: str, width: int, height: int, rate_hz: float) -> Callable[[], Capture]:
    path = _device_path(source)
    _check_device(path)

    def opened() -> Capture:
        capture = cv2.VideoCapture(path, cv2.CAP_V4L2)
        for name, value in (
            (cv2.CAP_PROP_FRAME_WIDTH, width),
            (cv2.CAP_PROP_FRAME_HEIGHT, height),
            (cv2.CAP_PROP_FPS, rate_hz),
            (cv2.CAP_PROP_BUFFERSIZE, 1),
        ):
            capture.set(name, value)
        return capture

    return opened


def _device_path(source: str) -> str:
    """Path of a V4L2 device: `v4l2:0` and `v4l2:/dev/video0` are `/dev/video0`."""
    name = source.removeprefix("v4l2:")
    return f"/dev/video{name}" if name.isdigit() else name


def _check_device(path: str) -> None:
    """Raise ConfigError unless this is a V4L2 device that may be used."""
    device = Path(path)
    if not device.exists():
        there = ", ".join(sorted(str(p) for p in Path("/dev").glob("video*"))) or "none"
        raise ConfigError(
            f"video.source: got {path!r}, which does not exist; video devices here: {there}; is it plugged in?"
        )
    status = device.stat()
    if not stat.S_ISCHR(status.st_mode) or os.major(status.st_rdev) != _V4L2_MAJOR:
        raise ConfigError(f"video.source: {path!r} is no video device; expected /dev/videoN, v4l2:N or a file")
    if not os.access(path, os.R_OK | os.W_OK):
        raise ConfigError(
            f"video.source: {path!r} is forbidden to this user; add it to the group `video` and log in again"
        )
