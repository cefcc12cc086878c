"""What the chase benchmark draws from its seed, and the simple tracker that it compares with."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from benchmarks.camshift import CamShiftTracker
from benchmarks.chase import drawn
from simulation.world.path import car_path
from simulation.world.scenario import load_scenario

BASE = load_scenario("chase")


@pytest.mark.parametrize("seed", range(40))
def test_every_seed_draws_a_road_that_can_be_driven(seed: int) -> None:
    scenario = drawn(BASE, seed)
    scenario.car.path.check()
    motion = car_path(scenario.car).at(np.linspace(0.0, 120.0, 2401))

    speed = np.linalg.norm(motion.ned_v_m_s, axis=1)
    assert 0.5 < speed.max() <= 1.5 + 1e-6
    assert np.abs(motion.ned_p_m).max() < 16.0
    assert np.hypot(*motion.ned_p_m[0]) < 2.0, "it begins beside home, where the vehicle takes off"
    assert math.dist(motion.ned_p_m.min(axis=0), motion.ned_p_m.max(axis=0)) > 5.0


def test_another_seed_is_another_scene() -> None:
    one, same, other = drawn(BASE, 5), drawn(BASE, 5), drawn(BASE, 6)

    assert one == same
    assert one.car.path != other.car.path and one.car.bonnet != other.car.bonnet
    assert one.occluders != other.occluders and one.car.path != BASE.car.path


def _picture(x: float, y: float, angle_deg: float = 0.0) -> np.ndarray:
    frame = np.full((240, 320, 3), 128, np.uint8)
    corners = cv2.boxPoints(((x, y), (60, 30), angle_deg))
    cv2.fillConvexPoly(frame, corners.round().astype(np.int32), (30, 40, 220))
    return frame


def test_camshift_follows_a_strong_colour() -> None:
    tracker = CamShiftTracker()
    tracker.init(_picture(100, 100), (70, 85, 60, 30), 0.0, 0)
    for step in range(1, 20):
        result = tracker.update(_picture(100 + 4 * step, 100 + 2 * step, 3.0 * step), step)

    assert result.state == "tracking"
    assert result.center_px == pytest.approx((176, 138), abs=3)
    assert math.degrees(result.angle_rad) == pytest.approx(57, abs=8)


def test_camshift_says_when_it_sees_nothing() -> None:
    tracker = CamShiftTracker()
    with pytest.raises(ValueError, match="before init"):
        tracker.update(_picture(100, 100), 1)
    tracker.init(_picture(100, 100), (70, 85, 60, 30), 0.0, 0)
    result = tracker.update(np.full((240, 320, 3), 128, np.uint8), 1)

    assert result.state == "lost" and result.center_px == pytest.approx((100, 100), abs=3)
    with pytest.raises(ValueError, match="expected"):
        tracker.init(_picture(100, 100), (500, 85, 60, 30), 0.0, 0)
