"""`outrider topics` against a live bus, as a user runs it."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import pytest

from tests.system.flight import Seen
from tests.system.stack import Stack


@pytest.fixture
def stack(make_stack: Callable[..., Stack]) -> Stack:
    """Both routers; the vehicle's one publishes `session` once a second."""
    stack = make_stack()
    stack.start("onboard", "--without", "camera", "--without", "helm")
    stack.start("ground", "--without", "pursuit", "--without", "console", "--without", "recorder")
    return stack


def outrider_topics(stack: Stack, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the command to its end."""
    return subprocess.run(
        [sys.executable, "-m", "common.cli", "topics", *arguments, *stack.arguments()],
        capture_output=True,
        text=True,
        timeout=30,
        stdin=subprocess.DEVNULL,
    )


def at_once(stack: Stack, *commands: tuple[str, ...]) -> list[subprocess.CompletedProcess[str]]:
    """Run several commands beside each other; they mostly wait."""
    with ThreadPoolExecutor() as pool:
        return list(pool.map(lambda words: outrider_topics(stack, *words), commands))


def test_the_live_bus_is_listed_measured_and_printed(stack: Stack) -> None:
    session = Seen(stack.bus("ground"), "session")
    deadline = time.monotonic() + 20
    while len(session.all) < 2:
        assert time.monotonic() < deadline, stack.logs()
        time.sleep(0.05)

    listed, measured, echoed = at_once(
        stack,
        ("--seconds", "3"),
        ("hz", "session", "helm/state", "--seconds", "4"),
        ("echo", "session", "--count", "2"),
    )

    lines = {line.split()[0]: line for line in listed.stdout.splitlines()}
    assert "1.0 Hz" in lines["session"] and "router-onboard" in lines["session"], listed.stdout
    assert "camera/down/raw" in lines
    rows = {line.split()[0]: line.split() for line in measured.stdout.splitlines()}
    assert float(rows["session"][1]) == pytest.approx(1.0, abs=0.1)
    assert rows["session"][-2:] == ["0", "0"], "nothing lost, nothing refused"
    assert rows["helm/state"][1] == "-"
    shown = [json.loads(line) for line in echoed.stdout.splitlines()]
    assert [s["topic"] for s in shown] == ["session", "session"]
    assert shown[1]["header"]["seq"] == shown[0]["header"]["seq"] + 1
    assert shown[0]["message"]["vehicle"] == "kite"
    assert [r.returncode for r in (listed, measured, echoed)] == [0, 0, 0]


def test_a_wrong_name_is_one_line_and_exit_code_two(stack: Stack) -> None:
    stack.bus("ground")  # waits for the router
    for result in at_once(stack, ("hz", "sesion"), ("echo", "sesion")):
        assert result.returncode == 2
        assert result.stderr.strip().splitlines()[-1].endswith("unknown topic 'sesion'; did you mean 'session'?")
        assert "Traceback" not in result.stderr
