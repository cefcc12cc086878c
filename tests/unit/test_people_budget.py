"""The poses' share of a picture's time holds over many pictures."""

from __future__ import annotations

import pytest

from onboard.people.budget import PoseBudget


def _looks(budget: PoseBudget, look_ms: float, pictures: int, wanted: int = 5) -> list[int]:
    """How many looks of one length begin in each of some pictures that want as many."""
    counts = []
    for _ in range(pictures):
        budget.next_picture()
        counts.append(0)
        while counts[-1] < wanted and budget.allows(known=False):
            budget.took(False, look_ms)
            counts[-1] += 1
    return counts


@pytest.mark.parametrize("look_ms", [8.0, 30.0, 55.0, 70.0, 110.0])
def test_over_many_pictures_looks_take_no_more_than_their_share(look_ms: float):
    counts = _looks(PoseBudget(55.0), look_ms, 200, wanted=50)
    assert sum(counts) * look_ms <= 200 * 55.0 + 2 * look_ms
    assert sum(counts) * look_ms > 0.6 * 200 * 55.0


def test_a_machine_that_stood_still_goes_on_looking():
    budget = PoseBudget(55.0)
    budget.next_picture()
    budget.took(False, 60_000.0)
    assert 1 in _looks(budget, 40.0, 5)


def test_without_a_budget_everything_is_looked_at():
    assert _looks(PoseBudget(0.0), 500.0, 3) == [5, 5, 5]
