"""For how long something has held, though it failed for a picture or two in between."""

from __future__ import annotations

import pytest

from onboard.fusion.lasting import Lasting

MS = 1_000_000


def test_a_break_is_forgiven_unless_it_is_long_and_while_it_lasts_nothing_holds() -> None:
    lasting = Lasting(0.2)
    assert lasting.note(True, 0) == 0.0
    assert lasting.note(True, 300 * MS) == 0.0, "nobody knows what was in between"
    assert lasting.note(True, 400 * MS) == pytest.approx(0.1)
    assert lasting.note(False, 500 * MS) == 0.0
    assert lasting.note(True, 600 * MS) == pytest.approx(0.3)
    assert lasting.note(False, 700 * MS) == 0.0
    assert lasting.note(True, 900 * MS) == 0.0
    assert lasting.so_far(900 * MS) == 0.0


def test_how_long_it_had_held_is_known_until_the_break_is_too_long() -> None:
    lasting = Lasting(0.2)
    assert lasting.so_far(0) == 0.0
    for t_ms in (0, 100):
        lasting.note(True, t_ms * MS)
    lasting.note(False, 200 * MS)
    assert lasting.so_far(300 * MS) == pytest.approx(0.1)
    assert lasting.so_far(301 * MS) == 0.0
