"""Regions without depth: what the decoders read, and a real network that finds red things."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from common.config import ConfigError
from onboard.people.detector import DECODERS, PersonDetector
from onboard.people.pipeline_config import DetectorConfig
from tests.unit.onnx_file import write_identity, write_red_detector


@pytest.fixture
def config(tmp_path: Path) -> DetectorConfig:
    """The detector of red: 128 px, cells of 16 px, boxes of 20 x 40 px."""
    path = tmp_path / "red.onnx"
    write_red_detector(path, 128, 16, (20.0, 40.0))
    return DetectorConfig(file=str(path), decoder="yolo", size_px=128)


def test_boxes_come_back_in_the_pictures_own_pixels(config: DetectorConfig):
    picture = np.full((192, 256, 3), 80, np.uint8)  # goes in at half its size
    picture[64:96, 96:128] = (0, 0, 255)  # one cell: columns 3, rows 2
    (region,) = PersonDetector(config).find(picture)
    # The cell's middle is (56, 40) px of the small picture.
    assert region.box_px == (2 * (56 - 10), 2 * (40 - 20), 40, 80)
    assert region.mask.shape == (80, 40) and region.mask.all()
    assert region.camera_p_m is None and region.length_m is None


def test_of_boxes_on_top_of_each_other_the_best_is_kept(config: DetectorConfig):
    picture = np.full((128, 128, 3), 80, np.uint8)
    picture[32:64, 48:64] = (0, 0, 255)  # two cells, one above the other: boxes that share 24 of 40 rows
    assert len(PersonDetector(config).find(picture)) == 2
    tight = msgspec.structs.replace(config, most_overlap=0.4)
    assert len(PersonDetector(tight).find(picture)) == 1


def test_a_picture_without_red_shows_nobody(config: DetectorConfig):
    assert PersonDetector(config).find(np.full((100, 60, 3), 120, np.uint8)) == []


def test_a_box_that_leaves_the_picture_is_cut(config: DetectorConfig):
    picture = np.full((128, 128, 3), 80, np.uint8)
    picture[:16, :16] = (0, 0, 255)
    (region,) = PersonDetector(config).find(picture)
    assert region.box_px == (0, 0, 18, 28)


@pytest.mark.parametrize(
    ("decoder", "output", "boxes", "scores"),
    [
        ("yolo", np.array([[[50.0], [40.0], [20.0], [10.0], [0.1], [0.8]]]), [[40, 35, 60, 45]], [0.8]),
        ("yolo_objectness", np.array([[[50.0, 40.0, 20.0, 10.0, 0.5, 0.1, 0.8]]]), [[40, 35, 60, 45]], [0.4]),
        (
            "ssd",
            np.array([[[[0, 1, 0.9, 0.25, 0.5, 0.5, 1.0], [0, 2, 0.7, 0.0, 0.0, 1.0, 1.0]]]]),
            [[25, 50, 50, 100]],
            [0.9],
        ),
    ],
)
def test_what_the_decoders_read(decoder: str, output: np.ndarray, boxes: list, scores: list):
    found, rated = DECODERS[decoder](output, 1, 100)
    np.testing.assert_allclose(found, boxes)
    np.testing.assert_allclose(rated, scores)


@pytest.mark.parametrize("decoder", DECODERS)
def test_another_decoders_output_is_named(decoder: str):
    with pytest.raises(ConfigError, match=rf"decoder '{decoder}' got an output of shape \(1, 4, 3\)"):
        DECODERS[decoder](np.zeros((1, 4, 3)), 0, 100)


def test_what_cannot_be_loaded_is_named(tmp_path: Path, config: DetectorConfig):
    with pytest.raises(ConfigError, match=r"detector.file: '.*none.onnx' does not exist"):
        PersonDetector(msgspec.structs.replace(config, file=str(tmp_path / "none.onnx")))
    broken = tmp_path / "broken.onnx"
    broken.write_bytes(b"no network")
    with pytest.raises(ConfigError, match="OpenCV cannot read"):
        PersonDetector(msgspec.structs.replace(config, file=str(broken)))
    with pytest.raises(ConfigError, match=r"has no output 'boxes', only \['found'\]"):
        PersonDetector(msgspec.structs.replace(config, output="boxes"))
    identity = tmp_path / "identity.onnx"
    write_identity(identity, 64)
    wrong = PersonDetector(DetectorConfig(file=str(identity), decoder="ssd", size_px=64, person=1))
    assert wrong.find(np.zeros((64, 64, 3), np.uint8)) == [], "64 numbers a row are read as boxes of no class"
