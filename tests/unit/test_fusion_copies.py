"""Trackers that were put on an answer that was found show nothing by agreeing with it."""

from __future__ import annotations

import numpy as np

from onboard.fusion.answer import agreed
from onboard.fusion.center import Fused
from onboard.fusion.copies import Copies
from onboard.fusion.source import Judgement

BOTH = {name: Judgement(1.0, 0.0, 0.0, 0.0, 0.0, np.ones(4)) for name in ("finder", "put")}


def _answer(t_ns: int) -> Fused:
    return Fused(t_ns, "tracking", np.array([120.0, 95.0, 30.0, 40.0]), np.zeros(4), np.eye(8), 0.9, BOTH, ())


def test_one_that_was_put_on_a_found_answer_has_no_word_until_long_after() -> None:
    copies = Copies()
    copies.put("put", 0, found=True)
    assert agreed(_answer(0)) and not agreed(copies.without(_answer(1_900_000_000)))
    assert copies.names(1_900_000_000) == {"put"}
    assert agreed(copies.without(_answer(2_100_000_000)))


def test_one_that_was_put_on_what_is_followed_counts_at_once() -> None:
    copies = Copies()
    copies.put("put", 0, found=False)
    assert agreed(copies.without(_answer(50_000_000)))


def test_all_count_once_the_answer_is_firm() -> None:
    copies = Copies()
    copies.put("put", 0, found=True)
    copies.firm()
    assert agreed(copies.without(_answer(50_000_000)))
