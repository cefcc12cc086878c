"""`outrider people`: recordings in TUM's layout, videos without depth, CAVIAR's annotations, the CSV."""

from __future__ import annotations

import csv
from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.people_scene import DepthScene, barrel, person
from common.cli_parser import make_parser
from common.config import ConfigError
from common.people_command import run as run_command
from common.processes import load_config
from onboard.people import recorded
from onboard.people.caviar import read
from onboard.people.tum import TumSequence, is_tum
from tests.unit.onnx_file import write_red_detector
from tests.unit.people_rig import DOWN, Knower, paint

INTRINSICS = "365,365,255.5,211.5"
PICTURES = 5
SCENE = DepthScene((person("lying", -1.2, 0.5, 0.4), barrel(0.6, 1.2)), 4.0, camera=DOWN)


@pytest.fixture(scope="module")
def painted() -> tuple[np.ndarray, np.ndarray]:
    return paint(SCENE)


@pytest.fixture
def folder(tmp_path: Path, painted: tuple[np.ndarray, np.ndarray]) -> Path:
    """Five pictures, 10 a second; depth 8 ms later, but for the last one, which has none of its time."""
    (tmp_path / "rgb").mkdir()
    (tmp_path / "depth").mkdir()
    colours, depths = ["# time file"], ["# time file"]
    for number in range(PICTURES):
        t_s = 1311868164.25 + 0.1 * number
        cv2.imwrite(str(tmp_path / f"rgb/{number}.png"), painted[0])
        colours.append(f"{t_s:.6f} rgb/{number}.png")
        if number < PICTURES - 1:
            scaled = np.round(painted[1] * 5000.0).astype(np.uint16)
            cv2.imwrite(str(tmp_path / f"depth/{number}.png"), scaled)
            depths.append(f"{t_s + 0.008:.6f} depth/{number}.png")
    (tmp_path / "rgb.txt").write_text("\n".join(colours))
    (tmp_path / "depth.txt").write_text("\n".join(depths))
    return tmp_path


def people(*words: str, sets: tuple[str, ...] = (), monkeypatch: pytest.MonkeyPatch) -> int:
    """Run the command line, with a network that knows whom it sees."""
    args = make_parser().parse_args(["people", *words])
    monkeypatch.setattr(recorded, "pose_network", lambda model: Knower().network)
    monkeypatch.setattr(recorded, "fetched_detector", lambda: None)
    return run_command(args, load_config(None, sets))


def rows(path: Path) -> list[list[float]]:
    with path.open() as file:
        return [[float(cell) for cell in row] for row in csv.reader(file)]


