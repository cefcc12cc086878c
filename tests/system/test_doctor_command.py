"""`outrider doctor` and `outrider preflight` on a running system, as a user runs them."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

from tests.system.stack import Stack


def outrider(stack: Stack, command: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a command to its end."""
    return subprocess.run(
        [sys.executable, "-m", "common.cli", command, *arguments, *stack.arguments()],
        capture_output=True,
        text=True,
        timeout=60,
        stdin=subprocess.DEVNULL,
    )


def examined(stack: Stack) -> tuple[int, dict[str, dict[str, Any]], str]:
    """Exit code, findings by subject, and everything that was said."""
    began_s = time.monotonic()
    result = outrider(stack, "doctor", "--json")
    assert time.monotonic() - began_s < 12.0, "the doctor takes less than 10 s, and its start"
    findings = json.loads(result.stdout)["findings"]
    return result.returncode, {f["subject"]: f for f in findings}, result.stdout + result.stderr


def test_a_running_system_is_well_and_a_dead_autopilot_is_found_with_its_cure(
    make_stack: Callable[..., Stack],
) -> None:
    stack = make_stack("world.scenario=calm")
    for side in ("onboard", "sim", "ground"):
        stack.start(side)
    gate = outrider(stack, "preflight", "--wait", "40")
    assert gate.returncode == 0, gate.stdout + gate.stderr + stack.logs()
    assert gate.stdout.startswith("kite: gate open; helm: standby")
    assert gate.stdout.count("✓") == len(gate.stdout.splitlines()) - 2

    code, well, said = examined(stack)

    assert code == 0, said
    assert well["link to the vehicle"]["severity"] == "ok"
    seen = set(well["nodes seen by the ground router"]["found"].split(", "))
    assert seen >= {"approach", "camera", "follow", "console", "helm", "proximity", "pursuit", "recorder"}, said
    assert f"held by helm, process {stack.pid('helm')}" in well[f"UDP port {stack.helm_port}"]["found"]
    assert {well[name]["severity"] for name in ("helm", "gate: link", "pictures", "autopilot's clock")} <= {
        "ok",
        "warning",
    }

    stack.sides["sim"].kill()  # its processes end with it
    stack.sides["sim"].wait()
    time.sleep(1.5)
    code, ill, said = examined(stack)

    assert code == 1, said
    assert ill["gate: link"]["severity"] == "fault"
    assert "start it, or set helm.autopilot_url" in ill["gate: link"]["cure"]
    assert outrider(stack, "preflight").returncode == 1
