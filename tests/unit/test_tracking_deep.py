"""The trackers that are the user's networks: files read or refused, their own score as ours, what they cannot find."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks.painted_scene import Scene, straight
from common.config import ConfigError
from common.processes import load_config
from common.tracking.base import TrackResult
from common.tracking.registry import make_tracker
from tests.unit.onnx_file import write_constant_nano, write_constant_vit

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
