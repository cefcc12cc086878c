"""The supervisor of a side: starts its processes, restarts what dies or hangs, ends them all together.

It is no part of the safety chain: with it dead, helm flies on; with helm dead, the autopilot's own failsafe acts.
"""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import logging
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

from common import heartbeat
from common.processes import ProcessSpec

log = logging.getLogger(__name__)

EXIT_CONFIG = 2
"""Exit code of a process that cannot run as configured: it is not restarted."""
EXIT_ALREADY_RUNNING = 3
"""Exit code of a second process of an exclusive node: it is not restarted."""

_FIRST_DELAY_S = 0.2
_LONGEST_DELAY_S = 5.0
_STABLE_S = 10.0
_POLL_S = 0.05
_HUNG_AFTER_S = 5.0
_START_PATIENCE_S = 30.0
_GRACE_S = 3.0
_PR_SET_PDEATHSIG = 1


@dataclass
class _Child:
    spec: ProcessSpec
    process: subprocess.Popen[bytes] | None = None
    pipe: int = -1
    started_s: float = 0.0
    last_beat_s: float | None = None
    restart_at_s: float | None = None
    delay_s: float = _FIRST_DELAY_S
    restarts: int = 0
    stopped: bool = field(default=False)


class Supervisor:
    """Runs the processes of one side.

    Args:
        specs: what to run, in starting order.
        arguments: command-line arguments of each process after its name (`--config …`).
    """

    def __init__(self, specs: Sequence[ProcessSpec], arguments: Sequence[str]):
        self._children = [_Child(spec) for spec in specs]
        self._arguments = list(arguments)

    def run(self, stop: threading.Event) -> int:
        """Supervise until told to stop, or until a process reports that it can never run; returns the exit code."""
        try:
            for child in self._children:
                self._start(child)
            while not stop.wait(_POLL_S):
                for child in self._children:
                    code = self._look_after(child)
                    if code is not None:
                        return code
            return 0
        finally:
            self._end_all()

    def _start(self, child: _Child) -> None:
        read_end, write_end = os.pipe()
        fcntl.fcntl(read_end, fcntl.F_SETFL, os.O_NONBLOCK)
        fcntl.fcntl(write_end, fcntl.F_SETFL, os.O_NONBLOCK)
        command = [sys.executable, "-m", "common.cli", "node", child.spec.name, *self._arguments]
        environment = {**os.environ, heartbeat.VARIABLE: str(write_end)}
        child.process = subprocess.Popen(
            command,
            env=environment,
            pass_fds=(write_end,),
            stdin=subprocess.DEVNULL,
            # Its own process group: Ctrl-C reaches the supervisor alone, which then ends everything in order.
            process_group=0,
            preexec_fn=None if child.spec.outlives_supervisor else _end_with_parent,
        )
        os.close(write_end)
        child.pipe = read_end
        child.started_s = time.monotonic()
        child.last_beat_s = None
        child.restart_at_s = None
        log.debug("%s started, pid %d", child.spec.name, child.process.pid)

    def _look_after(self, child: _Child) -> int | None:
        """Notice death, hang and recovery of one child; an exit code when the side must end."""
        now_s = time.monotonic()
        if child.restart_at_s is not None:
            if now_s >= child.restart_at_s:
                child.restarts += 1
                self._start(child)
            return None
        if child.process is None:
            return None
        code = child.process.poll()
        if code is None:
            self._check_heartbeat(child, now_s)
            return None
        os.close(child.pipe)
        if code in (EXIT_CONFIG, EXIT_ALREADY_RUNNING):
            # It has said why in its own line; repeating it as configured cannot help.
            log.error("%s cannot run (exit code %d, see above): ending this side", child.spec.name, code)
            child.process = None
            return code
        child.delay_s = (
            _FIRST_DELAY_S if now_s - child.started_s > _STABLE_S else min(child.delay_s * 2, _LONGEST_DELAY_S)
        )
        log.warning("%s ended (%s), restarting in %.1f s", child.spec.name, _describe(code), child.delay_s)
        child.process = None
        child.restart_at_s = now_s + child.delay_s
        return None

    def _check_heartbeat(self, child: _Child, now_s: float) -> None:
        with contextlib.suppress(BlockingIOError):
            if os.read(child.pipe, 4096):
                child.last_beat_s = now_s
        since_s = now_s - (child.last_beat_s or child.started_s)
        limit_s = _HUNG_AFTER_S if child.last_beat_s is not None else _START_PATIENCE_S
        if since_s > limit_s and child.process is not None:
            log.error("%s has not turned its loop for %.0f s: killing it", child.spec.name, since_s)
            child.process.kill()

    def _end_all(self) -> None:
        living = [c for c in self._children if c.process is not None and c.process.poll() is None]
        for child in reversed(living):
            child.process.send_signal(signal.SIGTERM)  # type: ignore[union-attr]
        deadline_s = time.monotonic() + _GRACE_S
        for child in reversed(living):
            try:
                child.process.wait(max(0.0, deadline_s - time.monotonic()))  # type: ignore[union-attr]
            except subprocess.TimeoutExpired:
                log.warning("%s did not end in %.0f s: killing it", child.spec.name, _GRACE_S)
                child.process.kill()  # type: ignore[union-attr]
                child.process.wait()  # type: ignore[union-attr]


def _end_with_parent() -> None:
    """Ask the kernel to end this process when its supervisor dies, so that nothing is left behind."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def _describe(code: int) -> str:
    if code < 0:
        return f"signal {signal.Signals(-code).name}"
    return f"exit code {code}"
