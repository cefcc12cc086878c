"""The arbiter: rank, age, frames."""

from __future__ import annotations

import math

import msgspec
import pytest

from common.messages import Request
from onboard.helm.arbiter import Candidate, arbitrate

NOW = 10_000_000_000


def _candidate(source: str = "pursuit", age_ms: float = 50.0, **fields) -> Candidate:
    request = msgspec.structs.replace(Request(frame="ned", vector=(1.0, 2.0, 0.5)), **fields)
    basis = NOW - int(age_ms * 1e6)
    return Candidate(source, request, basis, basis + 1_000_000)


def test_the_operator_ranks_over_the_task():
    verdict = arbitrate([_candidate("operator", vector=(0.0, 0.0, 0.1)), _candidate()], NOW, 0.0, 0.3)
    assert (verdict.source, verdict.ned_v_m_s) == ("operator", (0.0, 0.0, 0.1))


def test_a_stale_operator_does_not_block_the_task():
    verdict = arbitrate([_candidate("operator", age_ms=400.0), _candidate()], NOW, 0.0, 0.3)
    assert verdict.source == "pursuit"
    assert verdict.refused == (("operator", "stale"),)


@pytest.mark.parametrize(
    ("fields", "age_ms", "reason"),
    [
        ({}, 301.0, "stale"),
        ({}, -100.0, "from the future"),
        ({"valid_ms": 40.0}, 50.0, "expired"),
        ({"vector": (math.nan, 0.0, 0.0)}, 10.0, "not finite"),
        ({"yaw_rate_rad_s": math.inf}, 10.0, "not finite"),
        ({"vector": (0.0, 1.5e308, 1.5e308)}, 10.0, "absurd"),
    ],
)
def test_what_may_not_be_obeyed_becomes_hover(fields, age_ms: float, reason: str):
    verdict = arbitrate([_candidate(age_ms=age_ms, **fields)], NOW, 0.0, 0.3)
    assert (verdict.source, verdict.ned_v_m_s, verdict.age_ms) == ("helm", (0.0, 0.0, 0.0), -1.0)
    assert verdict.refused == (("pursuit", reason),)


def test_age_counts_from_the_basis_even_when_the_request_just_came():
    late = Candidate("pursuit", Request(frame="ned", vector=(1.0, 0.0, 0.0)), NOW - 500_000_000, NOW)
    assert arbitrate([late], NOW, 0.0, 0.3).source == "helm"


@pytest.mark.parametrize(("yaw", "ned"), [(0.0, (2.0, 1.0)), (math.pi / 2, (-1.0, 2.0)), (math.pi, (-2.0, -1.0))])
def test_the_heading_frame_turns_with_the_vehicle(yaw: float, ned: tuple[float, float]):
    verdict = arbitrate([_candidate(frame="heading", vector=(2.0, 1.0, -0.3))], NOW, yaw, 0.3)
    assert verdict.ned_v_m_s == pytest.approx((*ned, -0.3))


def test_an_acceleration_is_passed_on_as_one_and_its_vertical_part_stays_a_velocity():
    verdict = arbitrate([_candidate(kind="acceleration", frame="heading")], NOW, math.pi / 2, 0.3)
    assert verdict.ned_a_m_s2 == pytest.approx((-2.0, 1.0))
    assert verdict.ned_v_m_s == (0.0, 0.0, 0.5)
    assert arbitrate([_candidate()], NOW, 0.0, 0.3).ned_a_m_s2 is None


def test_without_a_heading_the_heading_frame_is_refused():
    verdict = arbitrate([_candidate(frame="heading")], NOW, math.nan, 0.3)
    assert verdict.refused == (("pursuit", "no heading"),)
