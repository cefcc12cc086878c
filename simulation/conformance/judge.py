"""What a check found: expectation beside observation, one line each, and the verdict."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Line:
    """One comparison."""

    what: str
    """What was looked at."""
    got: str
    """What was observed, with its unit."""
    expected: str
    """What PX4 does, with the tolerance."""
    ok: bool
    """Whether they agree."""


@dataclass
class Judge:
    """Collects the comparisons of one check."""

    lines: list[Line] = field(default_factory=list)

    @property
    def ok(self) -> bool:
        """Whether everything agrees; a check that compared nothing has not passed."""
        return bool(self.lines) and all(line.ok for line in self.lines)

    def truth(self, what: str, ok: bool, got: Any, expected: str) -> bool:
        """Compare by a condition."""
        self.lines.append(Line(what, str(got), expected, bool(ok)))
        return bool(ok)

    def equal(self, what: str, got: Any, expected: Any) -> bool:
        """Compare for equality."""
        return self.truth(what, got == expected, got, str(expected))

    def near(self, what: str, got: float, expected: float, tolerance: float, unit: str = "") -> bool:
        """Compare with an absolute tolerance."""
        ok = math.isfinite(got) and abs(got - expected) <= tolerance
        return self.truth(what, ok, figure(got, unit), f"{figure(expected, unit)} ± {tolerance:.3g}")

    def between(self, what: str, got: float, low: float, high: float, unit: str = "") -> bool:
        """Compare with a range."""
        return self.truth(what, low <= got <= high, figure(got, unit), f"{low:.3g} to {figure(high, unit)}")


def figure(value: float, unit: str = "") -> str:
    """A number as the report shows it."""
    text = f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}" if math.isfinite(value) else "never"
    return f"{text} {unit}".strip()
