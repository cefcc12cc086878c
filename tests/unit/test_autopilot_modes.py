"""Every transition of the autopilot's mode machine, without a vehicle and without a clock."""

from __future__ import annotations

import math

import pytest

from simulation.autopilot.modes import STREAM_SETTLED_S, Mode, ModeMachine, Situation, Verdict
from simulation.autopilot.parameters import Parameters

DT_S = 0.02
NO_STREAM = math.inf


def situation(
    t_s: float = 10.0,
    *,
    ready: bool = True,
    landed: bool = False,
    stream_age_s: float = NO_STREAM,
    takeoff_done: bool = False,
) -> Situation:
    return Situation(t_s, ready, landed, stream_age_s, takeoff_done)


def flying(mode: Mode = Mode.HOLD, **parameters: float) -> ModeMachine:
    """A machine that is armed and in the air."""
    modes = ModeMachine(Parameters(parameters))
    assert modes.arm(situation(9.0, landed=True)) is Verdict.ACCEPTED
    modes.update(situation(9.5))
    assert modes.command(mode, situation(9.9, stream_age_s=0.0)) is Verdict.ACCEPTED
    return modes


def lose_stream(modes: ModeMachine) -> None:
    """Setpoints end at 10 s; until 11.1 s."""
    t_s = 10.0
    while t_s < 11.1:
        modes.update(situation(t_s, stream_age_s=t_s - 10.0))
        t_s += DT_S


def resume_stream(modes: ModeMachine, until_s: float, landed: bool = False) -> None:
    """Setpoints flow from 12 s on."""
    t_s = 12.0
    while t_s < until_s:
        modes.update(situation(t_s, stream_age_s=0.0, landed=landed))
        t_s += DT_S


def test_starts_disarmed_in_hold() -> None:
    modes = ModeMachine(Parameters({}))
    assert (modes.mode, modes.armed, modes.failsafe) == (Mode.HOLD, False, False)
    assert modes.mode.custom_mode == 0x03040000


def test_arming_is_denied_until_ready_unless_forced() -> None:
    modes = ModeMachine(Parameters({}))
    assert modes.arm(situation(1.0, ready=False, landed=True)) is Verdict.TEMPORARILY_REJECTED
    assert not modes.armed
    assert "not ready" in modes.notices[-1][1]
    assert modes.arm(situation(1.0, ready=False, landed=True), force=True) is Verdict.ACCEPTED
    assert modes.armed


@pytest.mark.parametrize("mode", [Mode.LAND, Mode.RETURN])
def test_arming_is_denied_in_modes_that_end_on_the_ground(mode: Mode) -> None:
    modes = ModeMachine(Parameters({}))
    modes.command(mode, situation(landed=True))
    assert modes.arm(situation(landed=True)) is Verdict.TEMPORARILY_REJECTED
    modes.command(Mode.HOLD, situation(landed=True))
    assert modes.arm(situation(landed=True)) is Verdict.ACCEPTED


def test_takeoff_ends_in_hold() -> None:
    modes = flying(Mode.TAKEOFF)
    modes.update(situation(11.0))
    assert modes.mode is Mode.TAKEOFF
    modes.update(situation(12.0, takeoff_done=True))
    assert modes.mode is Mode.HOLD
    assert modes.intended is Mode.HOLD


def test_disarming_is_refused_in_the_air_unless_forced() -> None:
    modes = flying()
    assert modes.disarm(situation()) is Verdict.TEMPORARILY_REJECTED
    assert modes.armed
    assert modes.disarm(situation(), force=True) is Verdict.ACCEPTED
    assert not modes.armed


def test_landing_disarms_after_two_seconds() -> None:
    modes = flying(Mode.LAND)
    modes.update(situation(20.0, landed=True))
    modes.update(situation(21.9, landed=True))
    assert modes.armed
    modes.update(situation(22.1, landed=True))
    assert not modes.armed
    assert modes.mode is Mode.LAND


def test_armed_without_taking_off_disarms_after_ten_seconds() -> None:
    modes = ModeMachine(Parameters({}))
    modes.arm(situation(10.0, landed=True))
    modes.update(situation(10.0, landed=True))
    modes.update(situation(19.9, landed=True))
    assert modes.armed
    modes.update(situation(20.1, landed=True))
    assert not modes.armed


