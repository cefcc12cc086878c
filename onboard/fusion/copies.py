"""Which trackers speak for an answer because they were put on it, and so show nothing by agreeing.

An answer that was found, and not followed, may be another thing. A tracker that is put on it takes that up at once, and
finds it again when it has lost it; and two that agree are believed. It has a word of its own again once the answer is
firm without it, or after long.
"""

from __future__ import annotations

from dataclasses import replace

from onboard.fusion.center import Fused

_LONG_S = 2.0
"""How long one that was put on an answer counts for nothing, s: a wrong one has mostly been left by then."""


class Copies:
    """Trackers that were put on an answer that was found."""

    def __init__(self) -> None:
        self._since: dict[str, int] = {}

    def put(self, name: str, t_ns: int, *, found: bool) -> None:
        """A tracker was put on the answer in a picture, t_ns, while that was found or followed."""
        self._since.pop(name, None)
        if found:
            self._since[name] = t_ns

    def firm(self) -> None:
        """The answer is followed: whoever is on it is on the target."""
        self._since.clear()

    def names(self, t_ns: int) -> frozenset[str]:
        """Those that have no word of their own at a time, ns."""
        return frozenset(name for name, put_ns in self._since.items() if t_ns - put_ns <= _LONG_S * 1e9)

    def without(self, fused: Fused) -> Fused:
        """The answer as the others speak for it."""
        names = self.names(fused.t_ns)
        return replace(fused, sources={n: j for n, j in fused.sources.items() if n not in names})
