"""The console in Chromium, against real routers, a real console process and a scripted vehicle."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from threading import Event

import numpy as np
import pytest
from playwright.sync_api import Browser, expect

from common.messages import MemberBox, PreflightItem, Reply
from common.session import BusConfig
from tests.browser.conftest import Console
from tests.browser.script import CHECKS, barrel
from tests.browser.scripted import ScriptedVehicle
from tests.browser.view import WAIT_MS, View, open_view, wait_for
from tests.machine import free_ports

GREEN = (132, 220, 61)
ORANGE = (28, 159, 255)
BLUE = (255, 168, 74)
VIOLET = (255, 140, 214)


@pytest.fixture
def own_console(bus_config: BusConfig, tmp_path: Path) -> Iterator[Console]:
    """A console that the test may stop or kill."""
    console = Console(bus_config, free_ports(1)[0], tmp_path / "console.log")
    yield console
    if console.process.poll() is None:
        console.process.send_signal(signal.SIGCONT)
    console.close()


def test_page_opens_with_the_vehicle_state(view: View) -> None:
    view.wait_text("All well")
    text = view.text()
    for word in (
        "Outrider · kite",
        "hold",
        "OFFBOARD",
        "in air",
        "5.0 m",
        "87%",
        "hovering at the anchor",
        "safe, nearest 8.4 m",
        "request 42 ms old",
    ):
        assert word in text, f"{word!r} is not on the page:\n{text}"


def test_picture_is_live_and_moves(view: View) -> None:
    first = view.pixels()
    wait_for(lambda: np.abs(view.pixels().astype(int) - first).max() > 100, what="a changed picture")
    red = (np.abs(view.pixels().astype(int) - (40, 40, 200)).max(axis=2) < 50).mean()
    assert red > 0.003, "the car is not to be seen"


def test_target_box_is_green_when_tracked_and_orange_when_lost(view: View, vehicle: ScriptedVehicle) -> None:
    vehicle.script.moving = False  # the car, and with it the box, stands in the middle
    wait_for(lambda: view.middle_share(GREEN) > 0.02, what="a green box")
    assert view.middle_share(ORANGE) < 0.002
    vehicle.script.track_state = "lost"
    vehicle.script.state, vehicle.script.source = "pursuit", "pursuit"
    wait_for(lambda: view.middle_share(ORANGE) > 0.01, what="an orange box")
    assert view.middle_share(GREEN) < 0.002
    view.wait_text("Draw a box around it, or press Hold.")


def test_hold_reaches_helm_and_the_reply_is_shown(view: View, vehicle: ScriptedVehicle) -> None:
    view.button("Hold")
    wait_for(lambda: [name for name, _ in vehicle.commands], what="the command at helm")
    assert [name for name, _ in vehicle.commands] == ["helm/do/hold"]
    assert vehicle.commands[0][1].operator.startswith("console/")
    view.wait_text("Hold: done")


def test_refusal_and_failure_are_shown_with_their_reason(view: View, vehicle: ScriptedVehicle) -> None:
    reason = "battery: got 9 %, expected at least 30 %; charge it <b>"
    vehicle.script.replies = {
        "helm/do/arm": Reply(outcome="refused", reason=reason),
        "helm/do/land": Reply(outcome="failed", reason="no acknowledgement in 2 s"),
    }
    view.button("Arm")
    view.wait_text("Arm: refused")
    wait_for(lambda: view.text().count(reason) >= 2, what="the reason as note and as last command")
    view.button("Land")
    view.wait_text("Land: failed")
    view.wait_text("no acknowledgement in 2 s")


def test_buttons_give_their_commands(view: View, vehicle: ScriptedVehicle) -> None:
    for label, expected in (
        ("Return", ["helm/do/return"]),
        ("Engage", ["helm/do/engage"]),
        ("Start chase", ["helm/do/chase"]),
        ("Stop chase", ["helm/do/hold", "pursuit/do/stop"]),
        ("Follow", ["helm/do/follow"]),
        ("Stop following", ["helm/do/hold", "follow/do/stop"]),
        ("Find target", ["pursuit/do/find"]),
        ("Find again", ["pursuit/do/reinitialise"]),
        ("Disarm", ["helm/do/disarm"]),
        ("Take off", ["helm/do/takeoff"]),
    ):
        vehicle.commands.clear()
        view.button(label)
        wait_for(lambda count=expected: len(vehicle.commands) >= len(count), what=f"the commands of {label}")
        assert [name for name, _ in vehicle.commands] == expected
    assert vehicle.commands[0][1].height_m == 5.0


def test_a_slow_takeoff_does_not_delay_hold(view: View, vehicle: ScriptedVehicle) -> None:
    airborne = vehicle.script.held["helm/do/takeoff"] = Event()
    view.button("Take off")
    view.wait_text("waiting for the reply")
    view.button("Hold")
    view.wait_text("Hold: done", timeout_ms=4000)
    assert "Take off: done" not in view.text()
    airborne.set()
    view.wait_text("Take off: done")


@pytest.mark.parametrize("box", [(200.0, 150.0, 120.0, 90.0), (30.0, 40.0, 60.0, 60.0)])
def test_drawn_box_reaches_the_pursuit_in_picture_pixels(
    view: View, vehicle: ScriptedVehicle, box: tuple[float, float, float, float]
) -> None:
    view.draw(box)
    wait_for(lambda: vehicle.commands, what="the selection")
    name, command = vehicle.commands[0]
    assert name == "pursuit/do/select"
    assert command.box_px == pytest.approx(box, abs=8)
    assert command.capture_ns in vehicle.captures
    assert command.capture_ns >= vehicle.captures[-1] - 2_000_000_000
    view.wait_text("Choose target: done")


def test_box_for_the_follower_reaches_it_and_its_trackers_are_drawn(view: View, vehicle: ScriptedVehicle) -> None:
    vehicle.script.moving = False
    box = (260.0, 200.0, 120.0, 80.0)
    view.choose("A box chooses", "what the vehicle follows by itself")
    view.draw(box)
    wait_for(lambda: vehicle.commands, what="the selection")
    name, command = vehicle.commands[0]
    assert name == "follow/do/select"
    assert command.box_px == pytest.approx(box, abs=8)
    assert command.capture_ns in vehicle.captures
    view.wait_text("Choose what to follow: done")
    assert view.middle_share(BLUE) < 0.001
    vehicle.script.members = (
        MemberBox(name="dsst", box_px=box),
        MemberBox(name="cmt", box_px=(270.0, 210.0, 90.0, 60.0)),
    )
    wait_for(lambda: view.middle_share(BLUE) > 0.005, what="the follower's box")
    assert view.middle_share(VIOLET) > 0.0003, "that of its second tracker"
    view.choose("A box chooses", "the chase's target")


def test_box_that_names_no_target_is_refused_by_the_console(view: View, vehicle: ScriptedVehicle) -> None:
    canvas = view.canvas()
    view.drag((canvas["x"] + 100, canvas["y"] + 3), (canvas["x"] + 180, canvas["y"] + 18))  # in the margin above
    view.wait_text("The box lies beside the picture")
    middle = (canvas["x"] + canvas["width"] / 2, canvas["y"] + canvas["height"] / 2)
    view.drag(middle, (middle[0] + 40, middle[1] + 4))
    view.wait_text("px; draw at least 8 x 8 px")
    assert vehicle.commands == []


def test_old_picture_is_never_shown_as_live(view: View, vehicle: ScriptedVehicle) -> None:
    wait_for(lambda: _colourfulness(view.pixels()) > 20, what="a picture in colour")
    vehicle.script.pictures = False
    wait_for(lambda: _colourfulness(view.pixels()) < 8, what="a grey picture")
    view.wait_text("No picture for")
    canvas = view.canvas()
    middle = (canvas["x"] + canvas["width"] / 2, canvas["y"] + canvas["height"] / 2)
    view.drag(middle, (middle[0] + 80, middle[1] + 60))
    view.wait_text("There is no live picture to choose a target from")
    assert vehicle.commands == []
    vehicle.script.pictures = True
    wait_for(lambda: _colourfulness(view.pixels()) > 20, what="the picture back in colour")


def test_alarms_say_what_to_do_and_leave_the_buttons_in_place(view: View, vehicle: ScriptedVehicle) -> None:
    hold = view.page.get_by_role("button", name="Hold", exact=True).first
    before = hold.bounding_box()
    vehicle.script.state, vehicle.script.mode, vehicle.script.zone = "yielded", "POSCTL", "collision"
    vehicle.script.distance_m, vehicle.script.battery = 0.6, 0.1
    for words in ("Press Engage to take the stick again.", "Obstacle at 0.6 m: collision zone", "Land now."):
        view.wait_text(words)
    assert hold.bounding_box() == before


def test_failing_preflight_items_are_listed_with_reasons(view: View, vehicle: ScriptedVehicle) -> None:
    vehicle.script.preflight = (
        *CHECKS,
        PreflightItem(name="COM_OF_LOSS_T", ok=False, detail="got 5 s, expected 1 s; write it"),
    )
    vehicle.script.in_air, vehicle.script.armed, vehicle.script.state = False, False, "standby"
    view.wait_text("Not ready to fly: COM_OF_LOSS_T")
    view.page.get_by_text("Checks", exact=True).first.click()
    view.wait_text("fused, 0.3 m")
    view.wait_text(f"Gate closed: 1 of {len(CHECKS) + 1} checks fail")
    assert view.page.get_by_text("Write it", exact=True).is_visible()
    wait_for(lambda: view.text().count("got 5 s, expected 1 s") >= 2, what="the reason in the list and in the alarm")
    assert "COM_OF_LOSS_T" in view.text()
    vehicle.script.preflight = CHECKS
    view.wait_text(f"Gate open: all {len(CHECKS)} checks pass")


def test_silent_helm_is_an_alarm_and_its_old_words_go(view: View, vehicle: ScriptedVehicle) -> None:
    vehicle.script.status = False
    view.wait_text("No word from helm for")
    wait_for(lambda: "hovering at the anchor" not in view.text(), what="the old reason gone")
    assert "No word from helm for" in view.text()


def test_three_d_view_and_back(view: View, vehicle: ScriptedVehicle) -> None:
    wait_for(lambda: _colourfulness(view.pixels()) > 20, what="a picture in colour")
    size = view.page.viewport_size
    assert size is not None
    view.page.set_viewport_size({"width": 820, "height": 420})  # software GL pays for every pixel
    view.button("Show 3-D view")
    wait_for(lambda: np.median(view.pixels()) < 40, what="the dark scene")
    canvas = view.canvas()
    middle = (canvas["x"] + canvas["width"] / 2, canvas["y"] + canvas["height"] / 2)
    view.drag(middle, (middle[0] + 90, middle[1] + 40))  # turns the view
    view.wait_text("Show picture")
    assert vehicle.commands == []
    vehicle.script.limiter = barrel(4.0, "warning", 1.4, "curve")
    view.wait_text("asked 2.1, allowed 1.4 m/s")  # the ring's drawing stands over the 3-D view, too
    assert view.page.locator(".hud svg").is_visible()
    view.button("Show picture")
    view.page.set_viewport_size(size)
    wait_for(lambda: _colourfulness(view.pixels()) > 20, what="the picture again")


def test_on_a_phone_the_picture_stands_above_the_panel(view: View, vehicle: ScriptedVehicle) -> None:
    size = view.page.viewport_size
    assert size is not None
    view.page.set_viewport_size({"width": 390, "height": 760})
    wait_for(lambda: _colourfulness(view.pixels()[8:280]) > 20, what="the picture at the top")
    panel = view.page.locator(".mantine-Paper-root:has(.or)").bounding_box()
    stick = view.page.locator("#outrider-stick").bounding_box()
    assert panel is not None
    assert stick is not None
    assert panel["width"] == 390
    assert panel["y"] >= 292  # where a picture of 4:3 ends
    assert stick["y"] + stick["height"] < panel["y"]
    view.page.set_viewport_size(size)
    wait_for(lambda: view.canvas()["width"] > 390, what="the wide page again")


@pytest.mark.usefixtures("nobody_else_looks")
def test_page_says_so_when_the_console_hangs(browser: Browser, own_console: Console, vehicle: ScriptedVehicle) -> None:
    view = open_view(browser, own_console.url)
    time.sleep(2.0)
    lost = view.page.get_by_text("NO CONNECTION TO THE CONSOLE")
    expect(lost).to_be_hidden(timeout=WAIT_MS)  # a busy machine may have held up a beat
    os.kill(own_console.process.pid, signal.SIGSTOP)
    expect(lost).to_be_visible(timeout=10_000)
    os.kill(own_console.process.pid, signal.SIGCONT)
    expect(lost).to_be_hidden(timeout=WAIT_MS)
    view.page.close()


def test_taken_port_is_one_clear_line(bus_config: BusConfig, console: Console, tmp_path: Path) -> None:
    port = int(console.url.rsplit(":", 1)[1])
    second = Console(bus_config, port, tmp_path / "second.log")  # the first one answers on that port
    assert second.process.wait(timeout=20) != 0
    second.close()
    lines = (tmp_path / "second.log").read_text().splitlines()
    assert len(lines) == 1, lines
    assert f"console.port: {port} on 127.0.0.1 is taken" in lines[0]


def _colourfulness(picture: np.ndarray) -> float:
    """Median difference between the largest and the smallest channel in the middle of the canvas."""
    height, width = picture.shape[:2]
    middle = picture[height // 3 : 2 * height // 3, width // 4 : 3 * width // 4].astype(int)
    return float(np.median(middle.max(axis=2) - middle.min(axis=2)))
