"""The judgement of a chase, and the box that the operator's stand-in draws."""

from __future__ import annotations

import math
from typing import Any

import pytest

from common.codec import schema_hash
from common.header import Header, InputRef, Received
from common.messages import Message, Setpoint, Track
from common.truth import Truth
from simulation.demo.approach import faults as approach_faults
from simulation.demo.mission import box_of_corners
from simulation.demo.report import REQUEST, ChaseRecorder, Criteria
from tests.flying import helm_status

MS = 1_000_000


def _received(message: Message, capture_ns: int, inputs: tuple[InputRef, ...] = (), sent_ns: int = 0) -> Received[Any]:
    return Received(message, Header(schema_hash(type(message)), "x", 1, 0, sent_ns, capture_ns, inputs), capture_ns)


def _truth(north_m: float = 0.0, height_m: float = 5.0, car_heading_rad: float = 0.0, yaw_rad: float = 0.0) -> Truth:
    return Truth(
        ned_p_m=(north_m, 0.0, -height_m),
        ned_v_m_s=(0.0, 0.0, 0.0),
        ned_q_body=(math.cos(yaw_rad / 2), 0.0, 0.0, math.sin(yaw_rad / 2)),
        target_ned_p_m=(0.0, 0.0, 0.0),
        target_ned_v_m_s=(0.0, 0.0, 0.0),
        target_heading_rad=car_heading_rad,
        target_visible=True,
    )


def _chase(states: str, error_m: float = 0.3, height_m: float = 5.0) -> ChaseRecorder:
    """A chase at 10 Hz: `t` tracking, `l` lost."""
    recorder = ChaseRecorder(active=True, selections=1)
    for index, letter in enumerate(states):
        t_ns = index * 100 * MS
        recorder.on_track(_received(Track(state="tracking" if letter == "t" else "lost"), t_ns))
        recorder.on_truth(_received(_truth(error_m, height_m), t_ns))
        recorder.on_status(_received(helm_status("pursuit", source="pursuit"), t_ns))
    return recorder


def test_good_chase_holds() -> None:
    recorder = _chase("t" * 200)
    assert recorder.faults(Criteria()) == []
    assert recorder.summary()["chase_rms_error_m"] == pytest.approx(0.3)


def test_losses_are_counted_and_measured() -> None:
    summary = _chase("tttllltttllllltt").summary()
    assert summary["losses"] == 2
    assert summary["longest_loss_s"] == pytest.approx(0.5)
    assert summary["lost_s"] == pytest.approx(0.8)


def test_loss_at_the_end_counts() -> None:
    recorder = _chase("tttlll")
    assert recorder.current_loss_s() == pytest.approx(0.2)
    assert recorder.summary()["losses"] == 1


@pytest.mark.parametrize(
    ("recorder", "word"),
    [
        (_chase("t" * 50, error_m=2.0), "chase_rms_error_m"),
        (_chase("t" * 100 + "l" * 60), "longest_loss_s"),
        (_chase("tlllt" * 20), "lost"),
        (_chase("t" * 50, height_m=0.5), "height_min_m"),
        (ChaseRecorder(active=True), "sent nothing"),
    ],
)
def test_bad_chase_does_not_hold(recorder: ChaseRecorder, word: str) -> None:
    assert any(word in fault for fault in recorder.faults(Criteria()))


def test_second_selection_and_stray_state_are_faults() -> None:
    recorder = _chase("t" * 50)
    recorder.selections = 2
    recorder.on_status(_received(helm_status("yielded", source="pursuit"), 0))
    text = "; ".join(recorder.faults(Criteria()))
    assert "chosen 2 times" in text
    assert "yielded" in text


def test_latency_is_from_capture_to_sent() -> None:
    recorder = ChaseRecorder(active=True)
    setpoint = Setpoint(
        source="pursuit", asked_ned_v_m_s=(0.0, 0.0, 0.0), ned_v_m_s=(0.0, 0.0, 0.0), height_m=5.0, yaw_rad=0.0
    )
    reference = InputRef(REQUEST, 0, "pursuit", 1000 * MS, 1015 * MS, 1016 * MS)
    recorder.on_setpoint(_received(setpoint, 0, (reference,), sent_ns=1018 * MS))
    assert recorder.summary()["latency_p50_ms"] == pytest.approx(18.0)


def test_nothing_is_collected_before_the_chase() -> None:
    recorder = ChaseRecorder()
    recorder.on_truth(_received(_truth(9.0), 0))
    recorder.on_status(_received(helm_status("standby", source="pursuit"), 0))
    assert recorder.errors_m == []
    assert recorder.helm_states == []


@pytest.mark.parametrize("heading_deg", [0.0, 30.0, 90.0, 179.0, -120.0])
def test_box_is_the_car_s_rectangle_with_its_long_side_along_the_heading(heading_deg: float) -> None:
    angle = math.radians(heading_deg)
    # In the picture of a vehicle heading north, north is up (-y) and east is right (+x).
    along = (math.sin(angle), -math.cos(angle))
    across = (math.cos(angle), math.sin(angle))
    corners = tuple(
        (320 + a * 40 * along[0] + b * 20 * across[0], 240 + a * 40 * along[1] + b * 20 * across[1])
        for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1))
    )
    (x, y, width, height), found = box_of_corners(corners, _truth(car_heading_rad=angle))
    assert (x + width / 2, y + height / 2) == pytest.approx((320, 240), abs=0.5)
    assert (width, height) == pytest.approx((40, 80), abs=0.5)
    assert math.remainder(found - angle, 2 * math.pi) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("figures", "words"),
    [
        ({"closest_m": 1.2, "stick_stop_m": 1.3, "approach_m": 1.5}, []),
        ({"closest_m": 0.7, "stick_stop_m": 1.3, "approach_m": 1.5}, ["came to 0.70 m of barrel 1, expected 0.8"]),
        ({"closest_m": 4.0, "stick_stop_m": 4.0, "approach_m": 1.5}, ["stick_stop_m 4.00, expected 2 or less"]),
        ({"closest_m": 1.2, "stick_stop_m": 1.3}, ["approach_m nan"]),
        ({"closest_m": math.nan}, ["came to nan", "stick_stop_m nan", "approach_m nan"]),
    ],
)
def test_an_approach_is_judged_by_where_it_stopped(figures: dict[str, float], words: list[str]) -> None:
    found = approach_faults(figures, "barrel 1", 0.8, 1.5)
    assert len(found) == len(words)
    assert all(word in fault for word, fault in zip(words, found, strict=True))
