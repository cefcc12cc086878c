"""The pan-tilt head's follower: a direction that does not turn with it, what it expects, and what it does unseen."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.follow_scene import camera
from common.tracking.base import Box
from onboard.follow.head import HeadFollower
from onboard.follow.pan_tilt import PanTiltConfig

EYE = camera(320, 240, math.radians(60.0))
STEP_NS = 33_333_333
STEP_S = STEP_NS * 1e-9
CONFIG = PanTiltConfig()
NOTHING = np.zeros((240, 320, 3), np.uint8)


def _box(off: np.ndarray) -> Box:
    """Of a target that is so far to the right of and above the middle, rad."""
    u, v = EYE.cx_px + EYE.fx_px * math.tan(off[0]), EYE.cy_px - EYE.fy_px * math.tan(off[1])
    return u - 20.0, v - 30.0, 40.0, 60.0


def test_a_target_that_goes_on_is_expected_where_it_is_and_turned_after_while_it_is_hidden() -> None:
    follower, head, asked, before = HeadFollower(CONFIG, EYE), np.zeros(2), np.zeros(2), np.zeros(2)
    target, rate = np.array([0.1, 0.05]), np.array([0.3, -0.05])
    offs = []
    for index in range(220):
        follower.turned(index * STEP_NS, *head.tolist())
        foreseen, off, seen = follower.expected(NOTHING), target - head, index < 120
        expected = None if foreseen is None else foreseen.box
        if foreseen is not None and index < 120:
            stood = np.array(_box(off)[:2]) - _box(target - before)[:2]
            assert foreseen.moved_px == pytest.approx(stood, abs=0.2), "what stands there moves by the head alone"
        before = head
        if 10 < index < 120:
            assert expected == pytest.approx(_box(off), abs=5.0)
        if 120 <= index < 135:
            assert expected == pytest.approx(_box(off), abs=25.0)
        if index >= 120 + CONFIG.coast_s / STEP_S + 1:
            assert expected is None
        commanded = np.array(follower.step(_box(off) if seen else None))
        head = head + (asked - head) * -math.expm1(-STEP_S / CONFIG.lag_s)
        asked, target = commanded, target + rate * STEP_S
        offs.append(off)
    assert np.abs(offs[119]).max() < 0.02
    assert np.abs(offs[135]).max() < 0.12, "held where it was, it would be 0.15 off by now"
    assert np.allclose(asked, head, atol=0.01), "who stays away is not turned after"


def test_a_head_without_a_target_stays_and_bad_servos_are_refused() -> None:
    follower = HeadFollower(CONFIG, EYE)
    follower.turned(0, 0.0, 0.0)
    assert follower.expected(NOTHING) is None and follower.step(None) == (0.0, 0.0)
    with pytest.raises(ValueError, match="expected finite"):
        follower.turned(10, math.inf, 0.0)
    follower.turned(10, 0.0, 0.0)
    with pytest.raises(ValueError, match="not before 10 ns"):
        follower.turned(5, 0.0, 0.0)
