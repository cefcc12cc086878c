"""For how long something has held: what is judged picture by picture fails in one of them for no reason."""

from __future__ import annotations


class Lasting:
    """Since when something holds, short breaks forgiven.

    Args:
        break_s: longest break that is forgiven, s.
    """

    def __init__(self, break_s: float):
        self._break_ns = round(break_s * 1e9)
        self._since_ns: int | None = None
        self._held_ns = 0

    def note(self, holds: bool, t_ns: int) -> float:
        """Take in whether it holds at a time, ns; returns for how long it has held so far, s: 0 where it does not."""
        if not holds:
            return 0.0
        if self._since_ns is None or t_ns - self._held_ns > self._break_ns:
            self._since_ns = t_ns
        self._held_ns = t_ns
        return (t_ns - self._since_ns) * 1e-9

    def so_far(self, t_ns: int) -> float:
        """For how long it had held when it did last, s; 0 once that is too long ago at a time, ns."""
        if self._since_ns is None or t_ns - self._held_ns > self._break_ns:
            return 0.0
        return (self._held_ns - self._since_ns) * 1e-9