def test_offboard_is_refused_without_a_stream() -> None:
    modes = flying()
    assert modes.command(Mode.OFFBOARD, situation(stream_age_s=1.5)) is Verdict.TEMPORARILY_REJECTED
    assert modes.mode is Mode.HOLD
    assert modes.command(Mode.OFFBOARD, situation(stream_age_s=0.1)) is Verdict.ACCEPTED
    assert modes.mode is Mode.OFFBOARD


@pytest.mark.parametrize(("action", "mode"), [(0, Mode.RETURN), (3, Mode.RETURN), (4, Mode.LAND), (5, Mode.HOLD)])
def test_stream_loss_acts_after_com_of_loss_t(action: int, mode: Mode) -> None:
    modes = flying(Mode.OFFBOARD, COM_OBL_RC_ACT=action)
    modes.update(situation(10.99, stream_age_s=0.99))
    assert modes.mode is Mode.OFFBOARD and not modes.failsafe
    modes.update(situation(11.01, stream_age_s=1.01))
    assert modes.mode is mode
    assert modes.failsafe
    assert modes.intended is Mode.OFFBOARD


@pytest.mark.parametrize("action", [0, 4, 5])
def test_offboard_is_re_entered_by_itself_when_the_stream_resumes(action: int) -> None:
    modes = flying(Mode.OFFBOARD, COM_OBL_RC_ACT=action)
    lose_stream(modes)
    assert modes.failsafe
    resume_stream(modes, 12.0 + STREAM_SETTLED_S / 2)
    assert modes.failsafe
    resume_stream(modes, 12.8)
    assert modes.mode is Mode.OFFBOARD
    assert not modes.failsafe


def test_a_mode_commanded_during_the_failsafe_stays() -> None:
    modes = flying(Mode.OFFBOARD)
    lose_stream(modes)
    assert modes.command(Mode.HOLD, situation(11.5)) is Verdict.ACCEPTED
    resume_stream(modes, 15.0)
    assert modes.mode is Mode.HOLD
    assert not modes.failsafe


def test_hold_commanded_by_a_ground_station_wins_although_the_stream_goes_on() -> None:
    modes = flying(Mode.OFFBOARD)
    modes.command(Mode.HOLD, situation(11.0, stream_age_s=0.0))
    resume_stream(modes, 15.0)
    assert modes.mode is Mode.HOLD


@pytest.mark.parametrize(("rate_hz", "holds"), [(1.1, True), (0.9, False)])
def test_slow_streams_hold_or_flap_as_in_px4(rate_hz: float, holds: bool) -> None:
    modes = flying(Mode.OFFBOARD)
    seen: set[tuple[Mode, bool]] = set()
    last_s = t_s = 10.0
    while t_s < 30.0:
        if t_s - last_s >= 1.0 / rate_hz:
            last_s = t_s
        modes.update(situation(t_s, stream_age_s=t_s - last_s))
        seen.add((modes.mode, modes.failsafe))
        t_s += DT_S
    assert seen == ({(Mode.OFFBOARD, False)} if holds else {(Mode.OFFBOARD, False), (Mode.RETURN, True)})


def test_disarming_in_a_failsafe_ends_it_for_good() -> None:
    modes = flying(Mode.OFFBOARD, COM_OBL_RC_ACT=4)
    lose_stream(modes)
    modes.update(situation(12.0, landed=True))
    modes.update(situation(14.1, landed=True))
    assert not modes.armed
    resume_stream(modes, 20.0, landed=True)
    assert modes.mode is Mode.LAND
    assert not modes.failsafe


def test_losing_the_stream_on_the_ground_falls_back_to_hold() -> None:
    modes = ModeMachine(Parameters({}))
    modes.command(Mode.OFFBOARD, situation(landed=True, stream_age_s=0.0))
    modes.update(situation(12.0, landed=True, stream_age_s=2.0))
    assert modes.mode is Mode.HOLD
    assert not modes.failsafe
