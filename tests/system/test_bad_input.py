"""Wrong starts: one line that says what, got, expected and what to do, and an exit code that is not zero."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tests.machine import free_ports
from tests.system.flight import Flight, Seen
from tests.system.stack import Stack

MakeStack = Callable[..., Stack]


def _outrider(
    *arguments: str, timeout_s: float = 30, environment: dict[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "common.cli", *arguments],
        capture_output=True,
        text=True,
        timeout=timeout_s,
        stdin=subprocess.DEVNULL,
        env={**os.environ, **(environment or {})},
    )


WRONG = [
    (("onboard", "--set", "helm.autopilot_url=udp:/127.0.0.1"), ("autopilot_url", "udp:/127.0.0.1", "udpin://")),
    (("onboard", "--set", "helm.freshnes_s=0.2"), ("freshnes_s", "did you mean 'freshness_s'")),
    (("onboard", "--set", "helmm.freshness_s=0.2"), ("helmm", "did you mean 'helm'")),
    (("onboard", "--set", "helm.freshness_s=fast"), ("freshness_s", "float")),
    (("onboard", "--config", "kyte"), ("kyte", "kite")),
    (("onboard", "--source", "no/such/film.avi"), ("no/such/film.avi", "does not exist")),
    (("sim", "--scenario", "mars"), ("mars", "chase")),
    (("node", "persuit"), ("persuit", "did you mean 'pursuit'")),
    (("ground", "--without", "camera"), ("camera", "console")),
    (("do", "jump"), ("jump", "takeoff")),
    (("demo", "--scenario", "mars"), ("mars", "chase")),
]


@pytest.fixture(scope="module")
def wrong_starts() -> dict[tuple[str, ...], subprocess.CompletedProcess[str]]:
    """What each wrong command line came to: they run at once, since each is a second of imports."""
    lines = [arguments for arguments, _ in WRONG]
    with ThreadPoolExecutor(4) as at_once:
        return dict(zip(lines, at_once.map(lambda line: _outrider(*line), lines), strict=True))


@pytest.mark.parametrize(("arguments", "words"), WRONG)
def test_wrong_command_line_is_one_clear_line(
    wrong_starts: dict[tuple[str, ...], subprocess.CompletedProcess[str]],
    arguments: tuple[str, ...],
    words: tuple[str, ...],
) -> None:
    result = wrong_starts[arguments]
    assert result.returncode == 2, result.stderr
    lines = result.stderr.splitlines()
    assert any(all(word in line for word in words) for line in lines), result.stderr
    assert "Traceback" not in result.stderr


def test_typo_in_a_file_names_file_and_key(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("[camera.down]\nfx_pixel = 400.0\n")
    result = _outrider("onboard", "--config", str(path))
    assert result.returncode == 2
    assert "mine.toml" in result.stderr
    assert "did you mean 'fx_px'" in result.stderr


def test_taken_router_port_ends_the_side(make_stack: MakeStack) -> None:
    stack = make_stack()
    with socket.create_server(("127.0.0.1", stack.onboard_port)):
        process = stack.start("onboard")
        assert process.wait(20) == 2
    assert f"{stack.onboard_port}" in stack.log("onboard")
    assert "set bus.onboard_router to a free port" in stack.log("onboard")
    assert "Traceback" not in stack.log("onboard")


def test_taken_console_port_is_named(make_stack: MakeStack) -> None:
    stack = make_stack()
    with socket.create_server(("127.0.0.1", stack.console_port)):
        process = stack.start("ground")
        assert process.wait(25) == 2
    assert str(stack.console_port) in stack.log("ground")
    assert "console.port" in stack.log("ground")


@pytest.mark.own_autopilot
def test_taken_autopilot_port_is_named(make_stack: MakeStack) -> None:
    stack = make_stack()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", stack.autopilot_onboard))
        result = _outrider("node", "autopilot", *stack.arguments())
    assert result.returncode == 2
    assert str(stack.autopilot_onboard) in result.stderr
    assert "Traceback" not in result.stderr


@pytest.mark.own_autopilot
def test_a_demo_one_of_whose_sides_ends_is_a_failure(make_stack: MakeStack) -> None:
    stack = make_stack()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", stack.autopilot_onboard))
        result = _outrider("demo", "--headless", *stack.arguments(), timeout_s=60)
    assert result.returncode == 1
    assert "the sim side ended with exit code 2" in result.stderr
    assert "Traceback" not in result.stderr


def test_missing_graphics_library_names_the_packages(make_stack: MakeStack, tmp_path: Path) -> None:
    # An EGL vendor folder without a vendor is what a machine without Mesa looks like to the loader.
    stack = make_stack("world.scenario=calm")
    stack.start("onboard")
    stack.bus("onboard")
    result = _outrider(
        "node",
        "world",
        *stack.arguments(),
        environment={"__EGL_VENDOR_LIBRARY_DIRS": str(tmp_path), "LIBGL_DRIVERS_PATH": str(tmp_path)},
    )
    assert result.returncode == 2, result.stderr
    assert "libegl1" in result.stderr
    assert "Traceback" not in result.stderr


@pytest.mark.own_autopilot
def test_unreachable_autopilot_is_reported_and_waited_for(make_stack: MakeStack) -> None:
    stack = make_stack()
    stack.start("onboard")
    bus = stack.bus("onboard")
    status = Seen(bus, "helm/status")
    deadline = time.monotonic() + 20
    while status.last is None and time.monotonic() < deadline:
        time.sleep(0.1)
    assert status.last is not None, stack.logs()
    assert status.last.state == "disconnected"
    assert f"udpin://127.0.0.1:{stack.helm_port}" in status.last.reason
    reply = bus.query("helm/do/takeoff")
    assert reply.outcome == "refused"
    assert reply.reason


def test_commands_without_a_router_say_what_to_start() -> None:
    port = free_ports(1)[0]
    result = _outrider("do", "hold", "--set", f"bus.ground_router=tcp/127.0.0.1:{port}")
    assert result.returncode == 2
    assert "no Zenoh router answers" in result.stderr
    assert "outrider ground" in result.stderr


@pytest.mark.own_autopilot
def test_ctrl_c_ends_every_process_within_five_seconds(make_stack: MakeStack) -> None:
    stack = make_stack("world.scenario=calm")
    for side in ("ground", "sim", "onboard"):  # in an order that nobody would choose
        stack.start(side)
    flight = Flight(stack)
    flight.ready()
    names = (
        "router-onboard",
        "camera",
        "helm",
        "router-ground",
        "pursuit",
        "console",
        "recorder",
        "autopilot",
        "world",
    )
    pids = {name: stack.pid(name) for name in names}
    assert None not in pids.values(), pids
    start = time.monotonic()
    codes = stack.end()
    assert time.monotonic() - start < 5.0
    assert codes == {"ground": 0, "sim": 0, "onboard": 0}
    for name, pid in pids.items():
        assert not Path(f"/proc/{pid}").exists(), f"{name} was left behind"


def test_ground_cannot_read_the_vehicle_s_raw_pictures(make_stack: MakeStack) -> None:
    stack = make_stack("video.source=" + str(_two_pictures(make_stack)))
    stack.start("onboard", "--without", "helm")
    stack.start("ground", "--without", "console")
    near, far = Seen(stack.bus("onboard"), "camera/down/raw"), Seen(stack.bus("ground"), "camera/down/raw")
    crossing = Seen(stack.bus("ground", "second"), "camera/down/jpeg")
    deadline = time.monotonic() + 20
    while (len(near.all) < 20 or len(crossing.all) < 10) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert len(near.all) >= 20
    assert len(crossing.all) >= 10
    assert far.all == []


def _two_pictures(make_stack: MakeStack) -> Path:
    import cv2
    import numpy as np

    folder = make_stack().folder
    for index in range(2):
        cv2.imwrite(str(folder / f"{index}.png"), np.full((480, 640, 3), 80 * index, np.uint8))
    return folder
