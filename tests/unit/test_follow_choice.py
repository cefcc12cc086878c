"""A choice on its way to real trackers that come up after it was made."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.painted_scene import Pose, Scene, straight
from common.geometry.config import CamerasConfig
from common.messages import Command
from common.node import CommandCall, ScriptedCall
from common.processes import load_config
from common.tracking.base import Box
from onboard.follow.choice import Choice, Picture, Pictures
from onboard.follow.follower import Follower

S = 1_000_000_000


def _film() -> list[tuple[Picture, Pose]]:
    frames = Scene(straight(60.0, start_px=260.0), seed=2).frames(3.0)
    return [(Picture(S + t_ns, frame), pose) for t_ns, frame, pose in frames]


def test_a_box_names_a_picture_that_is_kept() -> None:
    pictures, film = Pictures(), _film()
    with pytest.raises(ValueError, match="on a picture that is not kept; draw it on the live picture"):
        pictures.since(0)
    for picture, _ in film[:20]:
        pictures.keep(picture)
    assert [p.t_ns for p in pictures.since(film[17][0].t_ns)] == [film[i][0].t_ns for i in (17, 18, 19)]
    assert [p.t_ns for p in pictures.since(0)] == [film[19][0].t_ns]
    for stamp_ns in (film[0][0].t_ns, film[19][0].t_ns + S):
        with pytest.raises(ValueError, match="not kept"):
            pictures.since(stamp_ns)


@pytest.mark.slow
def test_trackers_that_come_up_late_catch_up() -> None:
    film = _film()
    (chosen, pose), rest = film[0], film[1:]
    call = CommandCall(ScriptedCall("follow/do/select", Command(box_px=pose.box())))
    choice = Choice(call, pose.box(), [chosen], S)
    for picture, _ in rest:  # he drives on by twice his length
        choice.add(picture)
        assert not choice.advance(None, picture.t_ns) and call.answer is None
    config = load_config("kite", ['hab_df.members=["dsst", "mil"]'])
    follower = Follower(config, config.section(CamerasConfig).by_name()["down"].camera())
    try:
        assert follower.fusion.pool.await_ready(40.0)
        steps = 1
        while not choice.advance(follower, rest[-1][0].t_ns):
            steps += 1
            assert steps < 100, "it gives the loop back between two looks, and ends"
        assert call.answer is not None and call.answer.outcome == "done" and follower.active
        box, truth = follower.fusion.box, rest[-1][1]
        assert box is not None
        off_px = math.hypot(box[0] + box[2] / 2 - truth.x_px, box[1] + box[3] / 2 - truth.y_px)
        assert off_px < 10.0 < 100.0 < truth.x_px - pose.x_px
    finally:
        follower.close()


@pytest.mark.slow
def test_a_choice_that_comes_to_nothing_leaves_the_target_from_before_unless_it_has_replaced_it() -> None:
    film = _film()
    config = load_config("kite", ['hab_df.members=["dsst"]'])
    follower = Follower(config, config.section(CamerasConfig).by_name()["down"].camera())

    def choice(box: Box, pictures: list[Picture]) -> tuple[Choice, CommandCall]:
        call = CommandCall(ScriptedCall("follow/do/select", Command(box_px=box)))
        return Choice(call, box, pictures, S), call

    try:
        assert follower.fusion.pool.await_ready(40.0)
        good = film[0][1].box()
        first, _ = choice(good, [picture for picture, _ in film[:5]])
        while not first.advance(follower, S):
            pass
        followed = follower.fusion.box
        outside, call = choice((900.0, 10.0, 40.0, 40.0), [film[5][0]])
        assert outside.advance(follower, S)
        assert call.answer is not None and call.answer.outcome == "refused" and "640x480" in call.answer.reason
        assert follower.active and follower.fusion.box == followed, "it goes on with what it had"
        waiting, _ = choice(good, [film[5][0]])
        waiting.supersede(follower, "a test")
        assert follower.active and follower.fusion.box == followed
        begun, call = choice(good, [film[5][0]])
        begun._catch_up(follower)
        begun.supersede(follower, "a test")
        assert call.answer is not None and call.answer.reason == "select: superseded by a test"
        assert not follower.active, "nobody was told that this one is followed"
    finally:
        follower.close()


def test_trackers_that_do_not_come_up_are_not_waited_for_for_ever() -> None:
    call = CommandCall(ScriptedCall("follow/do/select", Command(box_px=(10.0, 10.0, 40.0, 40.0))))
    choice = Choice(call, (10.0, 10.0, 40.0, 40.0), [Picture(S, np.zeros((480, 640, 3), np.uint8))], S)
    assert not choice.advance(None, 12 * S)
    assert choice.advance(None, 14 * S)
    assert call.answer is not None and call.answer.outcome == "failed"
    assert call.answer.reason.startswith("select: the trackers did not start within 12 s")
