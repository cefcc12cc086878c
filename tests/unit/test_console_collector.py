"""What the console keeps of the stream: how old a picture is, and what the vehicle did when it was taken."""

from __future__ import annotations

import pytest

from common.config import Config
from common.messages import Image, Track
from common.node import Inputs, Node, On, ScriptedRun
from ground.console.collector import Collector
from ground.console.snapshot import FOLLOWED, STATE, TRACK, Snapshot, picture_topic
from tests.flying import flying

PICTURE = picture_topic("down")
FRONT = picture_topic("front")
MS = 1_000_000
JPEG = b"\xff\xd8 pixels \xff\xd9"


class _Reader(Node):
    """Stands for the console's input side alone."""

    trigger = On((PICTURE,))

    def __init__(self) -> None:
        super().__init__(Config({}, {}), "reader")
        self.collector = Collector(("helm",), ("down", "front"))
        self.inputs = self.collector.inputs
        self.view: Snapshot | None = None

    def step(self, inputs: Inputs, t_ns: int) -> tuple[()]:
        self.collector.collect(inputs)
        self.view = self.collector.snapshot(inputs, t_ns, None)
        return ()


def _run() -> tuple[ScriptedRun, _Reader]:
    node = _Reader()
    return ScriptedRun(node), node


def _image() -> Image:
    return Image(camera="down", width=640, height=480, encoding="jpeg", data=JPEG)


def test_repeated_picture_grows_old() -> None:
    run, node = _run()
    run.feed(PICTURE, _image(), 1000 * MS, 1010 * MS)
    run.step(1020 * MS)
    assert node.view is not None
    assert node.view.picture_live
    for t_ms in range(1060, 2060, 50):  # a frozen camera sends the same picture again and again
        run.feed(PICTURE, _image(), 1000 * MS, t_ms * MS)
        run.step((t_ms + 1) * MS)
    assert node.view.picture_age_ms > 1000
    assert not node.view.picture_live
    assert not node.view.fresh(PICTURE)
    assert len(node.collector.pictures) == 1


def test_each_target_has_its_own_age_and_was_last_seen_when_it_was() -> None:
    run, node = _run()
    run.feed(TRACK, Track(state="tracking"), 1000 * MS, 1020 * MS)
    run.feed(FOLLOWED, Track(state="tracking"), 1100 * MS, 1140 * MS)
    run.step(1150 * MS)
    run.feed(FOLLOWED, Track(state="lost"), 1500 * MS, 1540 * MS)
    run.step(1550 * MS)
    view = node.view
    assert view is not None and view.followed is not None and view.followed.state == "lost"
    assert view.followed_capture_ns == 1500 * MS and view.track_capture_ns == 1000 * MS
    assert view.followed_ago_ms == 410.0 and view.tracked_ago_ms == 530.0
    assert 10.0 <= view.followed_age_ms <= 50.0


def test_picture_that_waited_on_the_link_is_known_to_be_old() -> None:
    run, node = _run()
    shift = 77_000_000 * MS  # the vehicle's clock is another machine's
    for t_ms in range(0, 4000, 20):
        run.feed(STATE, flying(), t_ms * MS + shift, (t_ms + 3) * MS)
        if t_ms >= 3000 and t_ms % 40 == 0:  # pictures arrive 3 s late, at a steady rate
            run.feed(PICTURE, _image(), (t_ms - 3000) * MS + shift, t_ms * MS)
        run.step((t_ms + 4) * MS)
    assert node.view is not None
    assert node.view.fresh(PICTURE)
    assert node.view.picture_age_ms == pytest.approx(3000, abs=50)
    assert not node.view.picture_live


def test_another_camera_begins_with_its_first_new_picture() -> None:
    run, node = _run()
    run.feed(FRONT, _image(), 500 * MS, 510 * MS)  # read when that camera was chosen before
    run.feed(PICTURE, _image(), 1000 * MS, 1010 * MS)
    run.step(1020 * MS)
    assert node.view is not None
    assert (node.view.shown, node.view.picture_live) == ("down", True)
    node.collector.look_through("front", 1050 * MS)
    run.feed(PICTURE, _image(), 1050 * MS, 1055 * MS)
    run.step(1060 * MS)
    assert node.view.shown == "front"
    assert node.view.picture is None, "neither the other camera's picture nor the old one"
    run.feed(FRONT, _image(), 1070 * MS, 1080 * MS)
    run.step(1090 * MS)
    assert node.view.picture_live and node.view.picture is not None
    assert node.view.picture.capture_ns == 1070 * MS


def test_state_of_a_picture_is_the_nearest_in_time() -> None:
    run, node = _run()
    for t_ms in range(0, 1000, 20):
        run.feed(STATE, flying(ned_p_m=(float(t_ms), 0.0, -5.0)), t_ms * MS)
    run.step(1000 * MS)
    state = node.collector.state_at(505 * MS)
    assert state is not None
    assert state.ned_p_m[0] == 500.0
    assert node.collector.state_at(5000 * MS) is None
