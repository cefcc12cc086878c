"""Upright crops, joint maps of any network, and the pose of a body that lies at any angle."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from common.config import ConfigError
from onboard.people.pose import HEAD, NECK, WAIST, upright_crop
from onboard.people.pose_finder import PoseFinder
from onboard.people.pose_network import PoseNetwork, read_model
from onboard.people.regions import Region
from tests.unit.onnx_file import write_identity

SIZE = 64
# Head red, hips green, feet blue; what lies between is the middle of two.
MAP = "[[0], [0, 1], [0, 1], [1], [1], [0, 1], [1], [1], [1], [1, 2], [2], [1], [1, 2], [2], [1]]"


def _model(folder: Path, text: str = "") -> Path:
    write_identity(folder / "colours.onnx", SIZE)
    file = folder / "model.toml"
    file.write_text(
        text or f'file = "colours.onnx"\nsize_px = {SIZE}\noutput = "maps"\nkind = "heatmaps"\njoints = {MAP}\n'
    )
    return file


def _body(angle_rad: float, middle: tuple[float, float], length_px: float) -> tuple[np.ndarray, Region, np.ndarray]:
    """A picture of a body of three dots on a bar, the bar as its region, and the places of the dots, head first."""
    up = np.array([math.sin(angle_rad), -math.cos(angle_rad)])
    places = np.array([np.array(middle) + k * length_px * up for k in (0.42, -0.02, -0.42)])
    picture, drawn = np.zeros((240, 320, 3), np.uint8), np.zeros((240, 320), np.uint8)
    ends = [np.round(np.array(middle) + k * length_px * up).astype(int) for k in (0.5, -0.5)]
    cv2.line(drawn, tuple(map(int, ends[0])), tuple(map(int, ends[1])), 1, int(length_px / 5))
    for place, colour in zip(places, ((0, 0, 250), (0, 250, 0), (250, 0, 0)), strict=True):
        cv2.circle(picture, tuple(map(int, np.round(place))), 3, colour, -1)
    picture = cv2.GaussianBlur(picture, (7, 7), 2.0)
    x, y, w, h = cv2.boundingRect(drawn)
    region = Region((x, y, w, h), drawn[y : y + h, x : x + w] > 0, None, None, None, None)
    return np.asarray(picture, np.uint8), region, places


@pytest.mark.parametrize("angle_deg", [-170, -90, -40, 0, 25, 90, 135, 180])
def test_a_body_is_found_at_any_angle(tmp_path: Path, angle_deg: float):
    finder = PoseFinder(PoseNetwork(read_model(_model(tmp_path))))
    picture, region, places = _body(math.radians(angle_deg), (150.0, 120.0), 90.0)
    pose = finder.find(picture, region)
    np.testing.assert_allclose(pose.joints_px[HEAD], places[0], atol=2.5)
    np.testing.assert_allclose(pose.joints_px[WAIST], places[1], atol=2.5)
    np.testing.assert_allclose(pose.feet_px, places[2], atol=2.5)
    np.testing.assert_allclose(pose.joints_px[NECK], 0.5 * (places[0] + places[1]), atol=2.5)
    assert pose.presence == 1.0 and pose.confidence.min() > 0.2
    # Known from before which way up it is, one look less finds the same.
    again = finder.find(picture, region, expected=pose)
    np.testing.assert_allclose(again.joints_px, pose.joints_px, atol=2.5)


def test_the_crop_is_upright_and_its_map_leads_back():
    picture = np.zeros((200, 300, 3), np.uint8)
    picture[62, 170] = 255
    crop, back = upright_crop(picture, (150.0, 80.0), (1.0, -1.0), 64.0, 64)
    row, column = np.unravel_index(int(crop[..., 0].argmax()), (64, 64))
    np.testing.assert_allclose(back @ [column, row, 1.0], [170.0, 62.0], atol=1.0)
    # Up in the picture is up and right here: what lies that way from the middle is above it.
    assert row < 10
    np.testing.assert_allclose(back @ [31.5, 31.5, 1.0], [150.0, 80.0], atol=1e-9)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (('"colours.onnx"', '"absent.onnx"'), "does not exist"),
        (('"maps"', '"map"'), r"no output 'map', only \['maps'\]"),
        (("[[0], ", "["), "joints"),
        (("[[0], ", "[[], "), "for head"),
        (("size_px", "size"), "did you mean 'size_px'"),
        (("[[0], ", "[[7], "), "joints name point 7, but .*colours.onnx' gives only 3, numbered from 0"),
        (('kind = "heatmaps"', "row = 5"), r"shape \(1, 3, 64, 64\), which are no rows of 5; .*kind = 'heatmaps'"),
        (('kind = "heatmaps"', "confidence = 3"), "confidence: got place 3, expected one of a row of 3"),
    ],
)
def test_a_wrong_description_is_refused(tmp_path: Path, change: tuple[str, str], said: str):
    file = _model(tmp_path)
    file.write_text(file.read_text().replace(*change))
    with pytest.raises(ConfigError, match=said):
        PoseNetwork(read_model(file))


def test_a_file_that_is_no_network_is_refused(tmp_path: Path):
    file = _model(tmp_path)
    (tmp_path / "colours.onnx").write_bytes(b"not a network")
    with pytest.raises(ConfigError, match="OpenCV cannot read"):
        PoseNetwork(read_model(file))
