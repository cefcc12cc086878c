"""The ground robot's follower: a place over ground, what it expects of the next picture, and what it does unseen."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.follow_scene import camera
from common.tracking.base import Box
from onboard.follow.robot import RobotFollower
from onboard.follow.unicycle import UnicycleConfig
from onboard.fusion.config import DepthConfig

EYE = camera(320, 240, math.radians(60.0))
STEP_NS = 33_333_333
STEP_S = STEP_NS * 1e-9
CONFIG = UnicycleConfig()
SIZE_M, BELOW_M = np.array([0.25, 0.35]), 0.2


def _middle(box: Box) -> tuple[float, float]:
    return box[0] + box[2] / 2, box[1] + box[3] / 2


class World:
    """A robot with a lag in its wheels, and a target that keeps its velocity."""

    def __init__(self, velocity: tuple[float, float]):
        self.follower = RobotFollower(CONFIG, DepthConfig(), EYE)
        self.place, self.yaw, self.own = np.zeros(2), 0.0, np.zeros(2)
        self.target, self.velocity = np.array([0.8, 0.0]), np.array(velocity)
        self.t_ns, self.grown = 0, 1.0
        self.before, self.moved_px = (self.place, self.yaw), (math.nan, math.nan)

    def ahead(self, before: bool = False) -> np.ndarray:
        """Of the target from the robot now, or from where it was, ahead and to the right, (2,), m."""
        place, yaw = self.before if before else (self.place, self.yaw)
        x, y = self.target - place
        c, s = math.cos(yaw), math.sin(yaw)
        return np.array([c * x + s * y, c * y - s * x])

    def box(self, before: bool = False) -> Box:
        """Where the picture shows the target, or showed it if it was there already, px."""
        ahead, aside = self.ahead(before)
        width, height = EYE.fx_px * SIZE_M / ahead
        u, v = EYE.cx_px + EYE.fx_px * aside / ahead, EYE.cy_px + EYE.fy_px * BELOW_M / ahead
        width, height = self.grown * width, self.grown * height
        return u - width / 2, v - height / 2, width, height

    def step(self, seen: bool) -> Box | None:
        """One picture; returns where it was expected to show the target."""
        self.follower.roll(self.t_ns, *self.own.tolist())
        expected = self.follower.expected()
        self.moved_px = None if expected is None else expected.moved_px
        depth_m = np.full((4, 4), self.ahead()[0] if self.ahead()[0] < 1.0 else 0.0)
        asked = self.follower.step(self.box() if seen else None, depth_m if seen else None)
        self.own += (np.array([asked.speed_m_s, asked.turn_rad_s]) - self.own) * STEP_S / CONFIG.lag_s
        self.before = self.place, self.yaw
        self.yaw += self.own[1] * STEP_S
        self.place = self.place + self.own[0] * STEP_S * np.array([math.cos(self.yaw), math.sin(self.yaw)])
        self.target = self.target + self.velocity * STEP_S
        self.t_ns += STEP_NS
        return None if expected is None else expected.box


def test_a_target_that_drives_on_is_expected_where_it_is_and_followed_while_it_is_hidden() -> None:
    world = World((0.3, 0.12))
    assert world.step(True) is None, "nothing is known before the first picture"
    for _ in range(150):
        world.step(True)
    true = world.box()
    assert world.step(True) == pytest.approx(true, abs=2.0)
    assert np.hypot(*world.ahead()) == pytest.approx(0.8, abs=0.05)
    for _ in range(30):
        true = world.box()
        expected = world.step(False)
        assert expected == pytest.approx(true, abs=8.0)
    assert np.hypot(*world.ahead()) == pytest.approx(0.8, abs=0.1), "a second behind something changes little"
    assert world.follower.distance_m == pytest.approx(world.ahead()[0], abs=0.1)
    for _ in range(60):
        expected = world.step(False)
    assert expected is None and np.abs(world.own).max() < 0.05, "who stays away is not driven after"


def test_what_stands_where_the_target_is_moves_by_what_the_wheels_do_alone() -> None:
    world = World((0.3, 0.2))
    most = 0.0
    for index in range(120):
        stood = np.array(_middle(world.box())) - _middle(world.box(before=True))
        world.step(True)
        if index > 10:
            assert world.moved_px == pytest.approx(stood, abs=0.3)
            most = max(most, float(np.hypot(*stood)))
    assert most > 2.0


def test_what_the_wheels_begin_to_do_changes_the_rates_before_a_picture_shows_it() -> None:
    world = World((0.0, 0.0))
    for _ in range(40):
        world.step(True)
    world.follower.roll(world.t_ns, 0.3, 0.5)
    world.follower.step(world.box(), np.full((4, 4), world.ahead()[0]))
    depth = world.follower._depth._filter
    assert depth is not None
    assert depth.rate[2] == pytest.approx(-0.3, abs=0.06), "it comes nearer as fast as the robot drives at it"
    assert depth.rate[0] == pytest.approx(-0.5 * EYE.fx_px, rel=0.2), "and goes to the left as the robot turns"


def test_what_slides_before_the_target_is_not_taken_for_its_distance() -> None:
    world = World((0.0, 0.0))
    for _ in range(40):
        world.step(True)
    ahead_m = world.follower.distance_m
    for share in (1, 2, 3):
        world.t_ns += STEP_NS
        depth_m = np.full((4, 4), ahead_m)
        depth_m[:, :share] = 0.6 * ahead_m
        world.follower.roll(world.t_ns, 0.0, 0.0)
        drive = world.follower.step(world.box(), depth_m)
    assert world.follower.distance_m == pytest.approx(ahead_m, abs=0.02)
    assert abs(drive.speed_m_s) < 0.05, "it does not come nearer"


def test_what_is_beyond_the_range_is_not_kept_there_by_a_box_that_has_grown() -> None:
    """It seems as near as it should be, where the sensor has always measured it; since it does not, it is farther."""
    world = World((0.0, 0.0))
    for far_m in (0.8, 0.97):
        world.target = world.place + np.array([far_m, 0.0])
        for _ in range(90):
            world.step(True)
    world.target, world.grown = world.place + np.array([1.12, 0.0]), 1.35
    for k in range(150):
        world.step(True)
        if k == 20:
            assert world.follower.distance_m < 0.92, "what is pushed before it passes by then"
    assert world.ahead()[0] < 1.0, "it has driven up to where the sensor measures"
    assert world.follower.distance_m == pytest.approx(world.ahead()[0], abs=0.03)


def test_a_box_that_grows_by_half_at_the_same_distance_is_not_expected_so() -> None:
    world = World((0.0, 0.0))
    for _ in range(30):
        world.step(True)
    true, world.grown = world.box(), 1.5
    for _ in range(300):
        expected = world.step(True)
    assert expected is not None and expected[2] == pytest.approx(1.1 * true[2], rel=0.02)
    assert expected[3] == pytest.approx(1.1 * true[3], rel=0.02)


def test_nothing_is_asked_without_a_distance_and_bad_wheels_are_refused() -> None:
    follower = RobotFollower(CONFIG, DepthConfig(), EYE)
    follower.roll(0, 0.0, 0.0)
    drive = follower.step((100.0, 100.0, 50.0, 60.0), None)
    assert drive.axis is None and drive.speed_m_s == drive.turn_rad_s == 0.0
    assert math.isnan(follower.distance_m) and follower.expected() is None
    with pytest.raises(ValueError, match="expected finite"):
        follower.roll(10, math.nan, 0.0)
    follower.roll(10, 0.1, 0.0)
    with pytest.raises(ValueError, match="not before 10 ns"):
        follower.roll(5, 0.1, 0.0)
