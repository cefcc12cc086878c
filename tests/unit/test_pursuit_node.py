"""The pursuit node with scripted pictures and states."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.painted_scene import Scene, car_picture, straight
from common.config import Config, ConfigError
from common.geometry.config import CameraConfig
from common.messages import Command, Image, Request, Track
from common.node import Output, ScriptedRun
from ground.pursuit.node import PursuitNode
from tests.flying import flying

SECTIONS = {
    "pursuit": "ground.pursuit.config:PursuitConfig",
    "tracker": "common.tracking.config:ParticleFilterConfig",
}
MS = 1_000_000


def _jpeg(frame: np.ndarray) -> Image:
    data = cv2.imencode(".jpg", frame)[1].tobytes()
    return Image(camera="down", width=frame.shape[1], height=frame.shape[0], encoding="jpeg", data=data)


class Scripted:
    """A node, its pictures, and the time."""

    def __init__(self, with_state: bool = True, **pursuit: object):
        self.run = ScriptedRun(PursuitNode(Config({"pursuit": pursuit}, SECTIONS), "pursuit"))
        self.frames = iter(Scene(straight(60.0, y_px=180.0, start_px=300.0), seed=2).frames(5.0))
        self.with_state = with_state
        self.now_ns = 10_000 * MS
        self.box = (0.0, 0.0, 0.0, 0.0)
        self.run.feed("camera/down/info", CameraConfig().camera().info("down"), self.now_ns)

    def picture(self, data: bytes | None = None) -> dict[str, Output]:
        """Outputs of the next picture, by topic."""
        self.now_ns += 50 * MS
        _, frame, pose = next(self.frames)
        self.box = pose.box()
        if self.with_state:
            self.run.feed("helm/state", flying(), self.now_ns - 5 * MS)
        image = _jpeg(frame)
        if data is not None:
            image = Image(camera="down", width=640, height=480, encoding="jpeg", data=data)
        self.run.feed("camera/down/jpeg", image, self.now_ns)
        return {o.topic: o for o in self.run.step(self.now_ns + 2 * MS)}

    def do(self, name: str, command: Command) -> str:
        """Outcome of a command, with its reason."""
        call, _ = self.run.call(name, command, self.now_ns + 3 * MS)
        assert call.answer is not None
        return f"{call.answer.outcome}: {call.answer.reason}"


def _track(outputs: dict[str, Output]) -> Track:
    message = outputs["pursuit/track"].message
    assert isinstance(message, Track)
    return message


def test_idle_until_a_target_is_chosen() -> None:
    scripted = Scripted()
    outputs = scripted.picture()
    assert _track(outputs).state == "idle"
    assert "helm/request/pursuit" not in outputs


def test_chosen_target_is_tracked_and_asked_for() -> None:
    scripted = Scripted()
    scripted.picture()
    assert scripted.do("pursuit/do/select", Command(box_px=scripted.box)) == "done: "
    for _ in range(15):
        outputs = scripted.picture()
    track, request = _track(outputs), outputs["helm/request/pursuit"]
    assert track.state == "tracking"
    assert abs(track.x_px - (scripted.box[0] + 48)) < 6
    assert track.error[0] > 0.0  # above the picture's middle is ahead
    assert isinstance(request.message, Request)
    assert request.message.vector[0] > 0.1
    assert request.message.vector[1] > 0.1
    assert request.capture_ns == scripted.now_ns


def test_without_vehicle_state_it_tracks_and_asks_for_nothing() -> None:
    scripted = Scripted(with_state=False)
    scripted.picture()
    scripted.do("pursuit/do/select", Command(box_px=scripted.box))
    outputs = scripted.picture()
    assert _track(outputs).state == "tracking"
    assert _track(outputs).reason.startswith("no vehicle state")
    assert "helm/request/pursuit" not in outputs


def test_corrupt_picture_is_counted_and_skipped() -> None:
    scripted = Scripted()
    scripted.picture()
    scripted.do("pursuit/do/select", Command(box_px=scripted.box))
    assert scripted.picture(b"\xff\xd8 broken \xff\xd9") == {}
    assert scripted.run.node.metrics()["corrupt_pictures"] == 1
    assert _track(scripted.picture()).state == "tracking"


def test_stop_forgets_the_target() -> None:
    scripted = Scripted()
    scripted.picture()
    scripted.do("pursuit/do/select", Command(box_px=scripted.box))
    assert scripted.do("pursuit/do/stop", Command()) == "done: "
    assert _track(scripted.picture()).state == "idle"


def test_bad_boxes_are_refused_with_the_reason() -> None:
    scripted = Scripted()
    assert "no picture has come yet" in scripted.do("pursuit/do/select", Command(box_px=(1.0, 1.0, 20.0, 20.0)))
    scripted.picture()
    assert "got no box" in scripted.do("pursuit/do/select", Command())
    assert scripted.do("pursuit/do/select", Command(box_px=(900.0, 10.0, 50.0, 50.0))).startswith(
        "refused: select: box"
    )


def test_picture_older_than_the_last_is_skipped_and_the_target_stays() -> None:
    scripted = Scripted()
    scripted.picture()
    scripted.do("pursuit/do/select", Command(box_px=scripted.box))
    for _ in range(3):
        scripted.picture()
    scripted.now_ns -= 150 * MS
    assert scripted.picture() == {}
    assert scripted.run.node.metrics()["late_pictures"] == 1
    scripted.now_ns += 150 * MS
    assert _track(scripted.picture()).state == "tracking"


def test_box_on_a_picture_that_is_not_kept_is_refused() -> None:
    scripted = Scripted()
    scripted.picture()
    command = Command(box_px=scripted.box, capture_ns=scripted.now_ns - 9_000 * MS)
    assert "9.0 s from the newest one, which is not kept" in scripted.do("pursuit/do/select", command)
    assert _track(scripted.picture()).state == "idle"


def test_repeated_picture_says_so_and_is_coasted_through() -> None:
    scripted = Scripted()
    scripted.picture()
    scripted.do("pursuit/do/select", Command(box_px=scripted.box))
    scripted.picture()
    frozen = _jpeg(next(scripted.frames)[1]).data
    scripted.picture(frozen)
    outputs = scripted.picture(frozen)
    assert "repeats the one before" in _track(outputs).reason
    assert "helm/request/pursuit" in outputs


def test_unknown_tracker_is_refused_at_the_start() -> None:
    with pytest.raises(ConfigError, match="did you mean 'particle_filter'"):
        PursuitNode(Config({"pursuit": {"tracker": "particel_filter"}}, SECTIONS), "pursuit")


@pytest.fixture
def model_file(tmp_path: Path) -> str:
    path = tmp_path / "car.png"
    cv2.imwrite(str(path), car_picture())
    return str(path)


def test_target_is_found_by_its_picture_without_a_box(model_file: str) -> None:
    scripted = Scripted(model=model_file)
    scripted.picture()
    assert scripted.do("pursuit/do/find", Command()).startswith("done: searching")
    assert _track(scripted.picture()).reason.startswith("found the target")
    for _ in range(10):
        outputs = scripted.picture()
    assert _track(outputs).state == "tracking"
    assert abs(_track(outputs).x_px - (scripted.box[0] + 48)) < 10
    assert "helm/request/pursuit" in outputs
    assert scripted.run.node.metrics()["reinitialisations"] == 1


def test_search_goes_on_until_the_target_is_there(model_file: str) -> None:
    scripted = Scripted(model=model_file)
    scripted.picture()
    scripted.do("pursuit/do/find", Command())
    empty = _jpeg(np.full((480, 640, 3), (95, 120, 110), np.uint8)).data
    for _ in range(3):
        track = _track(scripted.picture(empty))
        assert track.state == "idle"
        assert track.reason.startswith("searching")
    scripted.picture()
    assert _track(scripted.picture()).state == "tracking"


def test_find_without_a_picture_of_the_target_is_refused() -> None:
    scripted = Scripted()
    scripted.picture()
    assert "refused: find: got no picture of the target" in scripted.do("pursuit/do/find", Command())


def test_operator_has_the_whole_picture_searched() -> None:
    scripted = Scripted()
    assert scripted.do("pursuit/do/reinitialise", Command()).startswith("refused: reinitialise: got no target")
    scripted.picture()
    x_px = scripted.box[0] + 48
    scripted.do("pursuit/do/select", Command(box_px=scripted.box))
    scripted.picture()
    assert scripted.do("pursuit/do/reinitialise", Command()) == "done: "
    track = _track(scripted.picture())
    assert track.state == "tracking"
    assert abs(track.x_px - x_px) < 12
    assert scripted.run.node.metrics()["reinitialisations"] == 1
    scripted.picture(_jpeg(np.full((480, 640, 3), (95, 120, 110), np.uint8)).data)
    assert scripted.do("pursuit/do/reinitialise", Command()).startswith("failed: reinitialise: nothing in the picture")


@pytest.mark.parametrize(
    ("picture", "words"),
    [
        (None, "expected an image file"),
        (np.full((40, 80, 3), 90, np.uint8), "without texture"),
        (car_picture()[:8, :8], "smaller than a kernel"),
    ],
)
def test_bad_picture_of_the_target_is_refused_at_the_start(
    tmp_path: Path, picture: np.ndarray | None, words: str
) -> None:
    path = tmp_path / "model.png"
    if picture is not None:
        cv2.imwrite(str(path), picture)
    with pytest.raises(ConfigError, match=words):
        Scripted(model=str(path))
