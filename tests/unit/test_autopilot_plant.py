"""The equations of motion of the simulated multirotor (Al-Kaff 2019, eqs 8-18), against physics."""

from __future__ import annotations

import math

import pytest

from simulation.autopilot import plant
from simulation.autopilot.plant import GRAVITY_M_S2, Airframe, PlantState, Quat, Vec3

DT_S = 0.004
STILL = (0.0, 0.0, 0.0)
OFF = (0.0, 0.0, 0.0, 0.0)
HIGH = PlantState(ned_p_m=(0.0, 0.0, -500.0), on_ground=False)


def fly(
    airframe: Airframe, state: PlantState, rotors: plant.Rotors, duration_s: float, wind_m_s: Vec3 = STILL
) -> PlantState:
    for _ in range(round(duration_s / DT_S)):
        state = plant.step(airframe, state, rotors, DT_S, wind_m_s)
    return state


def hover_speed(airframe: Airframe) -> float:
    return math.sqrt(airframe.mass_kg * GRAVITY_M_S2 / 4.0 / airframe.thrust_n_s2)


def all_four(speed: float) -> plant.Rotors:
    return speed, speed, speed, speed


def quat_from_euler(roll: float, pitch: float, yaw: float) -> Quat:
    cr, sr, cp, sp = math.cos(roll / 2), math.sin(roll / 2), math.cos(pitch / 2), math.sin(pitch / 2)
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def test_free_fall_without_drag() -> None:
    end = fly(Airframe(drag_n_s_m=0.0), HIGH, OFF, 2.0)
    assert end.ned_v_m_s == pytest.approx((0.0, 0.0, 2.0 * GRAVITY_M_S2))
    assert end.ned_p_m[2] == pytest.approx(-500.0 + 0.5 * GRAVITY_M_S2 * 4.0)


def test_free_fall_ends_at_the_terminal_velocity_of_eq_16() -> None:
    end = fly(Airframe(drag_n_s_m=1.0, mass_kg=1.5), HIGH, OFF, 20.0)
    assert end.ned_v_m_s[2] == pytest.approx(1.5 * GRAVITY_M_S2, rel=1e-4)


def test_hover_is_an_equilibrium() -> None:
    airframe = Airframe()
    speed = hover_speed(airframe)
    end = fly(airframe, HIGH._replace(rotors_rad_s=(speed, speed, speed, speed)), (speed, speed, speed, speed), 10.0)
    assert end.ned_p_m == pytest.approx(HIGH.ned_p_m, abs=1e-6)
    assert end.ned_v_m_s == pytest.approx(STILL, abs=1e-9)
    assert end.body_rates_rad_s == pytest.approx(STILL, abs=1e-12)


def test_hover_takes_half_of_the_thrust_as_in_px4() -> None:
    airframe = Airframe()
    assert (hover_speed(airframe) / airframe.rotor_max_rad_s) ** 2 == pytest.approx(0.495, abs=0.01)


def test_drag_acts_relative_to_the_air() -> None:
    airframe = Airframe(drag_n_s_m=0.5)
    speed = hover_speed(airframe)
    end = fly(
        airframe,
        HIGH._replace(rotors_rad_s=(speed, speed, speed, speed)),
        (speed, speed, speed, speed),
        20.0,
        (3.0, -2.0, 0.0),
    )
    assert end.ned_v_m_s == pytest.approx((3.0, -2.0, 0.0), abs=1e-3)


def test_angular_momentum_is_conserved_without_torque() -> None:
    """Eq. 18 with the cross product: a tumbling body keeps I ω in the world."""
    airframe = Airframe(inertia_kg_m2=(0.01, 0.02, 0.035))

    def momentum(state: PlantState) -> Vec3:
        w, x, y, z = state.ned_q_body
        a, b, c = (i * r for i, r in zip(airframe.inertia_kg_m2, state.body_rates_rad_s, strict=True))
        return (
            (1 - 2 * (y * y + z * z)) * a + 2 * (x * y - w * z) * b + 2 * (x * z + w * y) * c,
            2 * (x * y + w * z) * a + (1 - 2 * (x * x + z * z)) * b + 2 * (y * z - w * x) * c,
            2 * (x * z - w * y) * a + 2 * (y * z + w * x) * b + (1 - 2 * (x * x + y * y)) * c,
        )

    start = HIGH._replace(body_rates_rad_s=(0.3, 4.0, 0.2))
    end = fly(airframe, start, OFF, 5.0)
    size = math.hypot(*momentum(start))
    assert math.dist(momentum(end), momentum(start)) < 0.02 * size
    assert math.dist(end.body_rates_rad_s, start.body_rates_rad_s) > 0.1, "the intermediate axis is unstable"


@pytest.mark.parametrize(("rotor", "axis", "sign"), [(0, 0, 1), (2, 0, -1), (1, 1, 1), (3, 1, -1)])
def test_torques_of_eq_15(rotor: int, axis: int, sign: int) -> None:
    airframe = Airframe()
    rotors = [400.0] * 4
    rotors[rotor] = 500.0
    thrust_n, torque = plant.wrench(airframe, (rotors[0], rotors[1], rotors[2], rotors[3]))
    gain = airframe.thrust_n_s2 * (500.0**2 - 400.0**2)
    assert torque[axis] == pytest.approx(sign * airframe.arm_m * gain)
    assert torque[1 - axis] == pytest.approx(0.0)
    yaw = 1.0 if rotor in (0, 2) else -1.0
    assert torque[2] == pytest.approx(yaw * airframe.torque_n_m_s2 * (500.0**2 - 400.0**2))
    assert thrust_n == pytest.approx(airframe.thrust_n_s2 * (3 * 400.0**2 + 500.0**2))


def test_down_axis_is_the_third_column_of_eq_8() -> None:
    roll, pitch, yaw = 0.3, -0.4, 1.1
    c, s = math.cos, math.sin
    expected = (
        c(roll) * s(pitch) * c(yaw) + s(roll) * s(yaw),
        c(roll) * s(pitch) * s(yaw) - s(roll) * c(yaw),
        c(roll) * c(pitch),
    )
    assert plant.down_axis(quat_from_euler(roll, pitch, yaw)) == pytest.approx(expected)


def test_rotors_lag() -> None:
    airframe = Airframe()
    end = fly(airframe, HIGH, (500.0, 500.0, 500.0, 500.0), airframe.rotor_lag_s)
    steps = round(airframe.rotor_lag_s / DT_S)
    assert end.rotors_rad_s[0] == pytest.approx(500.0 * (1.0 - math.exp(-steps * DT_S / airframe.rotor_lag_s)))


def test_the_ground_stops_and_levels_a_falling_body() -> None:
    tilted = PlantState((0.0, 0.0, -2.0), (1.0, 0.0, 0.0), quat_from_euler(0.3, 0.1, 0.8), on_ground=False)
    end = fly(Airframe(), tilted, OFF, 3.0)
    assert end.on_ground and end.ned_p_m[2] == 0.0
    assert end.ned_v_m_s == STILL
    assert plant.down_axis(end.ned_q_body)[2] == pytest.approx(1.0, abs=1e-6)
    w, _, _, z = end.ned_q_body
    assert 2.0 * math.atan2(z, w) == pytest.approx(0.8, abs=0.1)
    assert end.ned_a_m_s2 == pytest.approx(STILL)


def test_a_resting_body_lifts_off_with_enough_thrust() -> None:
    airframe = Airframe()
    speed = 1.1 * hover_speed(airframe)
    end = fly(airframe, PlantState(), (speed, speed, speed, speed), 1.0)
    assert not end.on_ground and end.ned_p_m[2] < -0.3
