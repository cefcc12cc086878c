"""The simulated vehicle as a whole, in simulated time: flights, failures, determinism."""

from __future__ import annotations

import math

import pytest

from simulation.autopilot.config import AutopilotSimConfig
from simulation.autopilot.control import NAN, MotionSetpoint
from simulation.autopilot.modes import Mode, Verdict
from simulation.autopilot.vehicle import SimulatedVehicle

STREAM = MotionSetpoint(ned_p_m=(NAN, NAN, -5.0), ned_v_m_s=(2.0, 0.0, NAN), yaw_rad=0.0)


def run(vehicle: SimulatedVehicle, duration_s: float, setpoint: MotionSetpoint | None = None) -> None:
    for _ in range(round(duration_s / vehicle.dt_s)):
        if setpoint is not None:
            vehicle.take_setpoint(setpoint)
        vehicle.step()


def airborne(**changes: object) -> SimulatedVehicle:
    """A vehicle in HOLD at 2.5 m."""
    vehicle = SimulatedVehicle(AutopilotSimConfig(**changes))  # type: ignore[arg-type]
    run(vehicle, 4.6)
    vehicle.arm()
    vehicle.command(Mode.TAKEOFF)
    run(vehicle, 8.0)
    assert vehicle.modes.mode is Mode.HOLD and not vehicle.landed
    return vehicle


def height_m(vehicle: SimulatedVehicle) -> float:
    return -vehicle.truth.ned_p_m[2]


def test_nothing_moves_before_the_command() -> None:
    vehicle = SimulatedVehicle(AutopilotSimConfig(wind_ned_m_s=(5.0, 0.0, 0.0)))
    assert vehicle.arm() is Verdict.TEMPORARILY_REJECTED
    run(vehicle, 5.0)
    assert vehicle.arm() is Verdict.ACCEPTED
    run(vehicle, 5.0)
    assert vehicle.truth.on_ground and vehicle.truth.ned_p_m == pytest.approx((0.0, 0.0, 0.0), abs=0.05)


@pytest.mark.parametrize("start_yaw_rad", [0.0, 2.0])
def test_takeoff_reaches_its_height_and_holds_its_place_and_heading(start_yaw_rad: float) -> None:
    vehicle = airborne(start_yaw_rad=start_yaw_rad)
    run(vehicle, 10.0)
    assert height_m(vehicle) == pytest.approx(2.5, abs=0.3)
    assert math.hypot(*vehicle.truth.ned_p_m[:2]) < 0.4
    w, _, _, z = vehicle.truth.ned_q_body
    assert 2.0 * math.atan2(z, w) == pytest.approx(start_yaw_rad, abs=0.05)


def test_a_failed_takeoff_stays_down_and_a_second_command_may_climb() -> None:
    vehicle = SimulatedVehicle(AutopilotSimConfig(takeoff_failure_probability=0.5, seed=3))
    run(vehicle, 4.6)
    climbed: list[bool] = []
    for _ in range(8):
        assert vehicle.arm() is Verdict.ACCEPTED
        assert vehicle.command(Mode.TAKEOFF) is Verdict.ACCEPTED
        run(vehicle, 6.0)
        climbed.append(height_m(vehicle) > 1.0)
        vehicle.command(Mode.LAND)
        run(vehicle, 14.0)
        assert not vehicle.modes.armed
        vehicle.command(Mode.HOLD)
    assert True in climbed and False in climbed


def test_lost_stream_returns_home_over_the_return_height_and_lands() -> None:
    vehicle = airborne(parameters={"RTL_RETURN_ALT": 8.0})
    vehicle.take_setpoint(STREAM)
    assert vehicle.command(Mode.OFFBOARD) is Verdict.ACCEPTED
    run(vehicle, 8.0, STREAM)
    assert vehicle.truth.ned_p_m[0] > 10.0
    run(vehicle, 0.9)
    assert vehicle.modes.mode is Mode.OFFBOARD and vehicle.truth.ned_v_m_s[0] == pytest.approx(2.0, abs=0.25)
    run(vehicle, 0.2)
    assert vehicle.modes.mode is Mode.RETURN
    top_m = 0.0
    for _ in range(45):
        run(vehicle, 1.0)
        top_m = max(top_m, height_m(vehicle))
    assert top_m == pytest.approx(8.0, abs=0.7)
    assert not vehicle.modes.armed and vehicle.truth.on_ground
    assert math.hypot(*vehicle.truth.ned_p_m[:2]) < 0.5


