"""The supervisor with real child processes: restart, hang, refusal, ending together."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from pathlib import Path

import pytest

from common import supervisor as module
from common.processes import ProcessSpec
from common.supervisor import EXIT_CONFIG, Supervisor


def _wait(condition, limit_s: float = 8.0) -> None:
    deadline = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < deadline, "condition not reached in time"
        time.sleep(0.02)


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Starts a supervisor over children that run a script instead of `outrider node`; ends it after the test."""
    stop = threading.Event()
    threads: list[threading.Thread] = []
    codes: list[int] = []
    real_popen = module.subprocess.Popen

    def start(script: str, names: tuple[str, ...] = ("child",)) -> list[int]:
        path = tmp_path / "child.py"
        path.write_text(script)

        def popen(command, **kwargs):
            return real_popen([sys.executable, str(path), command[4], str(tmp_path)], **kwargs)

        monkeypatch.setattr(module.subprocess, "Popen", popen)
        specs = [ProcessSpec(name, "onboard", "x:y", "", "onboard") for name in names]
        thread = threading.Thread(target=lambda: codes.append(Supervisor(specs, []).run(stop)))
        thread.start()
        threads.append(thread)
        return codes

    yield start
    stop.set()
    for thread in threads:
        thread.join(10)
        assert not thread.is_alive()


NOTE_PID = """
import os, sys, time, pathlib
name, folder = sys.argv[1:]
with open(pathlib.Path(folder) / f"{name}.pids", "a") as file:
    print(os.getpid(), file=file)
"""
BEAT = """
fd = int(os.environ["OUTRIDER_HEARTBEAT_FD"])
while True:
    os.write(fd, b".")
    time.sleep(0.1)
"""


def _pids(folder: Path, name: str = "child") -> list[int]:
    path = folder / f"{name}.pids"
    return [int(line) for line in path.read_text().split()] if path.exists() else []


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_killed_child_is_restarted(run, tmp_path: Path) -> None:
    run(NOTE_PID + BEAT)
    _wait(lambda: len(_pids(tmp_path)) == 1)
    os.kill(_pids(tmp_path)[0], signal.SIGKILL)
    _wait(lambda: len(_pids(tmp_path)) == 2)
    assert _alive(_pids(tmp_path)[1])


def test_hung_child_is_killed_and_restarted(run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_HUNG_AFTER_S", 0.6)
    run(NOTE_PID + 'os.write(int(os.environ["OUTRIDER_HEARTBEAT_FD"]), b".")\ntime.sleep(60)\n')
    _wait(lambda: len(_pids(tmp_path)) >= 2)
    assert not _alive(_pids(tmp_path)[0])


def test_child_that_cannot_run_ends_the_side(run, tmp_path: Path) -> None:
    script = NOTE_PID + f"if name == 'bad': sys.exit({EXIT_CONFIG})\n" + BEAT
    codes = run(script, ("good", "bad"))
    _wait(lambda: codes == [EXIT_CONFIG])
    assert not any(_alive(pid) for pid in _pids(tmp_path, "good"))


def test_restarts_back_off(run, tmp_path: Path) -> None:
    run(NOTE_PID + "sys.exit(1)\n")
    time.sleep(2.5)
    # Delays of 0.4, 0.8 and 1.6 s: without a back-off there would be dozens.
    assert 2 <= len(_pids(tmp_path)) <= 5


def test_child_that_ignores_the_signal_is_killed_at_the_end(
    run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_GRACE_S", 0.5)
    script = NOTE_PID + "import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN)\n"
    codes = run(
        script + f"if name == 'bad':\n    time.sleep(1)\n    sys.exit({EXIT_CONFIG})\n" + BEAT, ("stubborn", "bad")
    )
    _wait(lambda: codes == [EXIT_CONFIG])
    assert not any(_alive(pid) for pid in _pids(tmp_path, "stubborn"))
