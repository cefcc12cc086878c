"""Fixtures of the browser tests: routers, a scripted vehicle, the console in a process, Chromium."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO
from urllib.error import HTTPError

import cv2
import msgspec
import numpy as np
import pytest
from playwright.sync_api import Browser, Page, TimeoutError, sync_playwright

from common.session import BusConfig, open_router
from tests.browser.scripted import Script, ScriptedVehicle
from tests.machine import chromium, free_ports

ROOT = Path(__file__).parents[2]
FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
]
WAIT_MS = 20_000


def wait_for(condition: Callable[[], object], timeout_s: float = 20.0, what: str = "condition") -> object:
    """The first true value of a condition.

    Raises:
        AssertionError: none within the time.
    """
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        if value := condition():
            return value
        time.sleep(0.05)
    raise AssertionError(f"{what}: not within {timeout_s:g} s")


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


class View:
    """The page in the browser.

    Args:
        page: Playwright's page.
    """

    def __init__(self, page: Page):
        self.page = page

    def text(self) -> str:
        """All text of the page."""
        return self.page.locator("body").inner_text()

    def wait_text(self, text: str, timeout_ms: float = WAIT_MS) -> None:
        """Wait until a text is to be read."""
        self.page.get_by_text(text).first.wait_for(state="visible", timeout=timeout_ms)

    def button(self, label: str) -> None:
        """Press a button."""
        self.page.get_by_role("button", name=label, exact=True).first.click()

    def choose(self, label: str, option: str) -> None:
        """Choose from a list."""
        self.page.get_by_label(label, exact=True).click()
        self.page.get_by_role("option", name=option).click()

    def fill(self, label: str, text: str) -> None:
        """Write into a text field."""
        self.page.get_by_text(label, exact=True).locator("xpath=following::input[1]").fill(text)

    def canvas(self) -> dict[str, float]:
        """Place of the canvas in the window: x, y, width, height, CSS px."""
        box = self.page.locator("canvas").first.bounding_box()
        assert box is not None
        return {name: float(box[name]) for name in ("x", "y", "width", "height")}

    def pixels(self) -> np.ndarray:
        """What the canvas shows, (H, W, 3), BGR."""
        box = self.canvas()
        shot = self.page.screenshot(clip=box)  # type: ignore[arg-type]
        picture = cv2.imdecode(np.frombuffer(shot, np.uint8), cv2.IMREAD_COLOR)
        assert picture is not None
        return np.asarray(picture, np.uint8)

    def middle_share(self, bgr: tuple[int, int, int], tolerance: int = 60) -> float:
        """Share of the middle of the canvas, 120 px square, that has a colour, 0 to 1."""
        pixels = self.pixels().astype(int)
        row, column = pixels.shape[0] // 2, pixels.shape[1] // 2
        middle = pixels[row - 60 : row + 60, column - 60 : column + 60]
        return float((np.abs(middle - bgr).max(axis=2) < tolerance).mean())

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Draw a box with the mouse, CSS px in the window."""
        mouse = self.page.mouse
        mouse.move(*start)
        mouse.down()
        for i in range(1, 6):
            mouse.move(start[0] + (end[0] - start[0]) * i / 5, start[1] + (end[1] - start[1]) * i / 5)
        mouse.up()

    def draw(self, box: tuple[float, float, float, float]) -> None:
        """Draw a box, x, y, width, height, px of the picture of 640x480."""
        canvas = self.canvas()
        scale = min(canvas["width"] / 640, canvas["height"] / 480)
        left = canvas["x"] + (canvas["width"] - 640 * scale) / 2
        top = canvas["y"] + (canvas["height"] - 480 * scale) / 2
        x, y, width, height = box
        self.drag((left + x * scale, top + y * scale), (left + (x + width) * scale, top + (y + height) * scale))


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
    """Headless Chromium with software GL."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=FLAGS)
        yield browser
        browser.close()


def open_view(browser: Browser, console: Console) -> View:
    """The console's page in a window of its own, with the first words from the vehicle on it."""
    view = View(browser.new_page(viewport={"width": 1000, "height": 560}))  # software GL pays for every pixel
    load(view, console)
    return view


def load(view: View, console: Console) -> None:
    """Load the console's page, and wait for the first words from the vehicle on it."""
    page = view.page
    page.goto(console.url)
    view.wait_text("Commanded by", 3 * WAIT_MS)  # a busy machine takes its time to load it
    # On software GL the page warns, top left over the picture, where a test may want to draw.
    notice = page.locator(".mantine-Notification-closeButton")
    if notice.count():
        notice.first.click()
        notice.first.wait_for(state="detached")


@pytest.fixture
def nobody_else_looks(browser: Browser) -> None:
    """No other page draws: two of them starve each other on software GL."""
    for context in browser.contexts:
        for page in context.pages:
            page.goto("about:blank")


@pytest.fixture(scope="session")
def long_lived_view(browser: Browser, console: Console, long_lived_vehicle: ScriptedVehicle) -> Iterator[View]:
    """The page of all tests that do not end it: to load it costs more than most tests."""
    view = open_view(browser, console)
    yield view
    view.page.close()


@pytest.fixture
def view(long_lived_view: View, console: Console, vehicle: ScriptedVehicle) -> View:
    """The page as it is when it was just loaded: the picture, the first tab, no notes, no hand on the stick."""
    page = long_lived_view.page
    if page.url == "about:blank":
        load(long_lived_view, console)
    for button in (
        page.get_by_role("button", name="Show picture"),
        page.frame_locator("#outrider-stick").get_by_role("button", name="Let go"),
        page.get_by_role("tab", name="Target"),
    ):
        if button.count():
            button.first.click()
    notes = page.locator(".mantine-Notification-closeButton")
    while notes.count():
        with contextlib.suppress(TimeoutError):  # it closed by itself meanwhile
            notes.first.click(timeout=500)
    long_lived_view.wait_text("hovering at the anchor")
    wait_for(lambda: page.locator(".hud").count() == 0, what="the last test's obstacles gone")
    vehicle.commands.clear()
    vehicle.requests.clear()
    return long_lived_view
