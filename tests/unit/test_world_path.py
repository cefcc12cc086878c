"""The way of a car."""

import numpy as np
import pytest

from simulation.world.path import car_path
from simulation.world.path_config import PathConfig, WaypointConfig
from simulation.world.scenario import CarConfig


def waypoint(north_m: float, east_m: float, speed_m_s: float = 1.0, stop_s: float = 0.0) -> WaypointConfig:
    return WaypointConfig(north_m=north_m, east_m=east_m, speed_m_s=speed_m_s, stop_s=stop_s)


SQUARE = (waypoint(0, 0), waypoint(0, 6), waypoint(6, 6), waypoint(6, 0))


def test_a_parked_car_stays_where_it_is_put() -> None:
    motion = car_path(CarConfig(north_m=3.0, east_m=-2.0, heading_deg=90.0)).at([-1.0, 0.0, 1e6])
    np.testing.assert_allclose(motion.ned_p_m, [(3.0, -2.0)] * 3)
    np.testing.assert_allclose(motion.heading_rad, np.pi / 2)
    assert not motion.ned_v_m_s.any()


def test_it_waits_for_its_delay_and_starts_gently() -> None:
    path = car_path(CarConfig(path=PathConfig(waypoints=SQUARE, start_delay_s=5.0, acceleration_m_s2=0.5)))
    motion = path.at([0.0, 4.99, 6.0])
    np.testing.assert_allclose(motion.ned_p_m[0], motion.ned_p_m[1])
    # v = a t after one second at 0.5 m/s²
    assert np.hypot(*motion.ned_v_m_s[2]) == pytest.approx(0.5, abs=0.02)


def test_a_loop_rounds_its_corners_with_the_radius_asked_for() -> None:
    path = car_path(CarConfig(path=PathConfig(waypoints=SQUARE, turn_radius_m=1.5)))
    points = path.polyline(0.01)
    # Four quarter circles instead of four corners.
    assert path.line.s_m[-1] == pytest.approx(24 - 8 * 1.5 + 2 * np.pi * 1.5)
    np.testing.assert_allclose(points[0], points[-1], atol=1e-9)
    # The nearest point to a corner of a rounded square: r (√2 - 1).
    assert np.hypot(*(points - (0.0, 6.0)).T).min() == pytest.approx(1.5 * (2**0.5 - 1), abs=0.01)


def test_a_loop_repeats_for_ever_at_the_same_pace() -> None:
    path = car_path(CarConfig(path=PathConfig(waypoints=SQUARE)))
    lap_s = path.t_s[-1] - path.t_s[path.lap_from]
    late = path.t_s[-1] + 37.0 + lap_s * np.arange(4)
    motion = path.at(late)
    np.testing.assert_allclose(motion.ned_p_m, motion.ned_p_m[[0] * 4], atol=1e-6)


def test_it_stops_where_and_as_long_as_it_should() -> None:
    waypoints = (waypoint(0, 0), waypoint(0, 3, stop_s=4.0), waypoint(0, 6), waypoint(6, 3))
    path = car_path(CarConfig(path=PathConfig(waypoints=waypoints)))
    times = np.arange(0.0, 20.0, 0.01)
    motion = path.at(times)
    still = (np.hypot(*motion.ned_v_m_s.T) < 1e-6) & (times > 1.0)
    assert still.sum() * 0.01 == pytest.approx(4.0, abs=0.05)
    np.testing.assert_allclose(motion.ned_p_m[still], [(0.0, 3.0)] * still.sum(), atol=1e-6)


def test_ping_pong_comes_back_in_reverse() -> None:
    waypoints = (waypoint(0, 0), waypoint(5, 0, stop_s=2.0))
    path = car_path(CarConfig(path=PathConfig(mode="ping_pong", waypoints=waypoints)))
    motion = path.at(np.arange(0.0, 3 * path.t_s[-1], 0.01))
    north, east = motion.ned_p_m.T
    assert north.max() == pytest.approx(5.0, abs=1e-6) and north[-300:].min() < 4.0
    assert np.abs(east).max() < 1e-9
    assert (motion.heading_rad == motion.heading_rad[0]).all()
    assert motion.ned_v_m_s[:, 0].min() < -0.9
    at_the_end = np.isclose(north, 5.0, atol=1e-6)
    assert at_the_end.sum() * 0.01 / 3 == pytest.approx(2.0, abs=0.1)


def test_curves_are_driven_slower_than_straights() -> None:
    fast = tuple(waypoint(w.north_m, w.east_m, 1.5) for w in SQUARE)
    path = car_path(
        CarConfig(
            path=PathConfig(waypoints=fast, turn_radius_m=0.6, lateral_acceleration_m_s2=0.6, turn_rate_rad_s=0.9)
        )
    )
    motion = path.at(np.arange(30.0, 60.0, 0.01))
    speed = np.hypot(*motion.ned_v_m_s.T)
    rate = np.abs(np.diff(np.unwrap(motion.heading_rad))) / 0.01
    assert speed.max() == pytest.approx(1.5, abs=0.01)
    assert rate.max() <= 0.9 + 1e-6
    # v² / r at the tightest place
    assert (speed[:-1] * rate).max() <= 0.6 + 1e-6
