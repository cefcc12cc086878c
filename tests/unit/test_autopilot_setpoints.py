"""Attitude, body rates and thrust in OFFBOARD, over MAVLink."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import pytest

from simulation.autopilot.motion import heading
from tests.unit.autopilot_rig import Rig

HOVER = 0.495
NO_RATES, NO_ATTITUDE, NO_THRUST = 7, 128, 64


def quiet_rig(**changes: object) -> Rig:
    """A rig without noise, at 8 m."""
    names = ("position_noise_m", "velocity_noise_m_s", "climb_noise_m_s", "attitude_noise_rad")
    rig = Rig(drag_n_s_m=1.0, parameters={"MIS_TAKEOFF_ALT": 8.0}, **dict.fromkeys(names, 0.0), **changes)
    rig.take_off()
    rig.run(2.0)
    return rig


@pytest.fixture
def rig() -> Iterator[Rig]:
    rig = quiet_rig()
    yield rig
    rig.close()


def stream(rig: Rig, duration_s: float, send: Callable[[], None]) -> None:
    """Setpoints at 50 Hz."""
    for _ in range(round(duration_s * 50)):
        send()
        rig.run(0.02)


def enter(rig: Rig, send: Callable[[], None]) -> None:
    """OFFBOARD on this stream."""
    stream(rig, 0.2, send)
    rig.companion.command(176, 1.0, 6.0)
    stream(rig, 0.1, send)
    assert rig.companion.acks(176) == [0]


def rolled(roll_rad: float, yaw_rad: float = 0.0) -> tuple[float, float, float, float]:
    r, y = 0.5 * roll_rad, 0.5 * yaw_rad
    return (math.cos(r) * math.cos(y), math.sin(r) * math.cos(y), math.sin(r) * math.sin(y), math.cos(r) * math.sin(y))


def roll_rad(rig: Rig) -> float:
    w, x, y, z = rig.vehicle.truth.ned_q_body
    return math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))


def base_mode(rig: Rig, send: Callable[[], None]) -> int:
    stream(rig, 1.2, send)
    return rig.companion.got("HEARTBEAT")[-1].base_mode


def test_an_attitude_stream_is_enough_to_enter_offboard_and_does_nothing_before(rig: Rig) -> None:
    def climb() -> None:
        rig.companion.attitude(NO_RATES, thrust=0.8)

    before_m = rig.vehicle.truth.ned_p_m[2]
    stream(rig, 1.0, climb)
    assert rig.vehicle.truth.ned_p_m[2] == pytest.approx(before_m, abs=0.1), "ignored outside OFFBOARD"
    rig.companion.command(176, 1.0, 6.0)
    stream(rig, 1.0, climb)
    assert rig.companion.acks(176) == [0]
    assert rig.vehicle.truth.ned_p_m[2] < before_m - 1.0


@pytest.mark.parametrize(("share", "sink_m_s"), [(1.0, 0.0), (0.9, 1.0)])
def test_thrust_is_direct_and_a_hover_takes_0_495(rig: Rig, share: float, sink_m_s: float) -> None:
    enter(rig, lambda: rig.companion.attitude(NO_RATES, thrust=HOVER))
    stream(rig, 1.0, lambda: rig.companion.attitude(NO_RATES, thrust=HOVER))
    before = rig.vehicle.truth.ned_v_m_s[2]
    stream(rig, 2.0, lambda: rig.companion.attitude(NO_RATES, thrust=HOVER * share))
    assert rig.vehicle.truth.ned_v_m_s[2] - before == pytest.approx(sink_m_s, abs=0.2)


def test_roll_and_heading_are_flown_and_the_heartbeat_says_stabilised(rig: Rig) -> None:
    attitude = rolled(math.radians(10.0), math.radians(40.0))
    enter(rig, lambda: rig.companion.attitude(NO_RATES, attitude, thrust=HOVER))
    assert base_mode(rig, lambda: rig.companion.attitude(NO_RATES, attitude, thrust=HOVER)) == 145
    stream(rig, 1.0, lambda: rig.companion.attitude(NO_RATES, attitude, thrust=HOVER))
    assert math.degrees(roll_rad(rig)) == pytest.approx(10.0, abs=0.3)
    assert math.degrees(heading(rig.vehicle.truth.ned_q_body)) == pytest.approx(40.0, abs=1.0)


def test_the_roll_step_matches_px4(rig: Rig) -> None:
    enter(rig, lambda: rig.companion.attitude(NO_RATES, thrust=HOVER))
    stream(rig, 1.0, lambda: rig.companion.attitude(NO_RATES, thrust=HOVER))
    course: list[tuple[float, float]] = [(0.0, roll_rad(rig))]
    target, start_s = math.radians(10.0), rig.t_s
    for index in range(250):
        if index % 5 == 0:
            rig.companion.attitude(NO_RATES, rolled(target), thrust=HOVER)
        rig.run(rig.vehicle.dt_s)
        course.append((rig.t_s - start_s, roll_rad(rig)))
    for share, expected_s in {0.10: 0.14, 0.50: 0.25, 0.63: 0.29, 0.90: 0.46}.items():
        found_s = next(t for t, roll in course if roll >= share * target)
        assert found_s == pytest.approx(expected_s, rel=0.10), f"t{share:.0%}"
    assert max(roll for _, roll in course) / target < 1.05  # PX4 overshoots by 3 %, this loop does not


def test_body_rates_are_flown_and_the_heartbeat_says_129(rig: Rig) -> None:
    def turn() -> None:
        rig.companion.attitude(NO_ATTITUDE, body_yaw_rate=0.4, thrust=HOVER)

    enter(rig, turn)
    assert base_mode(rig, turn) == 129
    assert rig.vehicle.truth.body_rates_rad_s[2] == pytest.approx(0.4, abs=0.02)
    target = rig.companion.got("ATTITUDE_TARGET")[-1]
    assert target.body_yaw_rate == pytest.approx(0.4, abs=1e-3) and target.thrust == pytest.approx(HOVER, abs=1e-3)


def test_the_third_rate_beside_an_attitude_leads_the_heading(rig: Rig) -> None:
    enter(rig, lambda: rig.companion.attitude(3, thrust=HOVER, body_yaw_rate=0.3))
    stream(rig, 3.0, lambda: rig.companion.attitude(3, thrust=HOVER, body_yaw_rate=0.3))
    assert heading(rig.vehicle.truth.ned_q_body) == pytest.approx(0.3 / 2.1, abs=0.02)


def test_alternating_attitude_and_velocity_fly_a_mix(rig: Rig) -> None:
    ground_speeds = []
    for kinds in (("velocity",), ("velocity", "attitude")):
        for index in range(150):
            if kinds[index % len(kinds)] == "velocity":
                rig.companion.setpoint(0x5E3, vx=2.0, z=-8.0)
            else:
                rig.companion.attitude(NO_RATES, thrust=HOVER)
            if index == 5:
                rig.companion.command(176, 1.0, 6.0)
            rig.run(0.02)
        ground_speeds.append(rig.vehicle.truth.ned_v_m_s[0])
        rig.companion.command(176, 1.0, 4.0, 3.0)
        rig.run(3.0)
    assert 0.2 < ground_speeds[1] < 0.8 * ground_speeds[0]


def test_a_motion_setpoint_after_an_attitude_climbs_at_once(rig: Rig) -> None:
    enter(rig, lambda: rig.companion.attitude(NO_RATES, thrust=HOVER))
    stream(rig, 0.6, lambda: rig.companion.setpoint(0x9C7, vz=-1.0))
    assert rig.vehicle.truth.ned_v_m_s[2] == pytest.approx(-1.1, abs=0.25)


def test_silence_after_an_attitude_stream_is_a_loss_like_any_other(rig: Rig) -> None:
    enter(rig, lambda: rig.companion.attitude(NO_RATES, thrust=HOVER))
    rig.run(0.9)
    assert rig.vehicle.modes.mode.name == "OFFBOARD"
    rig.run(0.2)
    assert rig.vehicle.modes.mode.name == "RETURN" and rig.vehicle.modes.failsafe


@pytest.mark.parametrize(
    ("mask", "q", "fields", "reason"),
    [
        (NO_RATES | NO_THRUST, (1.0, 0.0, 0.0, 0.0), {}, "incomplete"),
        (NO_RATES | NO_ATTITUDE, (1.0, 0.0, 0.0, 0.0), {"thrust": 0.5}, "incomplete"),
        (NO_RATES, (0.0, 0.0, 0.0, 0.0), {"thrust": 0.5}, "no_rotation"),
        (NO_RATES, (math.nan, 0.0, 0.0, 0.0), {"thrust": 0.5}, "infinite"),
        (NO_ATTITUDE, (1.0, 0.0, 0.0, 0.0), {"thrust": math.inf}, "infinite"),
    ],
)
def test_bad_attitude_setpoints_are_counted_and_are_no_stream(
    mask: int, q: tuple[float, ...], fields: dict[str, float], reason: str
) -> None:
    rig = Rig()
    try:
        rig.run(1.0)
        rig.companion.attitude(mask, q, **fields)
        rig.run(0.02)
        assert rig.autopilot.protocol.counters[f"setpoints_{reason}"] == 1
        assert rig.vehicle.situation.stream_age_s == math.inf
    finally:
        rig.close()
