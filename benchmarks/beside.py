"""Parts of a benchmark that know nothing of each other, computed beside each other."""

from __future__ import annotations

import multiprocessing
import os
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import Any, TypeVar

_MOST = 8
"""Processes at once, at most: each holds its own pictures and trackers."""
_BAR = 24
"""Length of the bar, characters."""

T = TypeVar("T")
Part = tuple[Any, ...]


def results_of(work: Callable[..., T], parts: Sequence[Part], told: Callable[[Part, T], str]) -> list[T]:
    """Result of each part, in their order, computed in a process for each core.

    A bar on a terminal, a line for each part elsewhere, says on standard error how far it is.

    Args:
        work: computes a part; by name, since it is called in another process.
        parts: its arguments.
        told: what is said of one that is done.
    """
    results: dict[int, T] = {}
    with ProcessPoolExecutor(min(os.cpu_count() or 1, _MOST), multiprocessing.get_context("spawn")) as pool:
        futures = {pool.submit(work, *part): number for number, part in enumerate(parts)}
        for done, future in enumerate(as_completed(futures), 1):
            number = futures[future]
            results[number] = future.result()
            _show(done, len(parts), told(parts[number], results[number]))
    return [results[number] for number in range(len(parts))]


def _show(done: int, total: int, text: str) -> None:
    line = f"{done} of {total}: {text}"
    if sys.stderr.isatty():
        bar, end = "#" * (_BAR * done // total), "\n" if done == total else ""
        print(f"\r[{bar:{_BAR}}] {line:80}", end=end, file=sys.stderr, flush=True)
    else:
        print(line, file=sys.stderr, flush=True)