def test_a_recording_becomes_the_challenges_csv_and_a_video(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    out, film = tmp_path / "tracks.csv", tmp_path / "out.mp4"
    words = (str(folder), "--intrinsics", INTRINSICS, "--out", str(out), "--video", str(film))
    assert people(*words, monkeypatch=monkeypatch) == 0
    found = rows(out)
    assert [row[0] for row in found] == [1, 2, 3, 4], "from 1; the last picture has no depth of its time"
    assert {row[1] for row in found} == {1} and all(len(row) == 10 for row in found)
    for row in found:
        x, y, width, height = row[2:6]
        assert (painted_red := _red_box())[0] == pytest.approx(x, abs=8) and painted_red[1] == pytest.approx(y, abs=8)
        assert width == pytest.approx(painted_red[2], abs=14) and height == pytest.approx(painted_red[3], abs=14)
        assert row[7] == pytest.approx(-1.15, abs=0.25) and row[8] == pytest.approx(-0.5, abs=0.25)
        assert 3.5 < row[9] < 4.0, "metres, not millimetres or units"
    said = capsys.readouterr().err
    assert "5 pictures: 1 people in 4 boxes" in said and "92 ms apart, expected 20 ms or less" in said
    video = cv2.VideoCapture(str(film))
    assert int(video.get(cv2.CAP_PROP_FRAME_COUNT)) == PICTURES
    assert video.get(cv2.CAP_PROP_FPS) == pytest.approx(10.0, abs=0.1)


def _red_box() -> tuple[int, int, int, int]:
    colour, _ = paint(SCENE)
    ys, xs = np.nonzero(colour[..., 2] == 200)
    return int(xs.min()), int(ys.min()), int(np.ptp(xs)) + 1, int(np.ptp(ys)) + 1


def test_with_the_cameras_poses_places_are_the_worlds(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """The camera looks straight down from 4 m, its top along x, 10 m along x and -3 m along y; z is up."""
    half = 0.5**0.5
    poses = [
        f"{1311868164.2 + 0.1 * k:.3f} {10 + 0.02 * (k - 0.5)} -3 4 {half} {-half} 0 0" for k in range(4)
    ]  # the fourth picture comes after the last of them
    (folder / "groundtruth.txt").write_text("\n".join(["# time x y z qx qy qz qw", *reversed(poses)]))
    out = tmp_path / "t.csv"
    assert people(str(folder), "--intrinsics", INTRINSICS, "--out", str(out), monkeypatch=monkeypatch) == 0
    found = rows(out)
    for row in found[:3]:
        moved_m = 0.02 * (row[0] - 1)
        assert row[7] == pytest.approx(10.5 + moved_m, abs=0.25) and row[8] == pytest.approx(-3.0 + 1.15, abs=0.25)
        assert 0.0 < row[9] < 0.5, "just above the ground"
    assert found[3][7:] == [-1, -1, -1], "where the camera's pose is not known, there is no place in the world"
    said = capsys.readouterr().err
    assert "in the world of the recording's groundtruth.txt" in said and "no pose of the vehicle" in said


def test_annotations_are_compared(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys):
    x, y, width, height = _red_box()
    box = f'<box xc="{x + width / 2}" yc="{y + height / 2}" w="{width}" h="{height}"/>'
    frames = "".join(
        f'<frame number="{n}"><objectlist><object id="7">{box}</object></objectlist></frame>' for n in range(PICTURES)
    )
    truth = tmp_path / "truth.xml"
    truth.write_text(f"<dataset>{frames}</dataset>")
    assert read(truth)[0] == {7: (x, y, width, height)}
    words = (str(folder), "--intrinsics", INTRINSICS, "--out", str(tmp_path / "t.csv"), "--annotations", str(truth))
    assert people(*words, monkeypatch=monkeypatch) == 0
    lines = [line.split() for line in capsys.readouterr().err.splitlines()]
    said = {words[0]: words[1] for words in lines if len(words) == 2}
    assert (float(said["objects"]), float(said["misses"])) == (5.0, 1.0)
    assert float(said["false_positives"]) == float(said["switches"]) == 0.0
    assert float(said["mota"]) == pytest.approx(0.8)


def test_without_depth_the_detector_is_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    colour = np.full((424, 512, 3), 70, np.uint8)
    colour[192:320, 256:320] = (40, 40, 200)
    for number in range(4):
        cv2.imwrite(str(pictures / f"{number}.png"), colour)
    network, out = tmp_path / "red.onnx", tmp_path / "t.csv"
    write_red_detector(network, 128, 16, (16.0, 30.0))
    sets = (f"people.detector.file={network}", "people.detector.decoder=yolo", "people.detector.size_px=128")
    assert people(str(pictures), "--out", str(out), sets=sets, monkeypatch=monkeypatch) == 0
    found = rows(out)
    assert {row[0] for row in found} == {1, 2, 3, 4} and all(row[7:] == [-1, -1, -1] for row in found)
    assert "in 4 pictures: the source has no depth: places are not known" in capsys.readouterr().err


def test_what_cannot_be_used_is_named(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def refused(*words: str, match: str) -> None:
        with pytest.raises(ConfigError, match=match):
            people(*words, monkeypatch=monkeypatch)

    refused(str(folder), match="depth needs --intrinsics FX,FY,CX,CY, and without a person detector")
    refused(str(folder / "rgb"), match="the source has no depth, and without a person detector nobody")
    refused(str(folder), "--intrinsics", "1,2,3", match="--intrinsics: got '1,2,3', expected FX,FY,CX,CY")
    refused(str(folder), "--intrinsics", "0,1,1,1", match="expected focal lengths above 0")
    refused(str(folder), "--intrinsics", "365,365,960,540", match="principal point of 960,540, .* are 512x424 px")
    refused(str(folder), "--depth-scale", "0", match="--depth-scale: got 0, expected a number above 0")
    refused(str(folder), "--intrinsics", INTRINSICS, "--out", "/nowhere/t.csv", match="--out: cannot write")
    refused(str(tmp_path / "none"), match="does not exist")
    for name in (f"depth/{number}.png" for number in range(PICTURES - 1)):
        cv2.imwrite(str(folder / name), np.full((240, 640), 5000, np.uint16))
    refused(str(folder), "--intrinsics", INTRINSICS, match="depth of 640x240 px beside pictures of 512x424, expected")
    annotated = (str(folder), "--intrinsics", INTRINSICS, "--annotations")
    refused(*annotated, str(tmp_path / "none.xml"), match="--annotations: cannot read")
    broken = tmp_path / "broken.xml"
    for text, match in (
        ("<dataset><frame", "is no XML"),
        ("<html/>", "no <frame> in a <dataset>"),
        ('<dataset><frame number="x"/></dataset>', "number='x', expected a whole number"),
        (
            '<dataset><frame number="0"><objectlist><object id="1"/></objectlist></frame></dataset>',
            "frame 0: an <object> without a <box>",
        ),
    ):
        broken.write_text(text)
        refused(*annotated, str(broken), match=match)


def test_what_is_broken_or_of_another_size_is_said_and_the_rest_is_searched(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """The first picture and the third's depth are cut off; depth is half as wide and high as the pictures."""
    for number in range(PICTURES - 1):
        file = folder / f"depth/{number}.png"
        depth = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        assert depth is not None
        cv2.imwrite(str(file), depth[::2, ::2])
    for name in ("rgb/0.png", "depth/2.png"):
        (folder / name).write_bytes((folder / name).read_bytes()[:60])
    out, film = tmp_path / "t.csv", tmp_path / "t.avi"
    words = (str(folder), "--intrinsics", INTRINSICS, "--out", str(out), "--video", str(film))
    assert people(*words, monkeypatch=monkeypatch) == 0
    assert [row[0] for row in rows(out)] == [2, 4]
    said = capsys.readouterr().err
    assert "5 pictures: 1 people in 2 boxes; 1 not decodable" in said
    assert "in 1 pictures: its depth picture cannot be decoded" in said and "floor 4.0" in said
    assert cv2.VideoCapture(str(film)).get(cv2.CAP_PROP_FRAME_COUNT) == PICTURES, "the film keeps the recording's time"


def test_a_wrong_unit_shows_and_a_reason_is_told_once(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    words = (str(folder), "--intrinsics", INTRINSICS, "--out", str(tmp_path / "t.csv"))
    assert people(*words, "--depth-scale", "20000", monkeypatch=monkeypatch) == 0
    assert "floor 1.00 m from the camera, expected 2 to 12 m: is --depth-scale right?" in capsys.readouterr().err
    assert people(*words, "--depth-scale", "5e6", monkeypatch=monkeypatch) == 0
    said = capsys.readouterr().err
    assert "in 4 pictures: depth picture: 0 of 3392 sampled depths" in said and "0.004 m: is the unit right?" in said
    listed = (folder / "depth.txt").read_text().splitlines()[1:]
    late = [f"{float(time) + 9.0 + 0.01 * k} {name}" for k, (time, name) in enumerate(line.split() for line in listed)]
    (folder / "depth.txt").write_text("\n".join(late))
    assert people(*words, monkeypatch=monkeypatch) == 0
    said = capsys.readouterr().err
    assert said.count("ms apart") == 1 and "in 5 pictures: picture and depth are 9008 ms apart" in said


def test_lists_that_are_wrong_are_named(folder: Path):
    assert is_tum(str(folder)) and not is_tum(str(folder / "rgb"))
    (folder / "depth.txt").write_text("nan depth/0.png\n")
    with pytest.raises(ConfigError, match=r"depth.txt, line 1: got 'nan depth/0.png', expected `time file`"):
        TumSequence(folder, 5000.0)
    (folder / "depth.txt").write_text("1.0 depth/9.png\n")
    with pytest.raises(ConfigError, match=r"9.png is listed in .*, but 5 such files are not there"):
        TumSequence(folder, 5000.0)
    (folder / "depth.txt").unlink()
    assert not TumSequence(folder, 5000.0).with_depth
    (folder / "associations.txt").write_text("1.5 rgb/1.png 1.6 depth/1.png\n1.0 rgb/0.png 1.0 depth/0.png\n")
    assert TumSequence(folder, 5000.0).rate_hz == 2.0
    (folder / "associations.txt").write_text("1.0 rgb/0.png 1.0 rgb/0.png\n")
    with pytest.raises(ConfigError, match=r"0.png: got uint8 of shape .*, expected a 16-bit picture .* times 5000"):
        TumSequence(folder, 5000.0)
    (folder / "associations.txt").write_text("1.0 rgb/0.png 1.0 depth/0.png\n")
    truth = folder / "groundtruth.txt"
    for text, match in (
        ("1.0 0 0 1 0 0 0\n", "groundtruth.txt, line 1: got '1.0 0 0 1 0 0 0', expected `time x y z qx qy qz qw`"),
        ("# none\n", "groundtruth.txt holds no pose"),
        ("1.0 0 0 1 0 0 0 2\n", "time 1.000000: got a quaternion of norm 2.000, expected 1"),
    ):
        truth.write_text(text)
        with pytest.raises(ConfigError, match=match):
            TumSequence(folder, 5000.0)
    truth.unlink()
    (folder / "rgb.txt").write_text("# nothing\n")
    (folder / "associations.txt").unlink()
    with pytest.raises(ConfigError, match="lists no picture"):
        TumSequence(folder, 5000.0)
