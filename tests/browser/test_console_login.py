"""A console that others can reach, in Chromium: the login page, the password, the session, and a restart in flight."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page

from common.session import BusConfig
from ground.console.password import make_hash, write_hash
from tests.browser.conftest import Console
from tests.browser.scripted import ScriptedVehicle
from tests.browser.view import WAIT_MS, View, wait_for
from tests.machine import free_ports

PASSWORD = "brake to rest, then hold"


@pytest.fixture
def settings(tmp_path: Path) -> dict[str, object]:
    write_hash(tmp_path / "password", make_hash(PASSWORD))
    return {"host": "0.0.0.0", "password_file": str(tmp_path / "password")}


@pytest.fixture
def page(browser: Browser) -> Iterator[Page]:
    context = browser.new_context(viewport={"width": 1000, "height": 700})
    yield context.new_page()
    context.close()


def log_in(page: Page, password: str) -> None:
    page.get_by_label("Password").fill(password)
    page.get_by_role("button", name="Open the console").click()


def test_console_opens_with_the_password_alone_and_a_restart_keeps_the_session(
    bus_config: BusConfig, vehicle: ScriptedVehicle, settings: dict[str, object], page: Page, tmp_path: Path
) -> None:
    port, log = free_ports(1)[0], tmp_path / "console.log"
    console = Console(bus_config, port, log, settings)
    view = View(page)
    try:
        page.goto(console.url)
        log_in(page, "not the password")
        view.wait_text("Wrong password.")
        opened = page.evaluate(
            """() => new Promise((resolve) => {
                 const socket = new WebSocket(location.href.replace("http", "ws"));
                 socket.onopen = () => resolve(true);
                 socket.onerror = () => resolve(false); })"""
        )
        assert opened is False, "a browser's page alone must not get a websocket"
        assert page.locator("canvas").count() == 0

        log_in(page, PASSWORD)
        view.wait_text("Commanded by")
        view.button("Hold")
        wait_for(lambda: vehicle.commands, what="the command at helm")

        console.close()
        console = Console(bus_config, port, log, settings)
        vehicle.commands.clear()
        page.reload()
        view.wait_text("Commanded by", WAIT_MS)
        assert page.get_by_label("Password").count() == 0
    finally:
        console.close()
    said = log.read_text()
    assert "login from 127.0.0.1" in said
    assert PASSWORD not in said
