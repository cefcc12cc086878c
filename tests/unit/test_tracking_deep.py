"""The trackers that are the user's networks: files read or refused, their own score as ours, what they cannot find."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.painted_scene import Scene, straight
from common.cli import main
from common.config import ConfigError
from common.processes import load_config
from common.tracking.base import TrackResult
from common.tracking.registry import make_tracker
from tests.unit.onnx_file import (
    write_channel_vit,
    write_colour_nano,
    write_colour_vit,
    write_constant_nano,
    write_constant_vit,
)

FILM = list(Scene(straight(0.0), seed=7).frames(0.3))


def followed(name: str, *settings: str) -> list[TrackResult]:
    """What a tracker says of a car that stands."""
    tracker = make_tracker(name, load_config(None, list(settings)), np.random.default_rng(1))
    _, frame, pose = FILM[0]
    tracker.init(frame, pose.box())
    return [tracker.update(picture, t_ns) for t_ns, picture, _ in FILM[1:]]


@pytest.mark.parametrize(("score", "state"), [(0.9, "tracking"), (0.1, "lost")])
def test_the_score_of_vit_is_ours_with_its_threshold_at_a_half(tmp_path: Path, score: float, state: str) -> None:
    write_constant_vit(tmp_path / "vit.onnx", score)
    results = followed("vit", f"vit.model={tmp_path / 'vit.onnx'}", "vit.threshold=0.3")
    assert {r.state for r in results} == {state}
    # OpenCV's window over the scores takes a little off the middle, and leaves a half of its cell of places.
    assert results[0].score == pytest.approx(score / (score + 0.3), abs=0.02)
    assert math.dist(results[0].center_px, (FILM[0][2].x_px, FILM[0][2].y_px)) < 20.0


@pytest.mark.parametrize(("logit", "state"), [(4.0, "tracking"), (-4.0, "lost")])
def test_the_score_of_nano_too(tmp_path: Path, logit: float, state: str) -> None:
    files = tmp_path / "backbone.onnx", tmp_path / "neckhead.onnx"
    write_constant_nano(*files, logit)
    results = followed("nano", f"nano.backbone={files[0]}", f"nano.neckhead={files[1]}")
    own = 0.455 + 0.545 / (1.0 + math.exp(-logit))  # a good part of OpenCV's score is how near the last place it is
    assert all(r.state == state for r in results)
    assert results[0].score == pytest.approx(own / (own + 0.6), abs=0.07)  # and less for another size
    assert all(np.isfinite((*r.center_px, *r.size_px)).all() for r in results)


def test_files_that_are_not_there_or_no_networks_are_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"vit\.model: got nothing, expected the path of an ONNX file"):
        followed("vit")
    with pytest.raises(ConfigError, match=r"nano\.backbone: .*none\.onnx' does not exist"):
        followed("nano", f"nano.backbone={tmp_path / 'none.onnx'}")
    broken = tmp_path / "broken.onnx"
    broken.write_bytes(b"not a network")
    with pytest.raises(ConfigError, match=r"vit\.model: OpenCV cannot read it as ONNX"):
        followed("vit", f"vit.model={broken}")
    write_constant_vit(tmp_path / "vit.onnx", 0.9)
    with pytest.raises(ValueError, match="nano: its networks do not fit OpenCV's tracker"):
        followed("nano", f"nano.backbone={tmp_path / 'vit.onnx'}", f"nano.neckhead={tmp_path / 'vit.onnx'}")


SIDE = 40
"""Of the square that is followed, px."""
HIDDEN = range(12, 16)


def place(number: int) -> tuple[float, float]:
    """The square's upper left corner, px."""
    return 80.0 + 5.0 * number, 80.0 + round(20.0 * math.sin(number / 4.0))


def write_film(path: Path, colour: tuple[int, int, int]) -> None:
    """A square that winds across blotched ground, away for four pictures; another one stands about."""
    noise = np.random.default_rng(2).integers(40, 200, (240, 320, 3)).astype(np.uint8)
    ground = cv2.GaussianBlur(noise, (0, 0), 3)
    cv2.rectangle(ground, (40, 150), (79, 189), (90, 90, 90), -1)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 20.0, (320, 240))
    for number in range(26):
        frame = ground.copy()
        x, y = (round(side) for side in place(number))
        if number not in HIDDEN:
            cv2.rectangle(frame, (x, y), (x + SIDE - 1, y + SIDE - 1), colour, -1)
        writer.write(frame)
    writer.release()


@pytest.mark.parametrize("colour", [(0, 200, 0), (30, 30, 210)], ids=["green", "red"])
@pytest.mark.parametrize("name", ["vit", "nano"])
def test_networks_that_compare_follow_a_colour_through_the_command(
    tmp_path: Path, name: str, colour: tuple[int, int, int]
) -> None:
    write_film(tmp_path / "film.avi", colour)
    write_colour_vit(tmp_path / "vit.onnx")
    write_colour_nano(tmp_path / "backbone.onnx", tmp_path / "neckhead.onnx")
    files = {"vit": ("model=vit",), "nano": ("backbone=backbone", "neckhead=neckhead")}[name]
    options = [f"{name}.{key}={tmp_path / value}.onnx" for key, value in (file.split("=") for file in files)]
    x, y = place(0)
    arguments = ["track", str(tmp_path / "film.avi"), "--tracker", name, "--init", f"{x},{y},{SIDE},{SIDE}"]
    arguments += ["--out", str(tmp_path / "track.csv"), *(part for option in options for part in ("--set", option))]
    assert main(arguments) == 0
    with (tmp_path / "track.csv").open(newline="") as file:
        rows = {int(row["frame"]): row for row in csv.DictReader(file)}
    assert {rows[k]["state"] for k in HIDDEN} == {"lost"}
    offsets = []
    for number in (k for k in range(1, 26) if k not in HIDDEN):
        row, (x, y) = rows[number], place(number)
        assert row["state"] == ("reacquired" if number == HIDDEN.stop else "tracking"), number
        middle = float(row["x"]) + float(row["w"]) / 2, float(row["y"]) + float(row["h"]) / 2
        offsets.append(math.dist(middle, (x + SIDE / 2, y + SIDE / 2)))
        assert 30.0 < float(row["w"]) < 44.0
    assert np.mean(offsets) < 8.0
    assert max(offsets) < 15.0, "a cell of its places is 10 px wide, and as high"


@pytest.mark.parametrize(("channel", "white"), [(0, 2.249), (1, 2.429), (2, 2.640)])
def test_vit_is_given_what_its_mean_and_deviation_say(tmp_path: Path, channel: int, white: float) -> None:
    """OpenCV divides one by three numbers as if they were a quaternion: two of the colours would be negative."""
    write_channel_vit(tmp_path / "vit.onnx", channel)
    tracker = make_tracker("vit", load_config(None, [f"vit.model={tmp_path / 'vit.onnx'}"]), np.random.default_rng(1))
    picture = np.full((240, 320, 3), 255, np.uint8)
    tracker.init(picture, (140.0, 100.0, 40.0, 40.0))
    score = tracker.update(picture, 1).score
    window = math.sin(math.pi * 8 / 17) ** 4  # what OpenCV's window over the places leaves of the middle
    assert 0.2 * score / (1.0 - score) == pytest.approx(white * window, rel=0.01)
