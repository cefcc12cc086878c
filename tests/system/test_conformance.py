"""`outrider conformance` as its user runs it: real autopilot processes, real MAVLink, both drags at once."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.machine import free_ports

_DRAGS = (0.1, 1.0)


class Autopilot:
    """A simulated autopilot on ports of its own, and the checks against it."""

    def __init__(self, folder: Path, drag_n_s_m: float):
        self.folder = folder
        ports = free_ports(6)
        names = [f"{link}.{end}_port" for link in ("onboard", "ground", "truth") for end in ("local", "remote")]
        settings = [f"autopilot.{name}={port}" for name, port in zip(names, ports, strict=True)]
        settings.append(f"autopilot.drag_n_s_m={drag_n_s_m}")
        self.url = f"udpin://127.0.0.1:{ports[1]}"
        self.process = _outrider(
            folder / "autopilot.log", "node", "autopilot", *(part for s in settings for part in ("--set", s))
        )

    def check(self, *arguments: str) -> subprocess.Popen[bytes]:
        return _outrider(self.folder / "conformance.log", "conformance", self.url, *arguments)

    def log(self, of: str = "conformance") -> str:
        return (self.folder / f"{of}.log").read_text(errors="replace")

    def wait_ready(self) -> None:
        """Until it flies: on a busy machine it starts more slowly than the checks, which wait for 8 s alone."""
        start_s = time.monotonic()
        while "cycles a second" not in self.log("autopilot"):
            assert time.monotonic() - start_s < 60 and self.process.poll() is None, self.log("autopilot")
            time.sleep(0.1)


def _outrider(log: Path, *arguments: str) -> subprocess.Popen[bytes]:
    with log.open("wb") as output:
        return subprocess.Popen(
            [sys.executable, "-u", "-m", "common.cli", *arguments],
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
            env={**os.environ, "XDG_RUNTIME_DIR": str(log.parent)},
        )


@pytest.fixture
def autopilots(tmp_path: Path) -> Iterator[list[Autopilot]]:
    made = []
    for drag in _DRAGS:
        folder = tmp_path / f"drag{drag}"
        folder.mkdir()
        made.append(Autopilot(folder, drag))
    for autopilot in made:
        autopilot.wait_ready()
    yield made
    for autopilot in made:
        autopilot.process.send_signal(signal.SIGINT)
        autopilot.process.wait(10)


@pytest.mark.timeout(200)
def test_the_quick_checks_pass_with_both_drags(autopilots: list[Autopilot]) -> None:
    runs = [a.check("--quick", "--json", str(a.folder / "report.json")) for a in autopilots]
    codes = [run.wait(180) for run in runs]
    assert codes == [0, 0], "\n".join(a.log() for a in autopilots)
    for autopilot, drag in zip(autopilots, _DRAGS, strict=True):
        checks = {c["name"]: c for c in json.loads((autopilot.folder / "report.json").read_text())["checks"]}
        assert {c["outcome"] for c in checks.values()} == {"pass"}
        assert f"({drag:g} N per m/s)" in json.dumps(checks["step"])


@pytest.mark.timeout(120)
def test_ctrl_c_in_the_air_lands_and_disarms(autopilots: list[Autopilot]) -> None:
    autopilot = autopilots[0]
    run = autopilot.check("--only", "takeoff", "--only", "yielding")
    start_s = time.monotonic()
    while "pass      takeoff" not in autopilot.log():
        assert time.monotonic() - start_s < 40 and run.poll() is None, autopilot.log()
        time.sleep(0.2)
    run.send_signal(signal.SIGINT)
    assert run.wait(40) == 130
    assert "landed and disarmed" in autopilot.log()
    after = autopilot.check("--only", "connect")  # base_mode and system_status of a disarmed vehicle
    assert after.wait(45) == 0, autopilot.log()
