"""The far end of the chase law: a target beyond what the linear gains are for."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from common.geometry.rotation import quat_from_euler
from ground.pursuit.config import PursuitConfig
from ground.pursuit.steering import Steering, brakable
from ground.pursuit.view import Pose

Array = NDArray[np.float64]
STEP_S = 0.01


@given(st.floats(0.0, 20.0), st.floats(-math.pi, math.pi), st.floats(0.5, 3.0), st.floats(0.2, 4.0))
@settings(max_examples=50)
def test_what_may_be_acted_on_points_the_same_way_and_can_be_braked_from(
    distance_m: float, angle_rad: float, closing_1_s: float, brake_m_s2: float
) -> None:
    error_m = distance_m * np.array([math.cos(angle_rad), math.sin(angle_rad)])
    used = brakable(error_m, closing_1_s, brake_m_s2)
    size_m = float(np.linalg.norm(used))

    assert used @ error_m == pytest.approx(size_m * distance_m) and size_m <= distance_m + 1e-9
    assert (closing_1_s * size_m) ** 2 <= 2.0 * brake_m_s2 * distance_m + 1e-9
    further = np.linalg.norm(brakable(error_m * 1.01, closing_1_s, brake_m_s2))
    assert further >= size_m, "further away, no slower"


def test_near_the_target_nothing_changes() -> None:
    error_m = np.array([0.3, -0.4])
    assert brakable(error_m, 1.2, 0.8) is error_m


def _approach(output: Literal["velocity", "orientation"], start_m: float) -> Array:
    """Distances along the way, m, of a vehicle that flies to a parked target: 90 ms of dead time and two lags."""
    steering = Steering(PursuitConfig(output=output))
    position, velocity, tilt, lagged, integral = (np.zeros(2) for _ in range(5))
    requests = [np.zeros(2)] * 12
    along = []
    for index in range(800):
        if index % 5 == 0:
            attitude = quat_from_euler(math.atan(tilt[1] / 9.80665), -math.atan(tilt[0] / 9.80665), 0.0)
            pose = Pose(np.array([*position, -3.0]), np.array([*velocity, 0.0]), attitude)
            t_ns = index * round(STEP_S * 1e9)
            request = steering.follow(np.array([start_m, 0.0]) - position, 0.02, pose, t_ns, 0.0, 2.0)
        requests.append(request)
        wanted = requests.pop(0)
        if output == "velocity":
            integral = integral + 0.4 * (wanted - velocity) * STEP_S
            wanted = 1.8 * (wanted - velocity) + integral - 0.2 * tilt
        lagged = lagged + (wanted - lagged) * STEP_S / 0.1
        tilt = tilt + (lagged - tilt) * STEP_S / 0.1
        velocity = velocity + tilt * STEP_S
        position = position + velocity * STEP_S
        along.append(start_m - position[0])
    return np.array(along)


@pytest.mark.parametrize("output", ["velocity", "orientation"])
def test_a_far_target_is_reached_and_hardly_flown_past(output: Literal["velocity", "orientation"]) -> None:
    left_m = _approach(output, 4.0)

    assert np.abs(left_m[500:]).max() < 0.3, "within 5 s"
    assert left_m.min() > -0.3
