"""Trackers in processes of their own: answers, late ones, a frozen and a killed process, the fusion over them."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator

import numpy as np
import pytest

from benchmarks.painted_scene import Scene, straight
from common.processes import load_config
from onboard.fusion.config import FusionConfig
from onboard.fusion.live import LiveHabDf
from onboard.fusion.members import Ask, MemberPool

SIZE = 640 * 480 * 3


@pytest.fixture
def fusion() -> Iterator[LiveHabDf]:
    pool = MemberPool(("dsst", "mil"), load_config(None), 1, SIZE)
    live = LiveHabDf(pool, FusionConfig(), answer_within_s=1.0, frozen_after_s=3.0)
    assert pool.await_ready(40.0)
    yield live
    live.close()


def _await_idle(pool: MemberPool) -> None:
    end = time.monotonic() + 20.0
    while any(member.busy for member in pool.members.values()) and time.monotonic() < end:
        pool.collect(0.1)
        time.sleep(0.01)


@pytest.mark.slow
def test_a_frozen_and_a_killed_tracker_hold_nobody_and_come_back(fusion: LiveHabDf) -> None:
    frames = list(Scene(straight(30.0), seed=3).frames(4.0))
    t_ns, frame, pose = frames[0]
    fusion.select(frame, pose.box(), 0.0, t_ns)
    members = fusion.pool.members
    _await_idle(fusion.pool)

    stopped: set[int] = set()

    def run(first: int, last: int) -> float:
        """Longest step, s; the fused place has to stay on the car."""
        longest = 0.0
        for stamp_ns, picture, truth in frames[first:last]:
            if all(members[name].pid not in stopped for name in members):
                _await_idle(fusion.pool)  # a busy machine is no fault of theirs
            began = time.monotonic()
            fused = fusion.step(picture, stamp_ns)
            longest = max(longest, time.monotonic() - began)
            assert fused.value[:2] == pytest.approx([truth.x_px, truth.y_px], abs=12.0)
        assert fused.state == "tracking"
        return longest

    run(1, 15)
    frozen = members["mil"].pid
    stopped.add(frozen)
    os.kill(frozen, signal.SIGSTOP)
    run(15, 17)
    time.sleep(0.2)  # from now on nobody waits for it
    fusion._answer_within_s = 0.4
    assert run(17, 25) < 0.9
    time.sleep(3.0)
    run(25, 26)
    assert members["mil"].pid != frozen and "did not answer" in fusion.begun_anew["mil"]

    killed = members["dsst"].pid
    assert fusion.pool.await_ready(40.0)
    fusion._answer_within_s = 1.0
    run(26, 40)
    assert members["mil"].started, "it has been put on the fused answer"
    os.kill(killed, signal.SIGKILL)
    time.sleep(0.2)
    fusion.step(frames[40][1], frames[40][0])
    assert members["dsst"].pid != killed and "died" in fusion.begun_anew["dsst"]


def test_an_answer_that_fails_says_why_and_ends_nothing() -> None:
    pool = MemberPool(("mil",), load_config(None), 1, SIZE)
    try:
        assert pool.await_ready(40.0)
        member = pool.members["mil"]
        frame = np.zeros((480, 640, 3), np.uint8)
        assert member.ask(Ask("init", 0, frame.shape, (900.0, 0.0, 40.0, 40.0)), frame)
        assert not member.ask(Ask("update", 0, frame.shape), frame), "one question at a time"
        ((name, answer),) = pool.collect(20.0)
        assert name == "mil" and answer.result is None and "expected most of it in the 640x480" in answer.error
        assert member.tend(5.0) == "", "it lives on"
    finally:
        pool.close()
