"""The console's page in headless Chromium, as an operator has it: looks, presses, chooses, draws."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import cv2
import numpy as np
from playwright.sync_api import Browser, Page, sync_playwright

from tests.machine import chromium

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


@contextmanager
def chromium_started() -> Iterator[Browser]:
    """Headless Chromium with software GL."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=FLAGS)
        yield browser
        browser.close()


def open_view(browser: Browser, url: str) -> View:
    """The console's page in a window of its own, with the first words from the vehicle on it."""
    view = View(browser.new_page(viewport={"width": 1000, "height": 560}))  # software GL pays for every pixel
    load(view, url)
    return view


def load(view: View, url: str) -> None:
    """Load the console's page, and wait for the first words from the vehicle on it."""
    page = view.page
    page.goto(url)
    view.wait_text("Commanded by", 3 * WAIT_MS)  # a busy machine takes its time to load it
    # On software GL the page warns, top left over the picture, where a test may want to draw.
    notice = page.locator(".mantine-Notification-closeButton")
    if notice.count():
        notice.first.click()
        notice.first.wait_for(state="detached")
