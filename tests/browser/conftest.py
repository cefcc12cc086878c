"""Fixtures of the browser tests: routers, a scripted vehicle, the console in a process, Chromium."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import IO
from urllib.error import HTTPError

import msgspec
import pytest
from playwright.sync_api import Browser

from common.session import BusConfig, open_router
from tests.browser.script import Script
from tests.browser.scripted import ScriptedVehicle
from tests.browser.view import View, chromium_started, load, open_view, wait_for
from tests.machine import free_ports

ROOT = Path(__file__).parents[2]


def start_node(name: str, tables: dict[str, object], log: IO[bytes]) -> subprocess.Popen:
    """A node as a process; its standard error goes to a file."""
    return subprocess.Popen(
        [sys.executable, "-m", "tests.browser.node_process", name, json.dumps(tables)],
        cwd=ROOT,
        stderr=log,
        stdout=subprocess.DEVNULL,
    )


class Console:
    """The console as a process.

    Args:
        bus_config: routers.
        port: of the page.
        log: file that its standard error is added to.
        settings: more of its section.
    """

    def __init__(self, bus_config: BusConfig, port: int, log: Path, settings: dict[str, object] | None = None):
        self.url = f"http://127.0.0.1:{port}"
        tables = {"bus": msgspec.to_builtins(bus_config), "console": {"port": port, **(settings or {})}}
        self._log = log.open("ab")
        self.process = start_node("console", tables, self._log)
        wait_for(lambda: self._listens(port), what="the console's port")

    def _listens(self, port: int) -> bool:
        assert self.process.poll() is None, "the console ended by itself"
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=5) as answer:
                return answer.status == 200
        except HTTPError as answer:
            return answer.code == 401  # it listens, and asks for its password
        except OSError:
            return False

    def cpu_s(self) -> float:
        """CPU time used so far, s."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def close(self, how: int = signal.SIGTERM) -> int:
        """End it; returns its exit code."""
        if self.process.poll() is None:
            self.process.send_signal(how)
        try:
            code = self.process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            code = self.process.wait()
        self._log.close()
        return code


@pytest.fixture(scope="session")
def bus_config() -> Iterator[BusConfig]:
    """Routers of both sides on free ports."""
    onboard, ground = (f"tcp/127.0.0.1:{port}" for port in free_ports(2))
    config = BusConfig(onboard_router=onboard, ground_router=ground, link=onboard)
    routers = [open_router(config, "onboard"), open_router(config, "ground")]
    yield config
    for router in routers:
        router.close()


@pytest.fixture(scope="session")
def long_lived_vehicle(bus_config: BusConfig) -> Iterator[ScriptedVehicle]:
    """The vehicle of all tests."""
    vehicle = ScriptedVehicle(bus_config)
    yield vehicle
    vehicle.close()


@pytest.fixture
def vehicle(long_lived_vehicle: ScriptedVehicle) -> ScriptedVehicle:
    """The scripted vehicle with its script at the beginning and no commands noted."""
    long_lived_vehicle.script = Script()
    long_lived_vehicle.commands.clear()
    long_lived_vehicle.requests.clear()
    return long_lived_vehicle


@pytest.fixture(scope="session")
def console(bus_config: BusConfig, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Console]:
    """The console of all tests that do not end it."""
    console = Console(bus_config, free_ports(1)[0], tmp_path_factory.mktemp("console") / "console.log")
    yield console
    console.close()


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """Chromium for all tests."""
    with chromium_started() as browser:
        yield browser


@pytest.fixture
def nobody_else_looks(browser: Browser) -> None:
    """No other page draws: two of them starve each other on software GL."""
    for context in browser.contexts:
        for page in context.pages:
            page.goto("about:blank")


@pytest.fixture(scope="session")
def long_lived_view(browser: Browser, console: Console, long_lived_vehicle: ScriptedVehicle) -> Iterator[View]:
    """The page of all tests that do not end it: to load it costs more than most tests."""
    view = open_view(browser, console.url)
    yield view
    view.page.close()


@pytest.fixture
def view(long_lived_view: View, console: Console, vehicle: ScriptedVehicle) -> View:
    """The page as it is when it was just loaded: the picture, the first tab, no notes, no hand on the stick."""
    page = long_lived_view.page
    if page.url == "about:blank":
        load(long_lived_view, console.url)
    for button in (
        page.get_by_role("button", name="Show picture"),
        page.frame_locator("#outrider-stick").get_by_role("button", name="Let go"),
        page.get_by_role("tab", name="Target"),
    ):
        if button.count():
            button.first.click()
    notes = ".mantine-Notification-closeButton"
    page.evaluate(f"() => document.querySelectorAll('{notes}').forEach((button) => button.click())")
    wait_for(lambda: page.locator(notes).count() == 0, what="the last test's notes gone")
    long_lived_view.wait_text("hovering at the anchor")
    wait_for(lambda: page.locator(".hud").count() == 0, what="the last test's obstacles gone")
    vehicle.commands.clear()
    vehicle.requests.clear()
    return long_lived_view
