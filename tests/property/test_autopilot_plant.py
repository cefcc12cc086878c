"""Properties of the plant, the mixer and the wire formats that hold for any input."""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simulation.autopilot import plant
from simulation.autopilot.parameters import TYPE_INT32, TYPE_REAL32, from_wire, to_wire
from simulation.autopilot.plant import Airframe, PlantState

AIRFRAME = Airframe()
SPEED = st.floats(0.0, AIRFRAME.rotor_max_rad_s)
TORQUE = st.floats(-5.0, 5.0)
RATE = st.floats(-10.0, 10.0)
COMMAND = st.floats(-1e4, 1e4)


@given(st.tuples(SPEED, SPEED, SPEED, SPEED))
def test_mixing_inverts_the_wrench(rotors: plant.Rotors) -> None:
    thrust_n, torque = plant.wrench(AIRFRAME, rotors)
    again = plant.mix(AIRFRAME, thrust_n, torque)
    reachable = plant.wrench(AIRFRAME, again)
    # A plus frame couples yaw with roll and pitch at its limits, where the mixer gives up yaw first.
    roll_pitch = max(abs(torque[0]), abs(torque[1])) / (2.0 * AIRFRAME.arm_m * AIRFRAME.thrust_n_s2)
    mean = thrust_n / (4.0 * AIRFRAME.thrust_n_s2)
    room = min(mean, AIRFRAME.rotor_max_rad_s**2 - mean)
    if roll_pitch + abs(torque[2]) / (4.0 * AIRFRAME.torque_n_m_s2) <= room:
        assert again == pytest.approx(rotors, abs=1e-3)
    assert reachable[0] == pytest.approx(thrust_n, abs=1e-6)


@given(st.floats(-10.0, 40.0), st.tuples(TORQUE, TORQUE, TORQUE))
def test_mixing_stays_within_the_rotors_and_keeps_the_torque_direction(thrust_n: float, torque: plant.Vec3) -> None:
    rotors = plant.mix(AIRFRAME, thrust_n, torque)
    assert all(0.0 <= r <= AIRFRAME.rotor_max_rad_s for r in rotors)
    given_n, given_torque = plant.wrench(AIRFRAME, rotors)
    assert given_n == pytest.approx(min(max(thrust_n, 0.0), 20.0), abs=1e-6)
    for axis in range(3):
        assert abs(given_torque[axis]) <= abs(torque[axis]) + 1e-9
        assert given_torque[axis] * torque[axis] >= -1e-9


@given(
    st.tuples(RATE, RATE, RATE), st.tuples(COMMAND, COMMAND, COMMAND, COMMAND), st.tuples(*[st.floats(-20.0, 20.0)] * 3)
)
def test_a_step_keeps_the_quaternion_unit_and_never_sinks_into_the_ground(
    rates: plant.Vec3, commands: plant.Rotors, wind: plant.Vec3
) -> None:
    state = PlantState(ned_p_m=(0.0, 0.0, -0.2), body_rates_rad_s=rates, on_ground=False)
    for _ in range(100):
        state = plant.step(AIRFRAME, state, commands, 0.004, wind)
        assert math.sqrt(sum(c * c for c in state.ned_q_body)) == pytest.approx(1.0, abs=1e-9)
        assert state.ned_p_m[2] <= 0.0
        assert all(0.0 <= r <= AIRFRAME.rotor_max_rad_s for r in state.rotors_rad_s)
        assert all(math.isfinite(v) for v in (*state.ned_p_m, *state.ned_v_m_s, *state.body_rates_rad_s))


@given(st.integers(-(2**22), 2**31 - 1 - 2**23))
def test_whole_numbers_survive_the_wire(value: int) -> None:
    packed = struct.unpack("<f", struct.pack("<f", to_wire(value)))[0]
    if not math.isnan(packed):  # a NaN pattern may come back as a quiet NaN
        assert from_wire(packed, TYPE_INT32) == value


@given(st.floats(width=32, allow_nan=False, allow_infinity=False))
def test_floats_survive_the_wire(value: float) -> None:
    assert from_wire(to_wire(value), TYPE_REAL32) == value
