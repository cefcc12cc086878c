"""What the demonstration's operator does when a step is refused."""

from __future__ import annotations

import threading

import pytest

from simulation.demo.operator import MissionFailed, insist


class Step:
    """Refused so many times, then done."""

    def __init__(self, refusals: int):
        self.refusals, self.done = refusals, 0

    def __call__(self) -> None:
        if self.refusals:
            self.refusals -= 1
            raise MissionFailed("the gate has closed again")
        self.done += 1


def test_a_step_that_is_refused_for_a_moment_is_done_once() -> None:
    step = Step(2)
    insist(step, threading.Event())
    assert step.done == 1


def test_a_step_that_stays_refused_fails_with_its_reason() -> None:
    step = Step(99)
    with pytest.raises(MissionFailed, match="the gate has closed again"):
        insist(step, threading.Event())
    assert step.done == 0 and step.refusals == 99 - 4


def test_nothing_is_tried_again_once_the_mission_is_to_stop() -> None:
    stop, step = threading.Event(), Step(1)
    stop.set()
    with pytest.raises(MissionFailed):
        insist(step, stop)
    assert step.done == 0
