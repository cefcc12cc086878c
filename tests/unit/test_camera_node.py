"""The camera node: file sources, rates, calibration, bad input."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from common.config import Config, ConfigError
from common.messages import CameraInfo, Image
from common.node import Every, ScriptedRun
from common.video import FileSource
from onboard.camera.node import CameraNode

SECTIONS = {"camera": "common.geometry.config:CamerasConfig", "video": "onboard.camera.config:VideoConfig"}
MS = 1_000_000


def _node(**video: object) -> CameraNode:
    return CameraNode(Config({"video": video}, SECTIONS), "camera")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for index in range(3):
        cv2.imwrite(str(tmp_path / f"{index:03d}.png"), np.full((48, 64, 3), 60 * index, np.uint8))
    return tmp_path


def _picture(level: int = 90) -> Image:
    return Image(camera="down", width=64, height=48, encoding="bgr8", data=bytes([level]) * (64 * 48 * 3))


def test_folder_is_read_in_order_and_again(folder: Path) -> None:
    source = FileSource(str(folder), loop=True)
    frames = [source.next() for _ in range(4)]
    assert [int(f[0, 0, 0]) for f in frames if f is not None] == [0, 60, 120, 0]


def test_folder_ends_without_loop(folder: Path) -> None:
    source = FileSource(str(folder), loop=False)
    assert [source.next() is None for _ in range(4)] == [False, False, False, True]


def test_undecodable_picture_is_skipped_and_counted(folder: Path) -> None:
    (folder / "001.png").write_bytes(b"this is no picture")
    source = FileSource(str(folder), loop=False)
    assert [source.next() is None for _ in range(3)] == [False, True, False]
    assert source.corrupt == 1


def test_mixed_sizes_become_the_first_ones(folder: Path) -> None:
    cv2.imwrite(str(folder / "002.png"), np.zeros((96, 128, 3), np.uint8))
    source = FileSource(str(folder), loop=False)
    shapes = {f.shape for f in (source.next() for _ in range(3)) if f is not None}
    assert shapes == {(48, 64, 3)}


@pytest.mark.parametrize(("content", "words"), [(None, "does not exist"), (b"nonsense", "cannot be decoded")])
def test_bad_source_says_what_and_what_was_expected(tmp_path: Path, content: bytes | None, words: str) -> None:
    path = tmp_path / "film.avi"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ConfigError, match=words):
        _node(source=str(path))


def test_empty_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="holds no image"):
        _node(source=str(tmp_path))


def test_simulated_picture_goes_out_raw_and_compressed_with_its_capture_stamp() -> None:
    run = ScriptedRun(_node())
    run.feed("sim/camera/down", _picture(), capture_ns=1000 * MS, received_ns=1010 * MS)
    outputs = {o.topic: o for o in run.step(1011 * MS)}
    assert {o.capture_ns for o in outputs.values()} == {1000 * MS}
    jpeg = outputs["camera/down/jpeg"].message
    assert isinstance(jpeg, Image)
    decoded = cv2.imdecode(np.frombuffer(jpeg.data, np.uint8), cv2.IMREAD_COLOR)
    assert decoded is not None and abs(int(decoded[10, 10, 0]) - 90) <= 2
    assert isinstance(outputs["camera/down/info"].message, CameraInfo)


def test_exposure_delay_moves_the_stamp_back() -> None:
    config = Config({"camera": {"down": {"exposure_delay_ms": 7.0}}}, SECTIONS)
    run = ScriptedRun(CameraNode(config, "camera"))
    run.feed("sim/camera/down", _picture(), capture_ns=1000 * MS)
    assert run.step(1001 * MS)[0].capture_ns == 993 * MS


@pytest.mark.parametrize(("limit_hz", "expected_hz"), [(30.0, 20.0), (20.0, 20.0), (15.0, 15.0), (5.0, 5.0)])
def test_jpeg_rate_keeps_to_its_limit(limit_hz: float, expected_hz: float) -> None:
    run = ScriptedRun(_node(jpeg_rate_hz=limit_hz))
    sent = 0
    for index in range(200):
        jitter = (-4 if index % 2 else 4) * MS
        t_ns = 1_000_000_000 + index * 50 * MS + jitter
        run.feed("sim/camera/down", _picture(), capture_ns=t_ns)
        sent += any(o.topic == "camera/down/jpeg" for o in run.step(t_ns + MS))
    assert sent / 10.0 == pytest.approx(expected_hz, rel=0.06)


def test_no_reader_no_raw_picture() -> None:
    node = _node()
    node.has_reader = lambda topic: topic != "camera/down/raw"
    run = ScriptedRun(node)
    run.feed("sim/camera/down", _picture(), capture_ns=1000 * MS)
    assert "camera/down/raw" not in {o.topic for o in run.step(1001 * MS)}


def test_depth_is_asked_for_only_while_somebody_reads_it() -> None:
    front = {"width": 64, "height": 48, "fx_px": 40.0, "fy_px": 40.0, "cx_px": 31.5, "cy_px": 23.5, "depth": {}}
    node = CameraNode(Config({"camera": {"front": front}}, SECTIONS), "camera")
    node.has_reader = lambda topic: topic == "camera/front/jpeg"
    assert node.wants("sim/camera/front") and not node.wants("sim/camera/front/depth")
    node.has_reader = lambda topic: topic == "camera/front/depth"
    assert node.wants("sim/camera/front/depth") and not node.wants("sim/camera/front")


def test_calibration_is_scaled_to_the_pictures_of_a_file(folder: Path) -> None:
    node = _node(source=str(folder))
    assert isinstance(node.trigger, Every)
    info = next(o.message for o in ScriptedRun(node).step(0) if o.topic == "camera/down/info")
    assert isinstance(info, CameraInfo)
    assert (info.width, info.height) == (64, 48)
    assert info.fx_px == pytest.approx(440.0 * 64 / 640)
    assert info.cx_px == pytest.approx(31.5)


def test_calibration_is_not_sent_without_pictures(folder: Path) -> None:
    run = ScriptedRun(_node(source=str(folder), loop=False))
    for index in range(3):
        run.step(index * 2000 * MS)
    assert run.step(8000 * MS) == []
