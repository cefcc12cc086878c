"""Runs the doctor's checks side by side, each within its time, and prints what they found.

Entries are strings, as in the process table: `common` depends on neither side, and a check whose library is missing is
a finding like any other.
"""

from __future__ import annotations

import json
import queue
import sys
import threading
import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import TextIO

from common.config import Config, load_object
from common.doctor.finding import Finding, fault
from common.session import Side
from common.topics_tool import print_table

_MARKS = {"ok": "✓", "warning": "!", "fault": "✗"}
_ALL: tuple[Side, ...] = ("onboard", "ground", "sim")


@dataclass(frozen=True)
class Check:
    """One check: a function `check(config, sides) -> findings`."""

    name: str
    """Name in findings about the check itself."""
    entry: str
    """`module:function`."""
    sides: tuple[Side, ...] = _ALL
    """Sides that it concerns."""
    limit_s: float = 8.0
    """Longest time that it may take, s."""


CHECKS = (
    Check("machine", "common.doctor.host:machine"),
    Check("packages", "common.doctor.packages:packages"),
    Check("clock", "common.doctor.host:clock"),
    Check("graphics", "simulation.doctor.graphics:graphics", ("sim",), limit_s=9.5),
    Check("ports of the simulation", "simulation.doctor.ports:ports", ("sim",)),
    Check("ports of the vehicle", "onboard.doctor.ports:ports", ("onboard",)),
    Check("ports of the ground", "ground.doctor.station:ports", ("ground",)),
    Check("lock files", "onboard.doctor.ports:locks", ("onboard",)),
    Check("routers", "common.doctor.routers:routers"),
    Check("camera", "onboard.doctor.camera:camera", ("onboard",)),
    Check("autopilot", "onboard.doctor.autopilot:autopilot", ("onboard",)),
    Check("clocks of the system", "common.doctor.routers:clocks"),
    Check("disk", "ground.doctor.station:disk", ("ground",)),
)


def examine(config: Config, sides: Sequence[Side], checks: Iterable[Check] = CHECKS) -> list[Finding]:
    """Findings of all checks that concern some of these sides, in the order of the table.

    A check that raises or does not end in its time is a fault of its own; the others go on.
    """
    chosen = [check for check in checks if set(check.sides) & set(sides)]
    done: queue.SimpleQueue[tuple[str, list[Finding]]] = queue.SimpleQueue()
    began_s = time.monotonic()
    for check in chosen:
        threading.Thread(
            target=lambda c=check: done.put((c.name, _run(c, config, tuple(sides)))), name=check.name, daemon=True
        ).start()
    found: dict[str, list[Finding]] = {}
    while True:
        spent_s = time.monotonic() - began_s
        left_s = max((c.limit_s - spent_s for c in chosen if c.name not in found), default=0.0)
        if left_s <= 0:
            break
        try:
            name, findings = done.get(timeout=left_s)
        except queue.Empty:
            break
        found[name] = findings
    return [f for c in chosen for f in found.get(c.name, [_hung(c)])]


def _run(check: Check, config: Config, sides: tuple[Side, ...]) -> list[Finding]:
    findings: list[Finding] = []
    try:
        for found in load_object(check.entry)(config, sides):
            findings.append(found)  # one by one: what was found before a crash counts
    except ModuleNotFoundError as error:
        extra = check.sides[0] if len(check.sides) == 1 else "all"
        text = f"not looked at: the module {error.name!r} is not installed"
        findings.append(fault(check.name, text, f"pip install 'outrider[{extra}]'"))
    except Exception as error:  # noqa: BLE001  whatever it is, it is a finding
        text = " ".join(str(error).split())[:200]
        findings.append(
            fault(check.name, f"the check failed ({type(error).__name__}: {text})", "report it with this line")
        )
    return findings


def _hung(check: Check) -> Finding:
    return fault(
        check.name,
        f"the check did not end in {check.limit_s:g} s",
        "look for a device, a disk or a network that does not answer; report it if all of them do",
    )


def doctor(config: Config, sides: Sequence[Side], as_json: bool, out: TextIO | None = None) -> int:
    """Examine, print, and return 0 without faults, 1 with.

    Args:
        config: all sections.
        sides: sides of the system that run on this machine, or will.
        as_json: print one JSON object instead of a table.
        out: where to print; None for standard output.
    """
    findings = examine(config, sides)
    counts = {severity: sum(f.severity == severity for f in findings) for severity in _MARKS}
    if as_json:
        print(json.dumps({**counts, "findings": [asdict(f) for f in findings]}), file=out or sys.stdout)
    else:
        rows = [("", "LOOKED AT", "FOUND")]
        for f in findings:
            rows.append((_MARKS[f.severity], f.subject, f.found))
            if f.cure:  # on a line of its own: found and cure side by side are wider than a terminal
                rows.append(("", "", f"→ {f.cure}"))
        print_table(rows, out)
        print(f"faults: {counts['fault']}, warnings: {counts['warning']}, ok: {counts['ok']}", file=out or sys.stdout)
    return 1 if counts["fault"] else 0
