"""The heartbeat of a process to its supervisor or to systemd: once a second, no bus involved."""

from __future__ import annotations

import contextlib
import os
import socket

VARIABLE = "OUTRIDER_HEARTBEAT_FD"


def beat() -> None:
    """Say that this process's loop turns; nothing happens without a supervisor or a watchdog."""
    descriptor = os.environ.get(VARIABLE)
    if descriptor:
        with contextlib.suppress(OSError):  # the supervisor has gone, or its pipe is full: neither is our concern
            os.write(int(descriptor), b".")
    if os.environ.get("WATCHDOG_PID") == str(os.getpid()):  # a unit with WatchdogSec (sd_watchdog_enabled(3))
        _feed_watchdog(os.environ.get("NOTIFY_SOCKET", ""))


def _feed_watchdog(address: str) -> None:
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as link:
        link.setblocking(False)
        link.connect("\0" + address[1:] if address.startswith("@") else address)
        link.send(b"WATCHDOG=1")
