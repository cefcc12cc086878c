"""Properties of the autopilot's modes and failsafes that hold in any sequence of situations and commands."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from simulation.autopilot.flight_modes import Mode, Situation
from simulation.autopilot.modes import ModeMachine
from simulation.autopilot.parameters import Parameters

STEP_S = 0.4
SITUATION = st.builds(
    Situation,
    t_s=st.just(0.0),
    ready=st.just(True),
    landed=st.just(False),
    stream_age_s=st.sampled_from([0.0, 2.0]),
    takeoff_done=st.booleans(),
    position_ok=st.booleans(),
    height_ok=st.booleans(),
    sticks_lost=st.booleans(),
    sticks_moved=st.booleans(),
    throttle=st.just(-1.0),
    link_lost=st.booleans(),
    battery_warning=st.integers(0, 3),
    fence_breached=st.booleans(),
    stream_needs_position=st.booleans(),
)
PARAMETERS = st.fixed_dictionaries(
    {
        "COM_OBL_RC_ACT": st.integers(0, 7),
        "NAV_RCL_ACT": st.integers(0, 6),
        "NAV_DLL_ACT": st.integers(0, 6),
        "GF_ACTION": st.integers(0, 5),
        "COM_LOW_BAT_ACT": st.integers(0, 3),
        "COM_RC_OVERRIDE": st.integers(0, 3),
    }
)


@given(PARAMETERS, st.lists(st.tuples(SITUATION, st.sampled_from([None, *Mode])), min_size=1, max_size=25))
def test_nothing_is_flown_that_cannot_be_flown(
    parameters: dict[str, int], course: list[tuple[Situation, Mode | None]]
) -> None:
    modes = ModeMachine(Parameters(parameters))
    modes.arm(Situation(9.0, True, True, 0.0))
    for index, (situation, mode) in enumerate(course):
        now = situation._replace(t_s=10.0 + STEP_S * index)
        if mode is not None and mode is not Mode.DESCEND:
            modes.command(mode, now)
        modes.update(now)
        if not modes.armed:
            return
        assert now.position_ok or not modes.mode.needs_position
        assert now.height_ok or not modes.mode.needs_height
        assert modes.failsafe or modes.mode is modes.intended
        assert modes.mode is not Mode.OFFBOARD or modes.stream_alive(now)
        if now.sticks_lost and modes.mode.manual:
            assert not modes.failsafe, "a failsafe never gives the vehicle to a pilot who is not there"
