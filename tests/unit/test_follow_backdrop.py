"""The room behind the head's target: what differs from it, in any direction, under any light."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.follow_scene import Hall, Lens, Light, Thing, camera
from benchmarks.follow_solids import bin_
from common.geometry.rotation import quat_from_euler
from common.tracking.base import Box
from onboard.follow.backdrop import Backdrop

EYE = camera(320, 240, math.radians(60.0))
HALL = Hall((5.0, 5.0), 2)
PLACE = np.array([0.0, 0.0, -1.2])
NOWHERE: Box = (-100.0, -100.0, 10.0, 10.0)


def _picture(pan: float, tilt: float, gain: float = 1.0, *things: Thing) -> np.ndarray:
    lens = Lens(EYE, PLACE, quat_from_euler(0.0, tilt, pan))
    return HALL.picture(lens, things, Light((gain, gain, gain)))


def _known() -> Backdrop:
    """A room that has been looked at from 0.5 rad on the left to 0.1 on the right."""
    backdrop = Backdrop(EYE, (2.6, 0.9))
    for pan in np.linspace(-0.5, 0.1, 25).tolist():
        backdrop.look(_picture(pan, 0.3 * pan), pan, 0.3 * pan)
        backdrop.learn(NOWHERE)
    return backdrop


def test_a_thing_is_told_from_a_room_that_was_seen_in_other_pictures_and_another_light() -> None:
    backdrop = _known()
    thing = Thing(bin_(np.random.default_rng(1)), PLACE + np.array([1.0, -0.2, 0.175]))
    for gain in (1.0, 0.7):
        pan, tilt = -0.22, -0.05
        shown = Lens(EYE, PLACE, quat_from_euler(0.0, tilt, pan)).show(thing)
        assert shown is not None
        apart = backdrop.look(_picture(pan, tilt, gain, thing), pan, tilt)
        x, y, width, height = (side / 2 for side in shown.box)
        inside = np.zeros(apart.shape, bool)
        inside[int(y + 2) : int(y + height - 2), int(x + 0.2 * width) : int(x + 0.8 * width)] = True
        around = np.ones(apart.shape, bool)
        around[int(y - 2) : int(y + height + 2), int(x - 2) : int(x + width + 2)] = False
        assert float((apart[inside] == 1).mean()) > 0.85
        assert float((apart[around] == 1).mean()) < 0.03


def test_what_was_never_seen_is_unknown_and_what_is_the_target_is_not_learned() -> None:
    backdrop = _known()
    beyond = backdrop.look(_picture(0.6, 0.1), 0.6, 0.1)
    assert (beyond[:, 120:] == 0).all() and float((beyond[20:100, :20] == -1).mean()) > 0.9
    target: Box = (140.0, 100.0, 40.0, 40.0)
    there = _picture(1.2, 0.1)
    for _ in range(8):
        backdrop.look(there, 1.2, 0.1)
        backdrop.learn(target)
    apart = backdrop.look(there, 1.2, 0.1)
    assert (apart[52:68, 72:88] == 0).all() and float((apart == -1).mean()) > 0.8


def test_a_picture_of_another_size_is_refused() -> None:
    with pytest.raises(ValueError, match="got 160x120 px, expected 320x240 px"):
        Backdrop(EYE, (2.6, 0.9)).look(np.zeros((120, 160, 3), np.uint8), 0.0, 0.0)


def test_who_passes_leaves_no_trace_and_what_stays_becomes_the_room() -> None:
    backdrop = _known()
    thing = Thing(bin_(np.random.default_rng(1)), PLACE + np.array([1.0, -0.2, 0.175]))
    with_it = _picture(-0.2, 0.0, 1.0, thing)
    for _ in range(30):
        backdrop.look(with_it, -0.2, 0.0)
        backdrop.learn(NOWHERE)
    apart = backdrop.look(_picture(-0.2, 0.0), -0.2, 0.0)
    assert float((apart == 1).mean()) < 0.02
    backdrop.learn(NOWHERE)
    for _ in range(95):
        backdrop.look(with_it, -0.2, 0.0)
        backdrop.learn(NOWHERE)
    assert float((backdrop.look(with_it, -0.2, 0.0) == 1).mean()) < 0.02
