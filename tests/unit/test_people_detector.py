"""Regions without depth: what the decoders read, and a real network that finds red things."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from common.config import ConfigError
from onboard.people.detector import DECODERS, PersonDetector, default_boxes, windows
from onboard.people.pipeline_config import DetectorConfig
from tests.unit.onnx_file import write_identity, write_raw_ssd, write_red_detector


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


@pytest.mark.parametrize("decoder", ["yolo_objectness", "ssd"])
def test_networks_of_other_layouts_find_the_same(tmp_path: Path, decoder: str):
    path = tmp_path / "red.onnx"
    write_red_detector(path, 128, 16, (20.0, 40.0), decoder)
    picture = np.full((192, 256, 3), 80, np.uint8)
    picture[64:96, 96:128] = (0, 0, 255)
    config = DetectorConfig(file=str(path), decoder=decoder, size_px=128, person=1)  # type: ignore[arg-type]
    (region,) = PersonDetector(config).find(picture)
    assert region.box_px == (92, 40, 40, 80)
    assert PersonDetector(msgspec.structs.replace(config, person=0)).find(picture) == [], "another class's"


def test_an_ssd_without_its_last_steps_is_decoded_against_its_default_boxes(tmp_path: Path):
    boxes, path = default_boxes(300), tmp_path / "ssd.onnx"
    assert boxes.shape == (1917, 4), "as TensorFlow's models of 300 px have them"
    assert boxes[0].tolist() == pytest.approx([0.5 / 19, 0.5 / 19, 0.1, 0.1])
    assert boxes[-1].tolist() == pytest.approx([0.5, 0.5, 0.95**0.5, 0.95**0.5])
    sure = 19 * 19 * 3 + 6 * (4 * 10 + 5)  # of 10 x 10 cells row 4, column 5; its square of 0.35
    write_raw_ssd(path, 300, len(boxes), sure)
    config = DetectorConfig(
        file=str(path), decoder="ssd_raw", output="boxes", scores="scores", size_px=300, person=1, least_score=0.5
    )
    (region,) = PersonDetector(config).find(np.full((300, 300, 3), 90, np.uint8))
    side = 0.35 * 300
    middle = (0.55 * 300 + 0.1 * side, 0.45 * 300)
    assert region.box_px == pytest.approx((middle[0] - side / 2, middle[1] - side, side, 2 * side), abs=1)
    with pytest.raises(ConfigError, match=r"output of shape \(1, 1917, 7\), expected 540 boxes at 150 px"):
        DECODERS["ssd_raw"](np.zeros((1, 1917, 7)), 1, 150)
    with pytest.raises(ConfigError, match=r"detector.scores: .* has no output 'classes'"):
        PersonDetector(msgspec.structs.replace(config, scores="classes"))


def test_squares_cover_the_picture_and_find_what_is_small_in_it_once(config: DetectorConfig):
    whole, *squares = windows(768, 576, 3)
    assert whole == (0, 0, 768, 576) and len(squares) == 15 and {s[2] for s in squares} == {250}
    covered = np.zeros((576, 768), int)
    for x, y, width, height in squares:
        covered[y : y + height, x : x + width] += 1
    assert covered.min() >= 1
    picture = np.full((256, 256, 3), 80, np.uint8)
    picture[58:78, 58:78] = (0, 0, 255)  # less than half of any cell of the whole picture; all of one of a square's
    assert PersonDetector(config).find(picture) == []
    (region,) = PersonDetector(msgspec.structs.replace(config, tiles=2)).find(picture)
    assert region.box_px == pytest.approx((56, 44, 24, 48), abs=2)


def test_of_boxes_on_top_of_each_other_the_best_is_kept(config: DetectorConfig):
    picture = np.full((128, 128, 3), 80, np.uint8)
    picture[32:64, 48:64] = (0, 0, 255)  # two cells, one above the other: boxes that share 24 of 40 rows
    assert len(PersonDetector(config).find(picture)) == 2
    tight = msgspec.structs.replace(config, most_overlap=0.4)
    assert len(PersonDetector(tight).find(picture)) == 1
    (mean,) = PersonDetector(msgspec.structs.replace(tight, merged=True)).find(picture)
    assert mean.box_px == (46, 28, 20, 40), "between the two, which are equally sure"


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


@pytest.mark.parametrize("decoder", ["yolo", "yolo_objectness", "ssd"])
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
    with pytest.raises(ConfigError, match=r"decoder 'ssd' got an output of shape \(1, 3, 64, 64\), expected 7 numbers"):
        PersonDetector(DetectorConfig(file=str(identity), decoder="ssd", size_px=64, person=1))