def test_hold_brakes_and_stays() -> None:
    vehicle = airborne()
    vehicle.take_setpoint(STREAM)
    vehicle.command(Mode.OFFBOARD)
    run(vehicle, 5.0, STREAM)
    start_m = vehicle.truth.ned_p_m[0]
    vehicle.command(Mode.HOLD)
    run(vehicle, 5.0, STREAM)
    assert 0.5 < vehicle.truth.ned_p_m[0] - start_m < 3.5
    held_m = vehicle.truth.ned_p_m[0]
    run(vehicle, 5.0, STREAM)
    assert vehicle.truth.ned_p_m[0] == pytest.approx(held_m, abs=0.3)


def test_hold_stays_in_gusty_wind() -> None:
    vehicle = airborne(wind_ned_m_s=(3.0, 2.0, 0.0), gust_std_m_s=1.0)
    before = vehicle.truth.ned_p_m
    run(vehicle, 20.0)
    assert math.dist(vehicle.truth.ned_p_m, before) < 0.8


def test_a_stream_lifts_it_off_in_offboard() -> None:
    vehicle = SimulatedVehicle(AutopilotSimConfig())
    up = MotionSetpoint(ned_p_m=(0.0, 0.0, -2.0), yaw_rad=0.0)
    run(vehicle, 5.0, up)
    assert vehicle.command(Mode.OFFBOARD) is Verdict.ACCEPTED
    assert vehicle.arm() is Verdict.ACCEPTED
    run(vehicle, 9.0, up)
    assert height_m(vehicle) == pytest.approx(2.0, abs=0.3)


def test_a_setpoint_of_an_earlier_stream_is_never_flown_again() -> None:
    vehicle = airborne()
    vehicle.take_setpoint(STREAM)
    vehicle.command(Mode.OFFBOARD)
    run(vehicle, 2.0, STREAM)
    vehicle.command(Mode.HOLD)
    run(vehicle, 5.0)
    vehicle.take_setpoint(MotionSetpoint(ned_p_m=(NAN, NAN, -2.5), ned_v_m_s=(0.0, 0.0, NAN)))
    vehicle.command(Mode.OFFBOARD)
    vehicle.step()
    assert vehicle.setpoint.ned_v_m_s[0] == 0.0


def test_forced_disarming_in_the_air_falls() -> None:
    vehicle = airborne()
    assert vehicle.disarm() is Verdict.TEMPORARILY_REJECTED
    assert vehicle.disarm(force=True) is Verdict.ACCEPTED
    run(vehicle, 3.0)
    assert vehicle.truth.on_ground and vehicle.landed


def test_the_battery_drains_faster_in_flight() -> None:
    vehicle = airborne()
    before = vehicle.battery.fraction
    run(vehicle, 10.0)
    used_wh = (before - vehicle.battery.fraction) * vehicle.config.battery_wh
    assert used_wh == pytest.approx(155.0 * 10.0 / 3600.0, rel=0.1)
    assert 14.0 < vehicle.battery.voltage_v < 16.8


def test_the_accelerometer_feels_the_ground_and_the_hover() -> None:
    vehicle = SimulatedVehicle(AutopilotSimConfig())
    run(vehicle, 1.0)
    assert vehicle.body_acceleration() == pytest.approx((0.0, 0.0, -9.80665), abs=1e-3)
    assert airborne().body_acceleration() == pytest.approx((0.0, 0.0, -9.80665), abs=0.6)


def test_a_seed_repeats_a_flight_and_another_does_not() -> None:
    flights = []
    for seed in (1, 1, 2):
        vehicle = airborne(seed=seed, gust_std_m_s=1.0)
        run(vehicle, 3.0)
        flights.append(vehicle.truth)
    assert flights[0] == flights[1]
    assert flights[0] != flights[2]


def test_a_parameter_set_in_flight_acts() -> None:
    vehicle = airborne()
    vehicle.parameters.set("MPC_XY_VEL_MAX", 1.0)
    vehicle.take_setpoint(STREAM)
    vehicle.command(Mode.OFFBOARD)
    run(vehicle, 6.0, STREAM)
    assert vehicle.truth.ned_v_m_s[0] == pytest.approx(1.0, abs=0.2)
    with pytest.raises(ValueError, match="expected a finite number"):
        vehicle.parameters.set("MPC_XY_VEL_MAX", math.nan)
