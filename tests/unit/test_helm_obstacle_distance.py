"""The obstacle map as OBSTACLE_DISTANCE: closed forms, and that helm sends it when it is told to."""

from __future__ import annotations

import math

import pytest

from common.messages import SECTORS, Obstacle
from onboard.helm.obstacle_distance import obstacle_distance
from tests.unit.helm_double import Desk

FREE_CM, UNKNOWN_CM = 601, 65535


def told(sectors: dict[int, float], heading_deg: float, rest: float = -1.0) -> dict:
    values = [sectors.get(i, rest) for i in range(SECTORS)]
    return obstacle_distance(values, math.radians(heading_deg), 0.2, 6.0, 5)


@pytest.mark.parametrize("heading_deg", [0.0, 2.4, 2.6, 90.0, 181.3, 359.9, -45.0])
def test_a_direction_is_the_same_seen_from_the_vehicle(heading_deg: float) -> None:
    """Of the sector from 45 to 50 degrees east of north."""
    fields = told({9: 3.21}, heading_deg)
    (index,) = (i for i, d in enumerate(fields["distances"]) if d != UNKNOWN_CM)
    from_forward = index * fields["increment_f"] + fields["angle_offset"]
    assert math.remainder(from_forward - (47.5 - heading_deg), 360.0) == pytest.approx(0.0, abs=1e-6)
    assert abs(fields["angle_offset"]) <= 2.5 + 1e-9
    assert fields["distances"][index] == 321


def test_unknown_free_and_what_is_too_near_to_tell() -> None:
    fields = told({0: 0.05, 1: 6.0, 2: 7.9, 3: 5.994}, 0.0)
    assert fields["distances"][:5] == [20, FREE_CM, FREE_CM, 599, UNKNOWN_CM]
    assert len(fields["distances"]) == 72 and fields["increment"] == 5
    assert (fields["min_distance"], fields["max_distance"], fields["frame"]) == (20, 600, 12)
    assert fields["time_usec"] == 5


def test_helm_sends_it_ten_times_a_second_when_it_is_told_to() -> None:
    desk = Desk(obstacle_distance=True)
    desk.vehicle.yaw = math.pi / 2
    desk.obstacles = [Obstacle(distance_m=2.0, ned_direction=(0.0, 1.0, 0.0))]  # east: straight ahead
    desk.go(2.0)
    messages = [fields for name, fields in desk.vehicle.told if name == "OBSTACLE_DISTANCE"]
    assert 18 <= len(messages) <= 21
    (near,) = (index for index, d in enumerate(messages[-1]["distances"]) if d == 200)
    assert abs(math.remainder(5.0 * near + messages[-1]["angle_offset"], 360.0)) <= 2.5 + 1e-6


def test_helm_keeps_it_to_itself_otherwise() -> None:
    desk = Desk()
    desk.go(1.0)
    assert not desk.vehicle.told
