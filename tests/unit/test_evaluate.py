"""`outrider evaluate`: the three formats, the measures on boxes worked out by hand, bad files, the plot."""

from __future__ import annotations

import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from common.cli import main
from common.config import ConfigError
from common.evaluation import distances_px, evaluate, jaccard, read_track
from common.ground_truth import read_ground_truth

TRACK = """frame,x,y,w,h,angle_deg,score,state
0,10.0,10.0,20.0,20.0,0.0,0.9,tracking
1,20.0,10.0,20.0,20.0,0.0,0.9,tracking
2,,,,,,0.1,lost
3,10.0,10.0,20.0,20.0,0.0,0.9,reacquired
"""
OTB = "10,10,20,20\n10\t10\t20\t20\n10 10 20 20\nNaN,NaN,NaN,NaN\n"


def _written(path: Path, text: str) -> str:
    path.write_text(text)
    return str(path)


def test_overlap_and_both_distances_by_hand() -> None:
    assert jaccard((0, 0, 10, 10), (5, 0, 10, 10)) == pytest.approx(1 / 3)
    assert jaccard((0, 0, 10, 10), (10, 0, 10, 10)) == 0.0
    d4, centre = distances_px((0, 0, 10, 10), (3, 4, 10, 10))
    assert (d4, centre) == (5.0, 5.0)
    d4, centre = distances_px((0, 0, 10, 10), (-1.5, -2.0, 13, 14))
    assert (d4, centre) == (5.0, 0.0), "size alone"


def test_formats(tmp_path: Path) -> None:
    otb = read_ground_truth(_written(tmp_path / "otb", OTB), "otb")
    assert otb == {0: (10, 10, 20, 20), 1: (10, 10, 20, 20), 2: (10, 10, 20, 20), 3: None}
    tld = read_ground_truth(_written(tmp_path / "tld", "10,10,30,40\nNaN,NaN,NaN,NaN\n"), "tld")
    assert tld == {0: (10, 10, 20, 30), 1: None}
    text = "3,7,1,2,30,40,1,-1,-1,-1\n5,7,2,2,30,40,1,-1,-1,-1\n4,9,0,0,5,5,1,-1,-1,-1\n"
    mot = read_ground_truth(_written(tmp_path / "mot", text), "mot", 7)
    assert mot == {2: (1, 2, 30, 40), 3: None, 4: (2, 2, 30, 40)}
    with pytest.raises(ConfigError, match="name one with --target"):
        read_ground_truth(str(tmp_path / "mot"), "mot")


def test_figures(tmp_path: Path) -> None:
    truth = read_ground_truth(_written(tmp_path / "otb", OTB), "otb")
    figures = evaluate(read_track(_written(tmp_path / "track.csv", TRACK))[""], truth).figures()
    assert figures == {
        "visible": 3.0,
        "reported": 2.0,
        "mean_jaccard": pytest.approx((1 + 1 / 3 + 0) / 3),
        "d4_px": 5.0,
        "centre_px": 5.0,
        "success_d4": pytest.approx(1 / 3),
        "success_centre": pytest.approx(1 / 3),
        "absent": 1.0,
        "reported_while_absent": 1.0,
    }
    nothing = evaluate({}, truth).figures()
    assert nothing["mean_jaccard"] == 0.0
    assert math.isnan(nothing["d4_px"])


def test_command_prints_and_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = TRACK.splitlines()
    both = [f"tracker,{lines[0]}", *(f"{name},{line}" for line in lines[1:] for name in ("dsst", "hab-df"))]
    track = _written(tmp_path / "track.csv", "\n".join(both) + "\n")
    truth, plot = _written(tmp_path / "otb", OTB), tmp_path / "plot.png"
    assert main(["evaluate", track, truth, "--format", "otb", "--json", "--plot", str(plot)]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert list(figures) == ["dsst", "hab-df"]
    assert figures["hab-df"]["absent"] == 1.0
    assert np.asarray(cv2.imread(str(plot))).std() > 5
    assert main(["evaluate", track, truth, "--skip", "1"]) == 0
    assert "mean_jaccard" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("track", "truth", "words"),
    [
        (TRACK, "a,b,c,d\n", "otb:1: got 'a,b,c,d', expected at least 4 numbers"),
        (TRACK, "", "is empty"),
        (TRACK, "NaN,NaN,NaN,NaN\n", "visible in no picture"),
        ("x,y\n1,2\n", OTB, "is not what `outrider track --out` writes"),
        ("", OTB, "has no line"),
    ],
)
def test_bad_files_get_one_line(
    tmp_path: Path, track: str, truth: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["evaluate", _written(tmp_path / "t.csv", track), _written(tmp_path / "otb", truth)]) == 2
    assert words in capsys.readouterr().err
