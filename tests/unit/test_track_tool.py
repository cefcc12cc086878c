"""`outrider track`: columns, states, boxes, both ways to begin, bad input."""

from __future__ import annotations

import csv
import math
import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.painted_scene import Pose, Scene, car_picture, straight
from common.cli import main
from common.track_tool import upright_box
from common.tracking.base import TrackResult


def _written(folder: Path, scene: Scene, duration_s: float) -> list[Pose]:
    folder.mkdir(exist_ok=True)
    poses = []
    for index, (_, frame, pose) in enumerate(scene.frames(duration_s)):
        cv2.imwrite(str(folder / f"{index}.bmp"), frame)  # natural order: 2 before 10
        poses.append(pose)
    return poses


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Pose]]:
    folder = tmp_path_factory.mktemp("film")
    return folder, _written(folder, Scene(straight(150.0), seed=2), 1.3)


def _track(*arguments: object) -> int:
    return main(["track", *map(str, arguments)])


def _lines(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def _centre(row: dict[str, str]) -> tuple[float, float]:
    return float(row["x"]) + float(row["w"]) / 2, float(row["y"]) + float(row["h"]) / 2


def test_box_to_csv(film: tuple[Path, list[Pose]], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, poses = film
    out = tmp_path / "track.csv"
    assert _track(folder, "--init", "32,216,96,48", "--out", out, "--rate", 20) == 0
    assert out.read_text().splitlines()[0] == "frame,x,y,w,h,angle_deg,score,state"
    rows = _lines(out)
    assert [int(r["frame"]) for r in rows] == list(range(26))
    assert {r["state"] for r in rows} == {"tracking"}
    for row, pose in zip(rows, poses, strict=True):
        assert math.dist(_centre(row), (pose.x_px, pose.y_px)) < 15
        assert 0.5 < float(row["score"]) <= 1.0
        assert abs(float(row["angle_deg"])) < 15
    assert "26 pictures: target seen in 26" in capsys.readouterr().err


def test_same_seed_same_file(film: tuple[Path, list[Pose]], tmp_path: Path) -> None:
    texts = []
    for name, seed in (("a", 4), ("b", 4), ("c", 5)):
        _track(film[0], "--tracker", "pursuit", "--init", "32,216,96,48", "--out", tmp_path / name, "--seed", seed)
        texts.append((tmp_path / name).read_text())
    assert texts[0] == texts[1] != texts[2]


def test_picture_of_the_target_instead_of_a_box(film: tuple[Path, list[Pose]], tmp_path: Path) -> None:
    folder, poses = film
    model, out = tmp_path / "car.png", tmp_path / "track.csv"
    cv2.imwrite(str(model), car_picture())
    assert _track(folder, "--model", model, "--out", out) == 0
    rows = _lines(out)
    assert [r["state"] for r in rows] == ["tracking"] * 26
    assert math.dist(_centre(rows[-1]), (poses[-1].x_px, poses[-1].y_px)) < 15


def test_later_beginning_loss_and_return(tmp_path: Path) -> None:
    """The box is given in the fourth picture; the car is gone for a second, a broken file among the pictures."""
    scene = Scene(lambda t_s: Pose(300.0, 240.0) if t_s < 1.0 or t_s >= 2.0 else Pose(-300.0, 240.0), seed=1)
    _written(tmp_path / "film", scene, 3.0)
    (tmp_path / "film" / "12.bmp").write_bytes(b"no picture")
    out, video = tmp_path / "track.csv", tmp_path / "track.avi"
    code = _track(
        tmp_path / "film", "--init", "252,216,96,48", "--init-frame", 3, "--out", out, "--video", video, "--rate", 20
    )
    assert code == 0
    rows = _lines(out)
    assert [r["state"] for r in rows[:5]] == ["lost", "lost", "lost", "tracking", "tracking"]
    assert [rows[12]["state"], rows[13]["state"], rows[14]["state"]] == ["lost", "reacquired", "tracking"]
    gone = rows[22:40]
    assert {r["state"] for r in gone} == {"lost"}
    assert all(r[c] == "" for r in gone for c in ("x", "y", "w", "h"))
    assert [r["state"] for r in rows[40:]].count("reacquired") == 1
    assert rows[-1]["state"] == "tracking"
    assert math.dist(_centre(rows[-1]), (300.0, 240.0)) < 10
    written = cv2.VideoCapture(str(video))
    assert written.read()[0]
    assert written.get(cv2.CAP_PROP_FRAME_COUNT) == 59, "every picture but the broken one"


def test_pictures_of_another_size_are_scaled_and_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _written(tmp_path / "film", Scene(straight(150.0), seed=2), 0.5)
    small = cv2.imread(str(tmp_path / "film" / "5.bmp"))
    assert small is not None
    for number in (5, 6):
        cv2.imwrite(str(tmp_path / "film" / f"{number}.bmp"), cv2.resize(small, (320, 240)))
    assert _track(tmp_path / "film", "--init", "32,216,96,48", "--out", tmp_path / "track.csv") == 0
    said = capsys.readouterr().err
    assert said.count("320x240 px, the first one 640x480: this and others like it are scaled to fit") == 1


def test_a_video_that_is_cut_short_is_tracked_to_there_and_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "film.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 20.0, (640, 480))
    for _, frame, _ in Scene(straight(150.0), seed=2).frames(1.0):
        writer.write(frame)
    writer.release()
    assert _track(path, "--init", "32,216,96,48", "--out", tmp_path / "whole.csv") == 0
    said = capsys.readouterr().err
    assert "missing" not in said and "cut short" not in said
    whole = _lines(tmp_path / "whole.csv")
    os.truncate(path, path.stat().st_size // 2)
    assert _track(path, "--init", "32,216,96,48", "--out", tmp_path / "cut.csv") == 0
    cut = _lines(tmp_path / "cut.csv")
    assert 0 < len(cut) < len(whole)
    assert cut[:-1] == whole[: len(cut) - 1], "the last one may be half a picture"
    said = capsys.readouterr().err
    assert f"the last {len(whole) - len(cut)} of {len(whole)} announced are missing" in said
    assert said.count(f"got {len(cut)} pictures, expected {len(whole)} as the file announces") == 1


@pytest.mark.parametrize(
    ("angle_deg", "expected"),
    [(0.0, (40.0, 80.0)), (90.0, (80.0, 40.0)), (45.0, (63.25, 63.25)), (180.0, (40.0, 80.0))],
)
def test_upright_box_encloses_the_ellipse(angle_deg: float, expected: tuple[float, float]) -> None:
    result = TrackResult((100.0, 50.0), (40.0, 80.0), math.radians(angle_deg), 0.9, 0.5, "tracking", 0.0)
    x, y, width, height = upright_box(result)
    assert (width, height) == pytest.approx(expected, abs=0.01)
    assert (x + width / 2, y + height / 2) == pytest.approx((100.0, 50.0))


def test_upright_box_is_of_plain_numbers_whatever_the_tracker_computes_with() -> None:
    centre, size = np.array([50.0, 40.0]), np.array([20.0, 10.0])
    result = TrackResult((centre[0], centre[1]), (size[0], size[1]), np.float64(0.1), 1.0, 0.5, "tracking", 0.0)
    assert [type(value) for value in upright_box(result)] == [float] * 4


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--init", "1,2,3"), "--init: got '1,2,3', expected x,y,w,h in px"),
        (("--init", "10,10,0,40"), "--init: box: got 0x40 px"),
        (("--init", "900,10,50,50"), "expected most of it in the 640x480 px picture"),
        (("--init", "nan,10,50,50"), "expected finite"),
        (("--init", "32,216,96,48", "--init-frame", "99"), "--init-frame: got 99, expected at most 25"),
        (("--init", "32,216,96,48", "--init-frame", "-3"), "--init-frame: got -3, expected the number of a picture"),
        (("--init", "32,216,96,48", "--rate", "0"), "--rate: got 0, expected pictures a second, above 0"),
        (("--init", "32,216,96,48", "--rate", "nan"), "--rate: got nan, expected pictures a second, above 0"),
        (("--init", "", "--tracker", "pursuit"), "--init: got '', expected x,y,w,h in px"),
        (
            ("--init", "32,216,96,48", "--tracker", "persuit"),
            "--tracker: got 'persuit', expected one of: pursuit, dsst",
        ),
        (("--init", "32,216,96,48", "--out", "/no/such/folder/a.csv"), "--out: cannot write"),
        (("--init", "32,216,96,48", "--video", "/no/such/folder/a.mp4"), "--video: cannot write"),
        (("--model", "nothing.png"), "--model: got 'nothing.png', expected an image file"),
    ],
)
def test_bad_arguments_get_one_line(
    film: tuple[Path, list[Pose]], arguments: tuple[str, ...], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _track(film[0], *arguments) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert words in said[-1]
    assert said[-1].startswith("outrider: ")


@pytest.mark.parametrize("more", [(), ("--all",)])
def test_a_refused_box_leaves_an_older_file_as_it_was(
    film: tuple[Path, list[Pose]], tmp_path: Path, more: tuple[str, ...]
) -> None:
    (tmp_path / "track.csv").write_text("of another run\n")
    assert _track(film[0], "--init", "900,10,50,50", "--out", tmp_path / "track.csv", *more) == 2
    assert (tmp_path / "track.csv").read_text() == "of another run\n"


@pytest.mark.parametrize(
    ("picture", "words"),
    [(np.full((40, 80, 3), 90, np.uint8), "without texture"), (car_picture()[:8, :8], "smaller than a kernel")],
)
def test_bad_picture_of_the_target_gets_one_line(
    film: tuple[Path, list[Pose]],
    tmp_path: Path,
    picture: np.ndarray,
    words: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    cv2.imwrite(str(tmp_path / "model.png"), picture)
    assert _track(film[0], "--model", tmp_path / "model.png") == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    ("content", "words"), [(None, "which does not exist"), (b"nonsense", "cannot be decoded"), ("folder", "no image")]
)
def test_unreadable_source_gets_one_line(
    tmp_path: Path, content: bytes | str | None, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "film.avi"
    if content == "folder":
        path.mkdir()
    elif isinstance(content, bytes):
        path.write_bytes(content)
    assert _track(path, "--init", "1,1,20,20") == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize("source", ["/dev/video0", "v4l2:0", "rtsp://127.0.0.1:1/down"])
def test_a_live_camera_is_refused_in_one_line(source: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert _track(source, "--init", "1,1,20,20") == 2
    said = capsys.readouterr().err.strip()
    assert "a live camera, expected a video file or an image folder; record it first" in said and "\n" not in said


def test_init_and_model_exclude_each_other(tmp_path: Path) -> None:
    with pytest.raises(SystemExit):
        _track(tmp_path, "--init", "1,1,20,20", "--model", "a.png")
    with pytest.raises(SystemExit):
        _track(tmp_path)


def test_linear_algebra_has_one_thread_unless_the_user_says_otherwise() -> None:
    """A pool that waits for its slowest thread makes a tracker ten times slower on a busy machine."""
    script = "import common, os, numpy as np; a = np.ones((700, 700)); a @ a; print(len(os.listdir('/proc/self/task')))"
    for asked, threads in ((None, "1"), ("2", "2")):
        named = {} if asked is None else {"OPENBLAS_NUM_THREADS": asked, "OMP_NUM_THREADS": asked}
        rest = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
        done = subprocess.run(
            [sys.executable, "-c", script], env=rest | named, capture_output=True, text=True, check=True
        )
        if asked is None or (os.cpu_count() or 1) >= int(asked):
            assert done.stdout.strip() == threads
