"""What a check of the doctor says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Severity = Literal["ok", "warning", "fault"]


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at."""

    severity: Severity
    """`fault`: it will not work like this. `warning`: it may not, or only later."""
    subject: str
    """What was looked at."""
    found: str
    """What was found, and what was expected where it differs."""
    cure: str = ""
    """What to do, in one line; empty when all is well."""


def ok(subject: str, found: str) -> Finding:
    """All is well."""
    return Finding("ok", subject, found)


def warning(subject: str, found: str, cure: str) -> Finding:
    """It works, or may work."""
    return Finding("warning", subject, found, cure)


def fault(subject: str, found: str, cure: str) -> Finding:
    """It does not work."""
    return Finding("fault", subject, found, cure)


def from_error(subject: str, error: Exception) -> Finding:
    """The fault that an error of the house tells: `what is wrong; what to do`."""
    found, _, cure = str(error).partition("; ")
    return fault(subject, found, cure or "put it right as the text says")
