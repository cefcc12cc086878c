"""The time that poses may take in each picture: what looks took longer is missing from the next ones."""

from __future__ import annotations

_SMOOTHING = 0.2
"""Share of the newest look's duration in what the next one is expected to take."""
_MOST_OWED = 2.0
"""Looks that took longer than the budget are made up for, up to so many budgets: a machine that stood still is no
reason to stop looking."""
_LEAST_LEFT = 0.5
"""A look is begun when so much of what it is expected to take is left of the budget."""


class PoseBudget:
    """Says whether another look may begin.

    Args:
        budget_ms: for each picture; 0: no limit.
    """

    def __init__(self, budget_ms: float):
        self.budget_ms = budget_ms
        self._left_ms = 0.0  # less than nothing after looks that took longer
        self._look_ms = {False: 0.0, True: 0.0}  # of a region that is new, of one whose pose is known

    def next_picture(self) -> None:
        """Another picture, another share; what the last one's looks took too long is missing, so that the budget holds
        over time."""
        self._left_ms = min(self._left_ms + self.budget_ms, self.budget_ms)

    def allows(self, known: bool) -> bool:
        """Whether a look may begin.

        Args:
            known: whether the pose is known from before, which makes it shorter.
        """
        if not self.budget_ms:
            return True
        return self._left_ms >= _LEAST_LEFT * min(self._look_ms[known], self.budget_ms)

    def took(self, known: bool, look_ms: float) -> None:
        """Note how long one took, ms."""
        expected_ms = self._look_ms[known]
        self._left_ms = max(self._left_ms - look_ms, -_MOST_OWED * self.budget_ms)
        self._look_ms[known] += (_SMOOTHING if expected_ms else 1.0) * (look_ms - expected_ms)
