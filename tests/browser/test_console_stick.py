"""The operator's stick in Chromium: keys and pads reach helm, and whatever ends the hand on it ends the motion."""

from __future__ import annotations

import math
import time

import pytest
from playwright.sync_api import Browser, FrameLocator

from common.messages import Vec3
from tests.browser.conftest import Console
from tests.browser.scripted import ScriptedVehicle
from tests.browser.view import View, open_view, wait_for

HOVER: Vec3 = (0.0, 0.0, 0.0)
FRESH_S = 0.3
"""Helm's limit for the age of a request."""
SLACK_S = 0.6
"""For a busy machine: the browser's own delays are in what is measured."""


def stick_of(view: View) -> FrameLocator:
    return view.page.frame_locator("#outrider-stick")


def take(view: View) -> FrameLocator:
    frame = stick_of(view)
    frame.get_by_role("button", name="Take stick").click()
    frame.get_by_text("ready (helm: hold)").wait_for(state="visible")
    return frame


def moving(vehicle: ScriptedVehicle) -> bool:
    return bool(vehicle.requests) and vehicle.requests[-1].message.vector != HOVER


def hovers_within_the_limit(vehicle: ScriptedVehicle, since_ns: int, what: str) -> None:
    """The last request that moves is obeyed until it is stale, or until a hover is asked for: soon, either way."""
    wait_for(lambda: vehicle.requests[-1].message.vector == HOVER, 3.0, f"a hover after {what}")
    end_ns = next(r.received_ns for r in vehicle.requests if r.received_ns > since_ns and r.message.vector == HOVER)
    moved = [r for r in vehicle.requests if r.message.vector != HOVER]
    assert moved[-1].received_ns < end_ns, f"it moved again after {what}"
    stale_ns = moved[-1].header.capture_ns + int(FRESH_S * 1e9)
    assert (min(end_ns, stale_ns) - since_ns) / 1e9 < FRESH_S + SLACK_S, what
    time.sleep(0.5)
    assert time.monotonic_ns() - vehicle.requests[-1].received_ns > 100_000_000, f"requests go on after {what}"
    vehicle.requests.clear()


def test_keys_and_pads_fly_and_letting_go_hovers(view: View, vehicle: ScriptedVehicle) -> None:
    view.page.keyboard.down("w")
    time.sleep(0.3)
    view.page.keyboard.up("w")
    assert vehicle.requests == [], "keys do nothing before the stick is taken"

    frame = take(view)
    view.page.keyboard.down("w")
    wait_for(lambda: len(vehicle.requests) >= 20, what="requests")
    asked = [r for r in vehicle.requests if r.message.vector != HOVER]
    assert {r.message.vector for r in asked} == {(1.0, 0.0, 0.0)}
    assert {r.message.frame for r in asked} == {"heading"}
    rate_hz = (len(asked) - 1) / ((asked[-1].received_ns - asked[0].received_ns) / 1e9)
    assert 8.0 < rate_hz < 26.0, f"{rate_hz:.0f} Hz"
    assert max(r.received_ns - r.header.capture_ns for r in asked) < FRESH_S * 1e9, "stale before it comes to helm"
    since_ns = time.monotonic_ns()
    view.page.keyboard.up("w")
    hovers_within_the_limit(vehicle, since_ns, "the key's release")

    pad = frame.locator("#level").bounding_box()
    assert pad is not None
    x, y = pad["x"] + pad["width"] / 2, pad["y"] + pad["height"] / 2
    view.page.mouse.move(x, y)
    view.page.mouse.down()
    view.page.mouse.move(x + 60, y + 60)  # beyond its reach, to the back and right
    wait_for(lambda: moving(vehicle), what="a request of the pad")
    time.sleep(0.2)
    half = math.sqrt(0.5)
    assert vehicle.requests[-1].message.vector == pytest.approx((-half, half, 0.0), abs=0.03)
    since_ns = time.monotonic_ns()
    view.page.mouse.up()
    hovers_within_the_limit(vehicle, since_ns, "the pad's release")

    for key, vector, turn in (("r", (0.0, 0.0, -0.7), 0.0), ("ArrowLeft", (0.0, -1.0, 0.0), 0.0), ("e", HOVER, 0.6)):
        view.page.keyboard.down(key)
        wait_for(
            lambda v=vector, t=turn: (
                vehicle.requests
                and vehicle.requests[-1].message.vector == pytest.approx(v)
                and vehicle.requests[-1].message.yaw_rate_rad_s == pytest.approx(t)
            ),
            what=f"the request of key {key}",
        )
        view.page.keyboard.up(key)

    frame.get_by_role("button", name="Let go").click()
    time.sleep(0.5)
    vehicle.requests.clear()
    view.page.keyboard.down("w")
    time.sleep(0.3)
    view.page.keyboard.up("w")
    assert vehicle.requests == [], "the stick was let go"


def test_what_ends_the_hand_ends_the_motion(
    view: View, browser: Browser, console: Console, vehicle: ScriptedVehicle
) -> None:
    def fly(view: View) -> None:
        view.page.keyboard.down("w")
        wait_for(lambda: moving(vehicle), what="motion")
        time.sleep(0.2)

    take(view)
    fly(view)
    since_ns = time.monotonic_ns()
    view.page.evaluate("() => { const end = performance.now() + 1500; while (performance.now() < end); }")
    hovers_within_the_limit(vehicle, since_ns, "the page hung")
    view.page.keyboard.up("w")

    fly(view)
    since_ns = time.monotonic_ns()
    view.page.evaluate(
        """() => { for (const w of [window, document.getElementById("outrider-stick").contentWindow]) {
             w.document.hasFocus = () => false; w.dispatchEvent(new Event("blur")); } }"""
    )
    hovers_within_the_limit(vehicle, since_ns, "the window lost the focus")
    view.page.evaluate(
        """() => { for (const w of [window, document.getElementById("outrider-stick").contentWindow])
             delete w.document.hasFocus; }"""
    )
    view.page.keyboard.up("w")

    second = open_view(browser, console.url)
    fly(view)
    take(second)  # the clicks take their time; by its end the first one's motion must be over
    taken_ns = time.monotonic_ns()
    time.sleep(1.0)
    moved = [r for r in vehicle.requests if r.message.vector != HOVER]
    assert (moved[-1].received_ns - taken_ns) / 1e9 < FRESH_S, "a second operator took the stick"
    assert vehicle.requests[-1].message.vector == HOVER
    vehicle.requests.clear()
    stick_of(view).get_by_text("let go and push again").wait_for(state="visible")
    view.page.keyboard.up("w")

    fly(second)
    since_ns = time.monotonic_ns()
    second.page.close()
    hovers_within_the_limit(vehicle, since_ns, "the page was closed")
