"""The table of passes and differences, and the same as JSON."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

from simulation.conformance.judge import Line
from simulation.conformance.registry import Check

Outcome = Literal["pass", "differs", "not flown", "not run"]


@dataclass(frozen=True)
class Result:
    """What came of one check."""

    check: Check
    """The check."""
    outcome: Outcome
    """Verdict; `not run` where the vehicle could not be brought to where it begins."""
    lines: Sequence[Line] = ()
    """Its comparisons."""
    reason: str = ""
    """Why it was not run or ended early."""
    duration_s: float = 0.0
    """How long it took, s."""

    @property
    def failed(self) -> bool:
        """Whether the autopilot did not show what PX4 shows."""
        return self.outcome in ("differs", "not run")


def row(result: Result) -> str:
    """One check in the table; what differs below it."""
    text = f"{result.outcome:10}{result.check.name:18}{result.duration_s:6.1f} s  {result.check.doc}"
    if result.reason:
        text += f"\n{'':10}{result.reason}"
    for line in result.lines:
        if not line.ok:
            text += f"\n{'':10}- {line.what}: got {line.got}, expected {line.expected}"
    return text


def details(result: Result) -> str:
    """All comparisons of a check."""
    return "\n".join(
        f"{'':10}{'·' if line.ok else '-'} {line.what}: {line.got} (expected {line.expected})" for line in result.lines
    )


def summary(results: Iterable[Result]) -> str:
    """The last line of the table."""
    outcomes = [r.outcome for r in results]
    parts = ((outcomes.count(o), word) for o, word in _WORDS)
    return ", ".join(f"{count} {word}" for count, word in parts if count or word == "passed")


_WORDS: tuple[tuple[Outcome, str], ...] = (
    ("pass", "passed"),
    ("differs", "differ"),
    ("not run", "could not be run"),
    ("not flown", "not flown"),
)


def as_json(url: str, results: Iterable[Result]) -> dict[str, Any]:
    """The report as plain values."""
    return {
        "url": url,
        "checks": [
            {
                "name": r.check.name,
                "doc": r.check.doc,
                "outcome": r.outcome,
                "reason": r.reason,
                "duration_s": round(r.duration_s, 2),
                "lines": [asdict(line) for line in r.lines],
            }
            for r in results
        ],
    }
