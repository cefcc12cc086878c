"""Any path that a scenario may ask for is driven continuously and within its limits."""

from typing import Literal

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from common.config import ConfigError
from simulation.world.path import car_path
from simulation.world.path_config import PathConfig, WaypointConfig
from simulation.world.scenario import CarConfig

_DT_S = 0.02


@st.composite
def paths(draw: st.DrawFn) -> PathConfig:
    mode: Literal["loop", "ping_pong"] = draw(st.sampled_from(["loop", "ping_pong"]))  # type: ignore[assignment]
    waypoints = draw(
        st.lists(
            st.builds(
                WaypointConfig,
                north_m=st.floats(-20, 20),
                east_m=st.floats(-20, 20),
                speed_m_s=st.floats(0.2, 2.5),
                stop_s=st.one_of(st.just(0.0), st.floats(0.5, 4.0)),
            ),
            min_size=3,
            max_size=7,
        )
    )
    path = PathConfig(
        waypoints=tuple(waypoints),
        mode=mode,
        turn_radius_m=draw(st.floats(0.3, 3.0)),
        acceleration_m_s2=draw(st.floats(0.3, 1.5)),
        lateral_acceleration_m_s2=draw(st.floats(0.3, 1.5)),
        turn_rate_rad_s=draw(st.floats(0.3, 1.5)),
        speed_scale=draw(st.floats(0.5, 2.0)),
        start_delay_s=draw(st.floats(0.0, 5.0)),
    )
    try:
        path.check()
    except ConfigError:
        assume(False)
    return path


@settings(max_examples=60, deadline=None)
@given(paths(), st.floats(0.0, 500.0))
def test_motion_is_continuous_and_within_its_limits(path: PathConfig, from_s: float) -> None:
    times = from_s + np.arange(0.0, 30.0, _DT_S)
    motion = car_path(CarConfig(path=path)).at(times)
    speed = np.hypot(*motion.ned_v_m_s.T)
    assert np.isfinite(motion.ned_p_m).all() and np.isfinite(motion.heading_rad).all()
    assert speed.max() <= 2.5 + 1e-9
    # No jump in place: a step is never longer than the top speed allows.
    assert np.hypot(*np.diff(motion.ned_p_m, axis=0).T).max() <= 2.5 * _DT_S + 1e-6
    # The velocity is the derivative of the place (trapezoid; curves leave a second-order rest).
    mean_velocity = (motion.ned_v_m_s[1:] + motion.ned_v_m_s[:-1]) / 2
    assert np.abs(np.diff(motion.ned_p_m, axis=0) / _DT_S - mean_velocity).max() < 0.05
    assert np.abs(np.diff(speed)).max() / _DT_S <= path.acceleration_m_s2 + 1e-3
    turned = np.abs(np.mod(np.diff(motion.heading_rad) + np.pi, 2 * np.pi) - np.pi) / _DT_S
    assert turned.max() <= path.turn_rate_rad_s + 1e-3
    assert (turned * speed[:-1]).max() <= path.lateral_acceleration_m_s2 + 0.05
