"""Parts of a benchmark in processes of their own."""

from __future__ import annotations

import pytest

from benchmarks.beside import results_of


def test_results_keep_the_order_of_their_parts_and_each_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    results = results_of(pow, [(2, 10), (3, 2), (7, 0)], lambda part, result: f"{part[0]} gives {result}")
    told = capsys.readouterr().err.splitlines()
    assert results == [1024, 9, 1]
    assert [line.split(":")[0] for line in told] == ["1 of 3", "2 of 3", "3 of 3"]
    assert sorted(line.split(": ")[1] for line in told) == ["2 gives 1024", "3 gives 9", "7 gives 1"]


def test_a_part_that_fails_is_not_passed_over() -> None:
    with pytest.raises(ZeroDivisionError):
        results_of(divmod, [(1, 1), (1, 0)], lambda part, result: str(result))
