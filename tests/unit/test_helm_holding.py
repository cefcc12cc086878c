"""What helm holds while it flies: distance, place, heading and height, on a point-mass vehicle."""

from __future__ import annotations

import math

import pytest

from common.config import ConfigError
from common.messages import LimiterStatus, Obstacle, Obstacles, Request, View
from tests.unit.helm_double import Desk


def _speed(desk: Desk) -> float:
    return math.hypot(desk.vehicle.v[0], desk.vehicle.v[1])


def test_the_limiter_stands_between_the_chase_and_an_obstacle():
    desk = Desk().fly().chase((2.0, 0.0, 0.0))
    for _ in range(1500):
        distance = 12.0 - desk.vehicle.p[0]
        desk.obstacles = [Obstacle(distance_m=max(distance, 0.0), ned_direction=(1.0, 0.0, 0.0))]
        desk.step()
        assert distance > 0.8
    assert distance == pytest.approx(1.5, abs=0.3)
    assert desk.setpoints[-1].source == "pursuit"
    assert desk.status and desk.status.limiter_zone == "transition"


def test_every_source_of_obstacles_counts_and_the_limiter_says_what_it_did():
    for topic in ("obstacles/depth", "obstacles/people", "obstacles/circles"):
        desk = Desk().fly().chase((2.0, 0.0, 0.0))
        said: list[LimiterStatus] = []
        for _ in range(300):
            wall = Obstacle(distance_m=max(6.0 - desk.vehicle.p[0], 0.0), ned_direction=(1.0, 0.0, 0.0), label="wall")
            desk.feed(topic, Obstacles(obstacles=(wall,)))
            said += [o.message for o in desk.step() if isinstance(o.message, LimiterStatus)]
        assert 0.8 < wall.distance_m < 2.0, topic
        assert 55 <= len(said) <= 65, "ten a second"
        assert said[-1].label == "wall" and said[-1].why in ("curve", "push-back") and said[-1].zone == "transition"
        assert said[-1].allowed_m_s < 0.1 and said[-1].source == topic
        assert said[-1].sectors_m[0] == pytest.approx(wall.distance_m, abs=0.05)
        assert said[-1].sectors_m[1:] == (-1.0,) * 71


def test_the_operator_switches_the_push_back_off_and_on():
    desk = Desk().fly().chase((1.0, 0.0, 0.0))
    told: list[LimiterStatus] = []

    def push(seconds: float) -> tuple[float, LimiterStatus]:
        """At what stays 1.1 m ahead, whatever the vehicle does: its speed, and what the limiter says."""
        desk.obstacles = [Obstacle(distance_m=1.1, ned_direction=(1.0, 0.0, 0.0))]
        for _ in range(round(seconds / 0.02)):
            told.extend(o.message for o in desk.step() if isinstance(o.message, LimiterStatus))
        return desk.vehicle.v[0], told[-1]

    speed, status = push(2.0)
    assert speed == pytest.approx(-0.4, abs=0.05) and (status.why, status.push_back_m_s) == ("push-back", 0.5)
    assert (answer := desk.call("push-back", on=False).answer) and answer.outcome == "done"
    speed, status = push(2.0)
    assert speed == pytest.approx(0.0, abs=0.02) and (status.why, status.push_back_m_s) == ("curve", 0.0)
    assert (answer := desk.call("push-back").answer) and answer.outcome == "refused" and "on nor off" in answer.reason
    assert (answer := desk.call("push-back", on=True).answer) and answer.outcome == "done"
    assert push(2.0)[0] == pytest.approx(-0.4, abs=0.05)


def test_a_push_back_that_is_not_configured_cannot_be_switched_on():
    desk = Desk(limiter={"push_back_m_s": 0.0}).fly()
    assert (answer := desk.call("push-back", on=True).answer) and answer.outcome == "refused"
    assert "limiter.push_back_m_s" in answer.reason


def _lean(north_m_s2: float, east_m_s2: float = 0.0) -> Request:
    return Request(kind="acceleration", frame="ned", vector=(north_m_s2, east_m_s2, 0.0))


def test_an_acceleration_that_leads_nowhere_forbidden_is_flown_as_asked():
    desk = Desk().fly().chase((0.0, 0.0, 0.0))
    desk.pursuit = _lean(0.6, -0.3)
    desk.go(1.0)
    assert desk.setpoints[-1].ned_a_m_s2 == pytest.approx((0.6, -0.3))
    assert desk.vehicle.v[:2] == pytest.approx([0.6, -0.3], abs=0.06)
    assert desk.vehicle.height_m == pytest.approx(4.0, abs=0.1)


def test_an_acceleration_never_leads_past_the_largest_speed():
    desk = Desk().fly().chase((0.0, 0.0, 0.0))
    desk.pursuit = _lean(2.0)
    desk.go(6.0)
    assert desk.vehicle.v[0] == pytest.approx(3.0, abs=0.1)
    assert desk.setpoints[-1].ned_a_m_s2 == pytest.approx((0.0, 0.0), abs=0.1)


