"""The vehicle's states by capture time: between two, a little beyond them, and not at all."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from msgspec import structs

from common.geometry.rotation import as_quat, euler_from_quat, quat_from_euler
from common.header import Header, Received
from common.messages import VehicleState
from ground.pursuit.history import StateHistory
from tests.flying import flying

MS = 1_000_000


def _state(t_ms: float) -> Received[VehicleState]:
    """North at 2 m/s, turning right at 1 rad/s."""
    t_s = t_ms / 1e3
    message = flying(
        ned_p_m=(2.0 * t_s, 0.0, -5.0),
        ned_v_m_s=(2.0, 0.0, 0.0),
        ned_q_body=as_quat(quat_from_euler(0.0, 0.0, t_s)),
        body_rates_rad_s=(0.0, 0.0, 1.0),
    )
    stamp = int(t_ms * MS)
    header = Header(schema=0, source="helm", boot=1, seq=int(t_ms), sent_ns=stamp, capture_ns=stamp)
    return Received(message, header, stamp)


@pytest.fixture
def history() -> StateHistory:
    history = StateHistory(1.5)
    history.extend([_state(t_ms) for t_ms in range(100, 520, 20)])
    return history


@pytest.mark.parametrize("t_ms", [100.0, 113.0, 320.0, 500.0, 620.0, 40.0])
def test_pose_is_where_the_vehicle_was(history: StateHistory, t_ms: float) -> None:
    pose, why_not = history.pose(int(t_ms * MS))
    assert why_not == ""
    assert pose is not None
    assert pose.ned_p_m[0] == pytest.approx(2.0 * t_ms / 1e3, abs=1e-6)
    assert math.remainder(euler_from_quat(pose.ned_q_body)[2] - t_ms / 1e3, 2 * math.pi) == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize(("t_ms", "words"), [(900.0, "0.4 s before the picture"), (-60.0, "older than the oldest")])
def test_far_from_every_state_there_is_no_pose(history: StateHistory, t_ms: float, words: str) -> None:
    pose, why_not = history.pose(int(t_ms * MS))
    assert pose is None
    assert words in why_not


def test_without_states_it_says_what_to_look_at() -> None:
    assert StateHistory(1.5).pose(0) == (None, "no vehicle state; is helm running, and the link up?")


def test_a_state_that_is_not_newer_is_ignored(history: StateHistory) -> None:
    history.extend([_state(300.0)])
    pose, _ = history.pose(500 * MS)
    assert pose is not None
    assert np.isclose(pose.ned_p_m[0], 1.0)


def test_state_that_is_no_number_is_ignored(history: StateHistory) -> None:
    """As if none had come: the pose is carried on for 0.3 s, then there is none, and why."""
    for t_ms in range(520, 900, 20):
        good = _state(t_ms)
        history.extend([replace(good, message=structs.replace(good.message, ned_q_body=(math.nan, 0.0, 0.0, 0.0)))])
    assert np.isfinite(history.pose(620 * MS)[0].ned_q_body).all()  # type: ignore[union-attr]
    pose, why_not = history.pose(880 * MS)
    assert pose is None
    assert why_not == "no vehicle state for 0.4 s before the picture"
