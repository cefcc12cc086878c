"""Control laws of the three platforms against the closed forms that their gains are placed by."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from common.config import ConfigError, build
from onboard.follow.config import FollowConfig
from onboard.follow.gains import pd_gains, pid_gains
from onboard.follow.law import FollowLaw, TargetState, Vehicle
from onboard.follow.pan_tilt import PanTiltConfig, PanTiltLaw
from onboard.follow.unicycle import UnicycleConfig, UnicycleLaw

STEP_S = 0.02
S = 1_000_000_000


@pytest.mark.parametrize(("natural", "damping", "lag"), [(1.3, 1.0, 0.55), (2.0, 0.7, 0.3), (0.6, 1.4, 1.0)])
def test_pd_gains_give_the_wanted_poles(natural: float, damping: float, lag: float) -> None:
    gains = pd_gains(natural, damping, lag)
    assert np.poly(np.roots([lag, 1.0 + gains.kd, gains.kp_1_s])) == pytest.approx(
        [1.0, 2 * damping * natural, natural**2]
    )


def test_pid_gains_give_the_wanted_poles() -> None:
    gains = pid_gains(6.0, 0.9, 1.0, 0.06)
    wanted = np.polymul([1.0, 1.0], [1.0, 2 * 0.9 * 6.0, 36.0])
    assert np.array([0.06, 1.0 + gains.kd, gains.kp_1_s, gains.ki_1_s2]) / 0.06 == pytest.approx(wanted)


def test_the_error_falls_as_the_closed_form_says() -> None:
    """Critically damped, from rest beside a target that moves on: e = e0 (1 + ω t) exp(-ω t)."""
    config = FollowConfig()
    gains, w, v, e = pd_gains(1.3, 1.0, config.lag_s), 0.8, 0.8, 1.0
    dt = 0.0005
    for index in range(6000):
        t = index * dt
        if index % 1000 == 0:
            assert e == pytest.approx((1 + 1.3 * t) * math.exp(-1.3 * t), abs=2e-3)
        asked = gains.rate(e, w - v, w)
        v += (asked - v) / config.lag_s * dt
        e += (w - v) * dt


class Flight:
    """A vehicle that answers as the model says, and a target on a path."""

    def __init__(self, path: Callable[[float], tuple[float, float, float]], ahead: bool, **settings: object):
        self.config = build(FollowConfig, settings, "test")
        self.law, self.path = FollowLaw(self.config, ahead), path
        self.p, self.v, self.yaw, self.turn = np.array([0.0, 0.0, -5.0]), np.zeros(3), 0.0, 0.0
        self.requests: list[np.ndarray] = []

    def target(self, t: float) -> TargetState:
        place, later = np.array(self.path(t)), np.array(self.path(t + 1e-3))
        return TargetState(place, (later - place) / 1e-3)

    def fly(self, duration_s: float) -> tuple[np.ndarray, float]:
        """Target from the vehicle (3,), m, and its bearing off the nose, rad, at the end."""
        for index in range(round(duration_s / STEP_S)):
            t = index * STEP_S
            request = self.law.ask(self.target(t), Vehicle(self.p, self.v, self.yaw, self.turn), round((t + 1.0) * S))
            self.requests.append(np.array(request.vector))
            self.v = self.v + (np.array(request.vector) - self.v) * (STEP_S / self.config.lag_s)
            self.turn += (request.yaw_rate_rad_s - self.turn) * (STEP_S / self.config.yaw_lag_s)
            self.p = self.p + self.v * STEP_S
            self.yaw += self.turn * STEP_S
        apart = self.target(duration_s).ned_p_m - self.p
        return apart, math.remainder(math.atan2(apart[1], apart[0]) - self.yaw, 2 * math.pi)


def test_above_a_target_nothing_is_left_of_a_steady_motion() -> None:
    flight = Flight(lambda t: (2.0 + 1.2 * t, -1.0 - 0.5 * t, 0.0), ahead=False)
    apart, _ = flight.fly(12.0)
    assert apart[:2] == pytest.approx([0.0, 0.0], abs=0.03)
    assert apart[2] == pytest.approx(5.0), "the height is held"


def test_the_first_request_begins_at_the_vehicles_own_velocity() -> None:
    flight = Flight(lambda t: (3.0, 0.0, 0.0), ahead=False)
    flight.v = np.array([1.0, -0.5, 0.0])
    flight.fly(2.0)
    changes = np.linalg.norm(np.diff([np.array([1.0, -0.5, 0.0]), *flight.requests], axis=0), axis=1)
    assert changes[0] <= 3.0 * 0.05 + 1e-9
    assert changes[1:].max() <= 3.0 * STEP_S + 1e-9
    assert max(np.linalg.norm(r[:2]) for r in flight.requests) <= 3.0 + 1e-9


def test_a_request_that_takes_over_begins_at_what_was_flown_before() -> None:
    law = FollowLaw(FollowConfig(), ahead=False)
    target = TargetState(np.array([2.0, 0.0, 0.0]), np.zeros(3))
    vehicle = Vehicle(np.array([0.0, 0.0, -5.0]), np.array([0.2, 0.0, 0.0]), 0.0, 0.0)
    law.ask(target, vehicle, 0)
    law.restart(np.array([1.0, -0.5, 0.0]), 1_000_000_000)
    assert law.ask(target, vehicle, 990_000_000).vector[:2] == pytest.approx((1.0, -0.5)), "a picture from before"
    law.restart(np.array([1.0, -0.5, 0.0]), 1_000_000_000)
    north, east, _ = law.ask(target, vehicle, 1_040_000_000).vector
    assert math.hypot(north - 1.0, east + 0.5) == pytest.approx(0.04 * FollowConfig().slew_m_s2)


def test_above_a_target_the_nose_turns_as_its_course_does() -> None:
    def circle(t: float) -> tuple[float, float, float]:
        return (4.0 * math.sin(0.25 * t), 4.0 - 4.0 * math.cos(0.25 * t), 0.0)

    flight = Flight(circle, ahead=False)
    flight.yaw = math.radians(30.0)
    apart, _ = flight.fly(16.0)
    course = 0.25 * 16.0
    off = math.remainder(flight.yaw - course - math.radians(30.0), 2 * math.pi)
    assert abs(off) < 0.3, "a steady turn of 0.25 rad/s, less what a proportional gain leaves"
    assert np.hypot(*apart[:2]) < 0.35


def test_a_target_ahead_is_faced_and_its_distance_kept() -> None:
    flight = Flight(lambda t: (4.0 + 0.7 * t, 1.0 + 0.4 * t, -4.0), ahead=True)
    start_m = math.hypot(4.0, 1.0)
    apart, bearing = flight.fly(15.0)
    assert np.hypot(*apart[:2]) == pytest.approx(start_m, abs=0.05)
    assert bearing == pytest.approx(0.0, abs=0.02)


def test_a_target_far_off_the_nose_is_turned_to_first() -> None:
    flight = Flight(lambda t: (-6.0, 1.0, -5.0), ahead=True)
    flight.fly(1.0)
    assert np.allclose(flight.requests, 0.0)
    assert flight.turn > 0.3


def test_the_size_moves_the_height_only_where_that_is_wanted() -> None:
    def rising(t: float) -> tuple[float, float, float]:
        return (0.0, 0.0, -0.2 * t)

    held, kept = Flight(rising, ahead=False), Flight(rising, ahead=False, height="scale")
    assert held.fly(10.0)[0][2] == pytest.approx(5.0 - 2.0)
    assert kept.fly(10.0)[0][2] == pytest.approx(5.0, abs=0.03)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_law_refuses_what_is_no_number(bad: float) -> None:
    law = FollowLaw(FollowConfig(), ahead=False)
    vehicle = Vehicle(np.zeros(3), np.zeros(3), 0.0, 0.0)
    with pytest.raises(ValueError, match="expected finite"):
        law.ask(TargetState(np.array([bad, 0.0, 0.0]), np.zeros(3)), vehicle, S)
    with pytest.raises(ValueError, match="expected finite"):
        PanTiltLaw(PanTiltConfig()).step(bad, 0.0, 0.03)
    with pytest.raises(ValueError, match="expected finite"):
        UnicycleLaw(UnicycleConfig(), 0.8, 0.5).step(0.0, bad, 1.0, 0.0)
    with pytest.raises(ValueError, match="got distance"):
        UnicycleLaw(UnicycleConfig(), bad, 0.5)


def _pan(law: PanTiltLaw, path: Callable[[float], float], duration_s: float) -> list[float]:
    """Errors of the pan axis, rad, every 1/30 s, of a servo with the configured lag."""
    pan, errors, dt = 0.0, [], 1.0 / 30.0
    for index in range(round(duration_s / dt)):
        errors.append(path(index * dt) - pan)
        commanded, _ = law.step(errors[-1], 0.0, dt)
        pan += (commanded - pan) * -math.expm1(-dt / 0.06)
    return errors


def test_pan_leaves_nothing_of_a_steady_motion_and_little_of_a_step() -> None:
    errors = _pan(PanTiltLaw(PanTiltConfig()), lambda t: 0.2 + 0.4 * t, 6.0)
    assert max(map(abs, errors[90:])) < 0.012
    assert min(errors) > -0.2, "it does not swing past by as much as it was off"


def test_a_head_at_its_end_does_not_wind_up() -> None:
    law = PanTiltLaw(PanTiltConfig(pan_limit_rad=1.0))
    _pan(law, lambda t: 1.6, 8.0)
    assert law.pan_rad == 1.0
    back = _pan(law, lambda t: 0.5, 2.0)
    assert abs(back[-1]) < 0.05


def test_the_larger_error_is_acted_on() -> None:
    law = UnicycleLaw(UnicycleConfig(), 0.8, math.radians(30.0))
    turn = law.step(math.radians(25.0), 0.0, 0.9, 0.0)
    assert turn.axis == "turn" and turn.turn_rad_s > 0.0 and turn.speed_m_s == 0.0
    drive = law.step(math.radians(1.0), 0.0, 1.5, 0.0)
    assert drive.axis == "drive" and drive.speed_m_s > 0.0 and drive.turn_rad_s == 0.0
    assert law.step(0.0, 0.0, 0.8, 0.0).axis is None
    back = law.step(0.0, 0.0, 0.5, 0.0)
    assert back.speed_m_s < 0.0, "it backs away from a target that comes too near"
    on = law.step(math.radians(25.0), 0.0, 0.8, 0.0, (0.3, 0.0))
    assert on.axis == "turn" and on.speed_m_s == 0.3, "the other axis goes on as the target does"


def test_a_robot_reaches_distance_and_bearing_by_turns() -> None:
    config = UnicycleConfig()
    law = UnicycleLaw(config, 0.8, math.radians(30.0))
    x = y = heading = speed = turn = 0.0
    target, last = (1.6, 0.7), None
    for _ in range(400):
        dx, dy = target[0] - x, target[1] - y
        distance, bearing = math.hypot(dx, dy), math.atan2(dy, dx) - heading
        rates = (0.0, 0.0) if last is None else ((bearing - last[0]) / STEP_S, (last[1] - distance) / STEP_S)
        last = (bearing, distance)
        asked = law.step(bearing, rates[0], distance, rates[1], (speed, turn))
        speed += (asked.speed_m_s - speed) * STEP_S / config.lag_s
        turn += (asked.turn_rad_s - turn) * STEP_S / config.lag_s
        heading += turn * STEP_S
        x, y = x + speed * math.cos(heading) * STEP_S, y + speed * math.sin(heading) * STEP_S
    assert distance == pytest.approx(0.8, abs=0.03)
    assert bearing == pytest.approx(0.0, abs=0.03)


def test_settings_out_of_range_are_refused() -> None:
    with pytest.raises(ConfigError, match="pi and pi/2"):
        build(PanTiltConfig, {"tilt_limit_rad": 2.0}, "test")
    with pytest.raises(ConfigError, match="lag_s"):
        build(FollowConfig, {"lag_s": 0.0}, "test")
