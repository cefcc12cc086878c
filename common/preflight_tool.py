"""Looks at helm's gate before arming: what `outrider preflight` prints."""

from __future__ import annotations

import queue
import sys
import time
from typing import Any, TextIO

import msgspec

from common.bus import Bus
from common.header import Received
from common.messages import HelmStatus
from common.topics import topic
from common.topics_tool import print_table

STATUS = "helm/status"
OPEN, CLOSED, NO_HELM = 0, 1, 2
_FIRST_WORD_S = 3.0  # helm speaks five times a second


def preflight(bus: Bus, wait_s: float, as_json: bool, out: TextIO | None = None) -> int:
    """Print the gate, item by item; returns 0 when it is open, 1 when it is closed, 2 when no helm answers.

    Args:
        bus: session to listen on.
        wait_s: how long to wait for the gate to open, s; 0 takes the first word of helm.
        as_json: print one JSON object instead of a table.
        out: where to print; None for standard output.
    """
    received = _listen(bus, wait_s)
    if received is None:
        print(
            f"outrider: no word from helm of vehicle {bus.config.vehicle!r}; start `outrider onboard`, or look for it "
            f"with `outrider doctor`",
            file=sys.stderr,
        )
        return NO_HELM
    if as_json:
        print(msgspec.json.encode(fields_of(received.message, bus.config.vehicle)).decode(), file=out or sys.stdout)
    else:
        print_gate(received.message, bus.config.vehicle, out)
    return OPEN if is_open(received.message) else CLOSED


def is_open(status: HelmStatus) -> bool:
    """Whether helm would arm now."""
    return bool(status.preflight) and all(item.ok for item in status.preflight)


def print_gate(status: HelmStatus, vehicle: str, out: TextIO | None = None) -> None:
    """Print one line that says it all, then a table of the items in the order in which to put them right."""
    failing = sum(not item.ok for item in status.preflight)
    word = "open" if is_open(status) else f"closed, {failing} of {len(status.preflight)} checks fail"
    print(f"{vehicle}: gate {word}; helm: {status.state}, {status.reason}", file=out or sys.stdout)
    rows = [("", "CHECK", "FOUND", "DO")]
    for item in status.preflight:
        found, cure = item.found_and_cure()
        rows.append(("✓" if item.ok else "✗", item.name, found, cure))
    print_table(rows, out)


def fields_of(status: HelmStatus, vehicle: str) -> dict[str, Any]:
    """The gate as plain data."""
    items = [(item, item.found_and_cure()) for item in status.preflight]
    return {
        "vehicle": vehicle,
        "open": is_open(status),
        "state": status.state,
        "reason": status.reason,
        "items": [{"name": i.name, "ok": i.ok, "found": found, "cure": cure} for i, (found, cure) in items],
    }


def _listen(bus: Bus, wait_s: float) -> Received[HelmStatus] | None:
    """Newest status once the gate is open or the time is over; None when helm is silent at the end."""
    arrived: queue.SimpleQueue[Received[HelmStatus]] = queue.SimpleQueue()
    bus.subscribe(STATUS, arrived.put)
    now_s = time.monotonic()
    first_s, last_s = now_s + max(_FIRST_WORD_S, wait_s), now_s + wait_s
    newest: Received[HelmStatus] | None = None
    told = ""
    while (now_s := time.monotonic()) < (first_s if newest is None else last_s):
        try:
            newest = arrived.get(timeout=min(0.2, first_s - now_s))
        except queue.Empty:
            continue
        if is_open(newest.message):
            return newest
        failing = ", ".join(item.name for item in newest.message.preflight if not item.ok)
        if wait_s > 0 and failing != told:
            told = failing
            print(f"waiting for: {failing}", file=sys.stderr)
    if newest is None or time.monotonic_ns() - newest.received_ns > topic(STATUS).max_age_ms * 1e6:
        return None
    return newest
