"""Live cameras: the newest picture alone, its stamp, loss and return, what is said of a device that cannot serve."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from common.config import Config, ConfigError
from common.messages import CameraInfo, Image
from common.node import Every, ScriptedRun
from onboard.camera import source as live
from onboard.camera.node import CameraNode
from onboard.camera.source import LiveSource, is_live, without_password

SECTIONS = {"camera": "common.geometry.config:CamerasConfig", "video": "onboard.camera.config:VideoConfig"}


class Script:
    """Stands in for the driver: connections that each give so many pictures, then fail; the last one waits."""

    def __init__(self, *pictures: int, shape: tuple[int, ...] = (48, 64, 3)):
        self.opened = 0
        self.hang = threading.Event()
        self._pictures = list(pictures)
        self._shape = shape

    def __call__(self) -> Script:
        self.opened += 1
        self._left = self._pictures[self.opened - 1] if self.opened <= len(self._pictures) else 0
        return self

    def isOpened(self) -> bool:
        return self._left > 0

    def read(self) -> tuple[bool, Any]:
        if self._left == 0:
            if self.opened == len(self._pictures):
                self.hang.wait(10.0)
            return False, None
        self._left -= 1
        return True, np.full(self._shape, self._left, np.uint8)

    def release(self) -> None:
        pass


def _wait(condition: Callable[[], Any], limit_s: float = 10.0) -> Any:
    """What the condition gives once that is something."""
    deadline_s = time.monotonic() + limit_s
    while not (value := condition()):
        assert time.monotonic() < deadline_s
        time.sleep(0.005)
    return value


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live, "_BACK_OFF_S", (0.01, 0.02))


@pytest.mark.parametrize("name", ["rtsp://10.0.0.2/down", "rtsps://a/b", "v4l2:0", "/dev/video3"])
def test_cameras_are_told_from_files(name: str) -> None:
    assert is_live(name)
    assert not is_live("film.avi")
    assert not is_live("sim")


def test_only_the_newest_picture_is_kept() -> None:
    script = Script(5)
    source = LiveSource("rtsp://camera", 64, 48, 20.0, script)
    _wait(lambda: source.skipped == 4)
    before_ns = time.monotonic_ns()
    taken = source.take()
    assert taken is not None
    assert taken.frame[0, 0, 0] == 0, "the fifth and last"
    assert 0 <= before_ns - taken.arrived_ns < 5_000_000_000
    assert source.take() is None
    script.hang.set()
    source.close()


def test_lost_camera_comes_back_and_is_named_once(quick: None, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    script = Script(2, 0, 0, 0, 3)
    source = LiveSource("rtsp://pilot:secret@camera/down", 64, 48, 20.0, script)
    _wait(lambda: source.reconnects == 1)
    script.hang.set()
    source.close()
    assert script.opened >= 5
    assert caplog.text.count("the camera at rtsp://camera/down was lost; trying again until it answers") == 1
    assert "is back after" in caplog.text
    assert "secret" not in caplog.text


def test_camera_that_is_not_there_yet_is_waited_for(quick: None, caplog: pytest.LogCaptureFixture) -> None:
    script = Script(0, 0, 1)
    source = LiveSource("rtsp://camera", 64, 48, 20.0, script)
    _wait(lambda: source.take() is not None)
    script.hang.set()
    source.close()
    assert caplog.text.count("cannot be reached; trying again until it answers") == 1
    assert source.reconnects == 0


def test_grey_pictures_become_colour() -> None:
    script = Script(1, shape=(48, 64))
    source = LiveSource("v4l2:0", 64, 48, 20.0, script)
    taken = _wait(source.take)
    script.hang.set()
    source.close()
    assert taken.frame.shape == (48, 64, 3)


def test_password_is_not_shown() -> None:
    assert without_password("rtsp://me:pw@10.0.0.2:554/a@b") == "rtsp://10.0.0.2:554/a@b"
    assert without_password("rtsp://10.0.0.2/a") == "rtsp://10.0.0.2/a"


def test_absent_device_is_refused_with_what_is_there() -> None:
    with pytest.raises(ConfigError, match="'/dev/video97', which does not exist; video devices here: "):
        LiveSource("v4l2:97", 640, 480, 20.0)


def test_what_is_no_video_device_is_refused(tmp_path: Path) -> None:
    for path in ("/dev/null", "/dev"):
        with pytest.raises(ConfigError, match="is no video device"):
            LiveSource(path, 640, 480, 20.0)
    with pytest.raises(ConfigError, match="is no video device"):
        LiveSource(f"v4l2:{tmp_path}", 640, 480, 20.0)


def test_forbidden_device_is_refused_with_the_cure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live, "_V4L2_MAJOR", 1)  # memory devices, /dev/null among them
    monkeypatch.setattr(live.os, "access", lambda path, mode: False)
    with pytest.raises(ConfigError, match="forbidden to this user; add it to the group `video`"):
        LiveSource("/dev/null", 640, 480, 20.0)


def test_a_device_is_opened_through_v4l2_and_asked_for_size_rate_and_no_queue(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    class Device(Script):
        def set(self, name: int, value: float) -> bool:
            asked.append((name, value))
            return True

    def opened(path: str, backend: int) -> Script:
        asked.append((path, backend))
        return device()

    device = Device(1)
    monkeypatch.setattr(live, "_check_device", lambda path: None)
    monkeypatch.setattr(live.cv2, "VideoCapture", opened)
    source = LiveSource("v4l2:2", 320, 240, 15.0)
    assert _wait(source.take).frame.shape == (48, 64, 3)
    device.hang.set()
    source.close()
    assert asked[:5] == [
        ("/dev/video2", cv2.CAP_V4L2),
        (cv2.CAP_PROP_FRAME_WIDTH, 320),
        (cv2.CAP_PROP_FRAME_HEIGHT, 240),
        (cv2.CAP_PROP_FPS, 15.0),
        (cv2.CAP_PROP_BUFFERSIZE, 1),
    ]


def test_a_device_that_opencv_cannot_open_is_named_once_and_tried_again(
    monkeypatch: pytest.MonkeyPatch, quick: None, caplog: pytest.LogCaptureFixture
) -> None:
    """OpenCV's own V4L2 code on a device that answers none of its calls: what an unplugged camera's node does."""
    monkeypatch.setattr(live, "_V4L2_MAJOR", 1)  # memory devices, /dev/null among them
    source = LiveSource("/dev/null", 640, 480, 20.0)
    _wait(lambda: "/dev/null" in caplog.text)
    time.sleep(0.2)
    source.close()
    assert caplog.text.count("the camera at /dev/null cannot be reached; trying again until it answers") == 1
    assert source.take() is None


def test_node_stamps_by_arrival_and_fits_the_calibration(monkeypatch: pytest.MonkeyPatch) -> None:
    script = Script(1)
    monkeypatch.setattr(live, "_stream_opener", lambda url: script)
    node = CameraNode(Config({"video": {"source": "rtsp://camera", "latency_ms": 80.0}}, SECTIONS), "camera")
    assert isinstance(node.trigger, Every)
    run = ScriptedRun(node)
    arrived_before_ns = time.monotonic_ns()
    outputs = _wait(lambda: {o.topic: o for o in run.step(time.monotonic_ns())})
    script.hang.set()
    node.close()
    raw, info = outputs["camera/down/raw"], outputs["camera/down/info"].message
    assert isinstance(raw.message, Image) and isinstance(info, CameraInfo)
    assert (info.width, info.height) == (64, 48)
    assert info.fx_px == pytest.approx(440.0 * 64 / 640)
    assert abs(raw.capture_ns - (arrived_before_ns - 80_000_000)) < 2_000_000_000
    assert raw.capture_ns < time.monotonic_ns() - 80_000_000
    assert node.metrics()["frames"] == 1


def test_node_names_a_missing_device() -> None:
    with pytest.raises(ConfigError, match="does not exist"):
        CameraNode(Config({"video": {"source": "/dev/video97"}}, SECTIONS), "camera")
