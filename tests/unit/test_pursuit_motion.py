"""The relative motion: found from noisy pictures, carried on through the requests that are under way."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import pytest

from common.geometry.rotation import quat_from_euler
from ground.pursuit.answer import ERROR, OWN_V, SIZE, TARGET_A, TARGET_V, WIND, make_answer
from ground.pursuit.config import PursuitConfig
from ground.pursuit.motion import RelativeMotion, tilt_acceleration
from ground.pursuit.view import Pose

CONFIG, PERIOD_S, PERIOD_NS = PursuitConfig(), 0.05, 50_000_000
STILL = Pose(np.array([0.0, 0.0, -3.0]), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))


def _motion(form: Literal["velocity", "orientation"] = "orientation") -> RelativeMotion:
    return RelativeMotion(CONFIG, make_answer(CONFIG, form))


def test_velocity_and_acceleration_of_the_target_are_found_under_a_vehicle_that_stands() -> None:
    motion, rng = _motion(), np.random.default_rng(0)
    for index in range(80):
        t_s = index * PERIOD_S
        place = np.array([0.4 * t_s, 0.3 * max(0.0, t_s - 2.0) ** 2])
        motion.update(place + rng.normal(0, 0.005, 2), STILL, index * PERIOD_NS, 0.0, 0.02)
        motion.sent(np.zeros(2))
    assert motion.state is not None
    assert motion.state[TARGET_V] == pytest.approx([0.4, 0.6 * (79 * PERIOD_S - 2.0)], abs=0.15)
    assert motion.state[TARGET_A] == pytest.approx([0.0, 0.6], abs=0.35)


def test_what_is_ahead_is_where_a_target_that_turns_will_be() -> None:
    motion, turn_rad_s = _motion(), 0.5
    for index in range(120):
        t_s = index * PERIOD_S
        place = 2.0 * np.array([math.sin(turn_rad_s * t_s), 1.0 - math.cos(turn_rad_s * t_s)])
        motion.update(place, STILL, index * PERIOD_NS, turn_rad_s, 0.01)
        motion.sent(np.zeros(2))
    ahead, later_s = motion.ahead(), 119 * PERIOD_S + CONFIG.tilt_delay_s + CONFIG.request_delay_s
    assert ahead is not None
    angle = turn_rad_s * later_s
    assert ahead[ERROR] == pytest.approx([2.0 * math.sin(angle), 2.0 * (1.0 - math.cos(angle))], abs=0.02)
    assert motion.target_acceleration(ahead) == pytest.approx([-0.5 * math.sin(angle), 0.5 * math.cos(angle)], abs=0.1)


@pytest.mark.parametrize("form", ["velocity", "orientation"])
def test_a_request_is_the_inverse_of_what_is_commanded(form: Literal["velocity", "orientation"]) -> None:
    motion = _motion(form)
    level = quat_from_euler(0.02, -0.03, 0.5)
    pose = Pose(STILL.ned_p_m, np.array([0.3, 0.1, 0.0]), quat_from_euler(0.0, 0.01, 0.5), level)
    motion.update(np.array([0.2, 0.1]), pose, 0, 0.0, 0.02)
    state = np.random.default_rng(1).normal(0.0, 1.0, (SIZE, 2))
    wanted = np.array([0.7, -0.4])
    assert motion.commanded(state, motion.request(state, wanted)) == pytest.approx(wanted)
    assert motion.slant_m_s2 == pytest.approx(tilt_acceleration(level) - tilt_acceleration(pose.ned_q_body))


def test_a_request_under_way_shows_ahead_before_it_shows_in_the_estimate() -> None:
    motion = _motion()
    motion.update(np.zeros(2), STILL, 0, 0.0, 0.02)
    motion.sent(np.array([2.0, 0.0]))
    motion.update(np.zeros(2), STILL, PERIOD_NS, 0.0, 0.02)
    motion.sent(np.array([2.0, 0.0]))
    motion.update(np.zeros(2), STILL, 2 * PERIOD_NS, 0.0, 0.02)
    ahead = motion.ahead()
    assert motion.state is not None
    assert ahead is not None
    assert ahead[OWN_V, 0] > motion.state[OWN_V, 0] + 0.01


def test_a_gust_is_felt_by_the_accelerometers_before_it_shows_in_velocity_and_pictures() -> None:
    felt = []
    for told in (False, True):
        motion = _motion()
        for index in range(45):
            blown_s = max(0.0, (index - 40) * PERIOD_S)  # a wind of 0.4 m/s² sets in and pushes north
            wind = np.array([0.4 if index > 40 else 0.0, 0.0])
            velocity = np.array([0.4 * blown_s, 0.0, 0.0])
            pose = Pose(STILL.ned_p_m, velocity, STILL.ned_q_body, None, wind if told else None)
            motion.update(np.array([-0.2 * blown_s**2, 0.0]), pose, index * PERIOD_NS, 0.0, 0.02)
            motion.sent(np.zeros(2))
        assert motion.state is not None
        felt.append(motion.state[WIND, 0])
    assert felt[1] > 1.5 * felt[0]
    assert felt[1] == pytest.approx(0.4, abs=0.15)


def test_after_a_long_gap_the_motion_is_estimated_anew() -> None:
    motion = _motion()
    motion.update(np.array([1.0, 0.0]), STILL, 0, 0.0, 0.02)
    motion.update(None, STILL, 5_000_000_000, 0.0, 0.02)
    assert motion.ahead() is None
