"""What the tests use of the machine: found where set-up (`make test`) looks for it and puts it."""

from __future__ import annotations

import itertools
import os
import random
import shutil
import socket
from collections.abc import Iterator

LOOPBACK = "127.0.0.1"
_FIRST_PORT, _PORTS_EACH = 20_000, 2_400
"""Ports below those that the kernel gives to whoever asks for any: nobody else takes one before the test does."""


def chromium() -> str:
    """Path of the Chromium or Chrome that browser tests drive.

    Raises:
        FileNotFoundError: there is none on the path.
    """
    names = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
    for name in names:
        if (path := shutil.which(name)) is not None:
            return path
    raise FileNotFoundError(f"no browser: expected one of {', '.join(names)} on the path; run `make test`")


def free_ports(count: int) -> list[int]:
    """Ports of loopback that nobody has, for TCP and UDP alike; no process of a run gets one that another got."""
    return list(itertools.islice(_free, count))


def free_port() -> int:
    """One of `free_ports`."""
    return next(_free)


def _each_free_port() -> Iterator[int]:
    worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")) % 5
    start = random.SystemRandom().randrange(_PORTS_EACH)  # other runs on this machine begin elsewhere
    for number in itertools.count(start):
        port = _FIRST_PORT + worker * _PORTS_EACH + number % _PORTS_EACH
        if _is_free(port, socket.SOCK_STREAM) and _is_free(port, socket.SOCK_DGRAM):
            yield port


def _is_free(port: int, kind: int) -> bool:
    with socket.socket(socket.AF_INET, kind) as s:
        try:
            s.bind((LOOPBACK, port))
        except OSError:
            return False
        return True


_free = _each_free_port()
