"""How long requests take, by the setpoints that name them."""

from __future__ import annotations

import pytest

from common.header import Header, InputRef, Received
from common.messages import Setpoint
from ground.pursuit.latency import RequestDelay

MS = 1_000_000


def _setpoint(capture_ms: int, at_ms: int, source: str = "pursuit") -> Received[Setpoint]:
    message = Setpoint(
        source=source, asked_ned_v_m_s=(0.0, 0.0, 0.0), ned_v_m_s=(0.0, 0.0, 0.0), height_m=5.0, yaw_rad=0.0
    )
    used = InputRef(f"helm/request/{source}", 1, source, capture_ms * MS, 0, 0)
    header = Header(0, "helm", 1, 1, at_ms * MS, at_ms * MS, (used,))
    return Received(message, header, at_ms * MS)


def test_the_median_of_what_setpoints_say_each_request_once() -> None:
    delay = RequestDelay(0.025)
    assert delay.seconds == 0.025
    delay.extend([_setpoint(0, 60), _setpoint(0, 110), _setpoint(50, 120), _setpoint(100, 350)])
    assert delay.seconds == pytest.approx(0.07)  # the repeated 110 ms counts not at all, the late 250 ms does not rule


def test_an_operator_s_setpoints_say_nothing() -> None:
    delay = RequestDelay(0.025)
    delay.extend([_setpoint(0, 200, "operator")])
    assert delay.seconds == 0.025


def test_a_delay_beyond_belief_is_cut() -> None:
    delay = RequestDelay(0.025)
    delay.extend([_setpoint(0, 2000)])
    assert delay.seconds == 0.3