def test_the_limiter_stands_between_an_acceleration_and_an_obstacle():
    desk = Desk().fly().chase((0.0, 0.0, 0.0))
    desk.pursuit = _lean(1.5)
    for _ in range(1500):
        distance = 12.0 - desk.vehicle.p[0]
        desk.obstacles = [Obstacle(distance_m=max(distance, 0.0), ned_direction=(1.0, 0.0, 0.0))]
        desk.step()
        assert distance > 0.8
    assert distance < 3.0
    assert _speed(desk) < 0.1


def test_when_accelerations_stop_coming_the_vehicle_brakes_and_hovers():
    desk = Desk().fly().chase((0.0, 0.0, 0.0))
    desk.pursuit = _lean(1.5)
    desk.go(1.5)
    fast = _speed(desk)
    desk.pursuit = None
    desk.go(0.5)
    assert desk.setpoints[-1].ned_a_m_s2 is None
    desk.go(4.0)
    assert fast > 1.5 and _speed(desk) < 0.1


def test_obstacle_data_that_stops_stops_the_vehicle():
    desk = Desk().fly().chase((1.0, 0.0, 0.0))
    desk.obstacles = []
    desk.go(2.0)
    assert desk.vehicle.v[0] > 0.9
    desk.obstacles = None
    desk.go(4.0)
    assert _speed(desk) < 0.05
    assert desk.status and desk.status.limiter_zone == "blind"


def test_a_barrel_that_is_seen_no_more_is_not_flown_into():
    """The depth source dies on approach: its last point stays, and then nothing is free any more."""
    desk = Desk().fly().chase((2.1, 0.0, 0.0))
    ahead = View(
        ned_q_sensor=(0.5, 0.5, 0.5, 0.5),
        half_width_rad=0.7,
        half_height_rad=0.5,
        range_m=8.0,
        columns=1,
        rows=1,
        seen=(True,),
    )
    nearest = 9.0
    for step in range(600):
        nearest = min(nearest, 9.0 - desk.vehicle.p[0])
        if step < 130:
            barrel = Obstacle(distance_m=9.0 - desk.vehicle.p[0], ned_direction=(1.0, 0.0, 0.0))
            desk.feed("obstacles/depth", Obstacles(obstacles=(barrel,), views=(ahead,)))
        desk.step()
    assert desk.vehicle.p[0] > 3.0
    assert nearest > 1.3 and _speed(desk) < 0.05


def test_without_sight_the_height_is_held_against_a_drift_and_no_climb_is_flown():
    desk = Desk().fly()
    desk.obstacles = []
    desk.go(1.0)
    desk.obstacles = None
    desk.go(6.0)
    held_m = desk.vehicle.height_m
    desk.vehicle.p[2] += 0.2
    desk.go(4.0)
    assert desk.status and desk.status.limiter_zone == "blind"
    assert desk.vehicle.height_m == pytest.approx(held_m, abs=0.05)
    desk.operator = Request(frame="heading", vector=(1.0, 0.0, -1.0))
    desk.go(5.0)
    assert desk.vehicle.height_m == pytest.approx(held_m, abs=0.05) and _speed(desk) < 0.05


def test_a_curve_that_would_let_a_fast_vehicle_through_is_refused_at_the_start():
    with pytest.raises(ConfigError, match=r"v_max_m_s: got 2\.5; for an approach at 3 m/s the curve peaks at"):
        Desk(limiter={"v_max_m_s": 2.5})


def test_a_climb_towards_an_obstacle_above_is_limited_too():
    desk = Desk().fly()
    desk.operator = Request(frame="ned", vector=(0.0, 0.0, -1.0))
    for _ in range(600):
        desk.obstacles = [Obstacle(distance_m=max(8.0 - desk.vehicle.height_m, 0.0), ned_direction=(0.0, 0.0, -1.0))]
        desk.step()
    assert desk.vehicle.height_m == pytest.approx(6.5, abs=0.3)


def test_hover_holds_its_place_against_a_push():
    desk = Desk().fly()
    anchor = list(desk.vehicle.p)
    desk.vehicle.p[0] += 1.5
    desk.go(8.0)
    assert desk.vehicle.p[:2] == pytest.approx(anchor[:2], abs=0.2)


def test_the_heading_follows_the_requested_rate_and_is_held():
    desk = Desk().fly()
    desk.operator = Request(frame="ned", vector=(0.0, 0.0, 0.0), yaw_rate_rad_s=0.5)
    desk.go(2.0)
    desk.operator = None
    desk.go(3.0)
    assert desk.vehicle.yaw == pytest.approx(1.0 + 0.5 * 0.3, abs=0.3)
    held = desk.vehicle.yaw
    desk.vehicle.yaw += 0.2
    desk.go(8.0)
    assert desk.vehicle.yaw == pytest.approx(held, abs=0.05)
