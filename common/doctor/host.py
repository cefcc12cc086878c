"""Checks of the machine: cores, load, memory, clock."""

from __future__ import annotations

import ctypes
import os
import time
from collections.abc import Iterator
from pathlib import Path

from common.config import Config
from common.doctor.finding import Finding, fault, ok, warning

_CORES = {"onboard": 0.3, "ground": 0.4, "sim": 0.4}
"""Cores that each side keeps busy, measured with `outrider bench latency`."""
_MEMORY_GB = {"onboard": 0.3, "ground": 0.6, "sim": 0.5}
"""Memory of the processes of each side, 10^9 bytes, rounded up."""
_TIME_ERROR = 5
_STEP_NS = 20_000_000


def machine(config: Config, sides: tuple[str, ...]) -> Iterator[Finding]:
    """Whether cores, load and memory leave room for these sides."""
    cores, load = len(os.sched_getaffinity(0)), os.getloadavg()[0]
    needed = sum(_CORES[side] for side in sides)
    if cores < needed:
        yield fault(
            "cores", f"{cores}, expected {needed:.1f} for {', '.join(sides)}", "run fewer sides on this machine"
        )
    elif cores - load < 0.5:
        yield warning(
            "cores",
            f"{cores} with a load of {load:.1f}: nothing to spare",
            "end other programs; late pictures and setpoints follow otherwise (this system's own load counts too)",
        )
    else:
        yield ok("cores", f"{cores}, load {load:.1f}")
    fields = (line.split() for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines())
    free_gb = next(int(f[1]) * 1024 / 1e9 for f in fields if f[0] == "MemAvailable:")
    wanted_gb = sum(_MEMORY_GB[side] for side in sides)
    if free_gb < 0.2:
        yield fault("memory", f"{free_gb:.1f} GB available, expected {wanted_gb:.1f}", "end other programs")
    elif free_gb < wanted_gb:
        yield warning("memory", f"{free_gb:.1f} GB available, expected {wanted_gb:.1f}", "end other programs")
    else:
        yield ok("memory", f"{free_gb:.1f} GB available")


def clock(config: Config, sides: tuple[str, ...]) -> Iterator[Finding]:
    """Whether UTC is disciplined by a time service and runs beside the monotonic clock without steps."""
    timex = ctypes.create_string_buffer(512)  # modes 0: reads alone
    state = ctypes.CDLL(None).adjtimex(timex)
    if state == _TIME_ERROR:
        yield warning(
            "UTC", "not synchronised", "start chrony or systemd-timesyncd; stamps of logs and recordings rest on it"
        )
    else:
        yield ok("UTC", "synchronised")
    before_ns = time.time_ns() - time.monotonic_ns()
    time.sleep(0.5)
    step_ns = time.time_ns() - time.monotonic_ns() - before_ns
    if abs(step_ns) > _STEP_NS:
        yield warning(
            "clock steps",
            f"UTC moved by {step_ns / 1e6:.0f} ms within 0.5 s",
            "let the time service settle, then start",
        )
