"""The heading filter: a turn is followed without lag, goes on for a while unseen, and turns the velocity with it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from common.geometry.rotation import wrap_angle
from ground.pursuit.heading import HeadingFilter
from ground.pursuit.target import TargetFilter

PERIOD_NS = 50_000_000


def _turning(rate_rad_s: float, frames: int = 60, noise_rad: float = 0.03) -> tuple[HeadingFilter, int]:
    rng = np.random.default_rng(4)
    heading = HeadingFilter(memory_s=1.5, agility_rad_s2=2.0, measurement_rad=0.08)
    for index in range(frames):
        true_rad = 3.0 + rate_rad_s * index * 0.05
        heading.update(wrap_angle(true_rad + float(rng.normal(0.0, noise_rad))), index * PERIOD_NS)
    return heading, (frames - 1) * PERIOD_NS


@pytest.mark.parametrize("rate_rad_s", [0.7, -0.7, 0.0])
def test_a_turn_is_followed_over_half_a_circle(rate_rad_s: float) -> None:
    heading, t_ns = _turning(rate_rad_s)
    heading_rad, turn_rad_s = heading.predict(t_ns)

    assert wrap_angle(heading_rad - 3.0 - rate_rad_s * 59 * 0.05) == pytest.approx(0.0, abs=0.08)
    assert turn_rad_s == pytest.approx(rate_rad_s, abs=0.15)


def test_an_unseen_turn_fades() -> None:
    heading, t_ns = _turning(0.7, noise_rad=0.0)
    later_ns = t_ns + 1_500_000_000
    turned = wrap_angle(heading.predict(later_ns)[0] - heading.predict(t_ns)[0])

    assert heading.predict(later_ns)[1] == pytest.approx(heading.predict(t_ns)[1] / math.e, rel=1e-6)
    assert turned == pytest.approx(1.5 * heading.mean_rate(later_ns), rel=1e-6)
    assert 0.4 < turned < 0.8


def test_without_a_measurement_nothing_turns() -> None:
    heading = HeadingFilter(1.5, 2.0, 0.08)
    assert not heading.known and heading.predict(PERIOD_NS) == (0.0, 0.0)
    heading.update(1.0, 0)
    assert heading.known
    heading.reset()
    assert not heading.known


def test_a_turning_target_is_predicted_along_its_arc() -> None:
    radius_m, rate_rad_s = 2.0, 0.7
    target = TargetFilter(process_m_s2=1.5, measurement_m=0.02)

    def place(t_s: float) -> np.ndarray:
        return radius_m * np.array([math.sin(rate_rad_s * t_s), -math.cos(rate_rad_s * t_s)])

    for index in range(60):
        target.update(place(index * 0.05), index * PERIOD_NS, rate_rad_s)
    later = target.predict(59 * PERIOD_NS + 1_000_000_000, rate_rad_s)
    straight = target.predict(59 * PERIOD_NS + 1_000_000_000)

    assert later is not None and straight is not None
    assert later.position_m == pytest.approx(place(59 * 0.05 + 1.0), abs=0.05)
    assert np.linalg.norm(straight.position_m - place(59 * 0.05 + 1.0)) > 0.3
    assert np.linalg.norm(later.velocity_m_s) == pytest.approx(radius_m * rate_rad_s, abs=0.05)
