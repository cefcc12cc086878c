"""The heartbeat of a process to its supervisor: one byte a second through an inherited pipe, no bus involved."""

from __future__ import annotations

import contextlib
import os

VARIABLE = "OUTRIDER_HEARTBEAT_FD"


def beat() -> None:
    """Say that this process's loop turns; nothing happens without a supervisor."""
    descriptor = os.environ.get(VARIABLE)
    if descriptor:
        with contextlib.suppress(OSError):  # the supervisor has gone, or its pipe is full: neither is our concern
            os.write(int(descriptor), b".")
