"""The limit up to which a target counts as seen, and how sure a picture near it is."""

from __future__ import annotations

import pytest

from common.tracking.config import ParticleFilterConfig
from common.tracking.loss_limit import LossLimit

CONFIG = ParticleFilterConfig(limit_factor=1.3, limit_frames=3, limit_floor=0.2, limit_ceiling=0.62, limit_memory_s=2.0)


def _begun(*smallest: float) -> LossLimit:
    limit = LossLimit(CONFIG)
    for distance in smallest:
        limit.begin(distance)
    return limit


def test_begins_as_the_factor_times_the_median_of_the_first_pictures() -> None:
    assert _begun().value == pytest.approx(CONFIG.limit_ceiling)
    assert _begun(0.3, 0.9, 0.2).value == pytest.approx(1.3 * 0.3)
    assert _begun(0.3, 0.9, 0.2, 0.9, 0.9).value == pytest.approx(1.3 * 0.3), "later ones are not the first"


def test_stays_within_its_bounds() -> None:
    assert _begun(0.01).value == CONFIG.limit_floor
    assert _begun(0.9).value == CONFIG.limit_ceiling


def test_follows_a_healthy_picture_with_its_memory() -> None:
    limit = _begun(0.3, 0.3, 0.3)
    for _ in range(40):
        limit.follow(0.4, 0.05)
    assert limit.value == pytest.approx(1.3 * (0.4 - 0.1 / 2.718281828), abs=1e-6), "63 % of the way after 2 s"


def test_confidence_falls_towards_the_limit() -> None:
    limit = _begun(0.3, 0.3, 0.3)
    assert limit.confidence(0.25) == 1.0
    assert limit.confidence((0.3 + limit.value) / 2) == pytest.approx(0.5)
    assert 0.0 < limit.confidence(limit.value + 0.1) < 0.1


def test_a_search_has_to_find_better_under_another_light() -> None:
    limit = LossLimit(ParticleFilterConfig(limit_frames=1, limit_floor=0.2, limit_ceiling=0.9, limit_factor=2.0))
    limit.begin(0.4)
    assert limit.of_found(relit=False) == pytest.approx(1.3 * 0.4)
    assert limit.of_found(relit=True) == pytest.approx(1.1 * 0.4)
    limit.begin(0.0)
    assert limit.of_found(relit=False) <= limit.value
