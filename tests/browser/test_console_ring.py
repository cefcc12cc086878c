"""The limiter's ring and the approach in Chromium: what is near is to be seen, in the colour of its zone."""

from __future__ import annotations

import cv2
import numpy as np

from common.messages import ApproachTarget, Obstacle
from ground.console.ring import ZONES
from tests.browser.script import barrel
from tests.browser.scripted import ScriptedVehicle
from tests.browser.view import View, wait_for


def hud_share(view: View, zone: str) -> float:
    """Share of the drawing over the picture that has the colour of a zone, within what it is mixed with."""
    # By its place: the element itself is replaced four times a second.
    place = view.page.evaluate("() => document.querySelector('.hud svg').getBoundingClientRect().toJSON()")
    shot = view.page.screenshot(clip={name: place[name] for name in ("x", "y", "width", "height")})  # type: ignore[arg-type]
    pixels = cv2.imdecode(np.frombuffer(shot, np.uint8), cv2.IMREAD_COLOR)
    assert pixels is not None
    mixed = 0.75 * np.array(ZONES[zone][::-1]) + 0.25 * np.array((23, 17, 13))
    return float((np.abs(pixels.astype(int) - mixed).max(axis=2) < 40).mean())


def test_the_ring_has_the_colour_of_the_zone(view: View, vehicle: ScriptedVehicle) -> None:
    assert view.page.locator(".hud").count() == 0, "no ring before anything is known of obstacles"
    vehicle.script.limiter = barrel(4.0, "warning", 1.4, "curve")
    view.wait_text("asked 2.1, allowed 1.4 m/s")
    view.wait_text("slows down: the curve")
    assert hud_share(view, "warning") > 0.01, "the rim, and what is there"
    assert hud_share(view, "safe") > 0.02, "what is free beside it"
    for distance_m, zone, allowed_m_s, why, words in (
        (1.55, "transition", 0.05, "bound", "what can be braked"),
        (0.7, "collision", 0.0, "push-back", "backs away"),
    ):
        vehicle.script.limiter = barrel(distance_m, zone, allowed_m_s, why)
        view.wait_text(words)
        assert view.page.locator(".hud b").inner_text() == zone
    vehicle.script.limiter = None
    wait_for(lambda: view.page.locator(".hud").count() == 0, what="the ring gone with the limiter's words")


def test_the_approach_is_chosen_by_name_and_ends_at_a_refusal(view: View, vehicle: ScriptedVehicle) -> None:
    vehicle.script.obstacles = (
        Obstacle(distance_m=4.2, ned_direction=(1.0, 0.0, 0.0), label="person 3"),
        Obstacle(distance_m=5.0, ned_direction=(0.0, 1.0, 0.0)),
    )
    view.button("Approach")
    wait_for(lambda: len(vehicle.commands) >= 2, what="the commands of Approach")
    assert [name for name, _ in vehicle.commands] == ["approach/do/select", "helm/do/approach"]
    assert vehicle.commands[0][1].label == "", "nothing chosen: the nearest ahead"

    vehicle.commands.clear()
    view.page.get_by_label("Approach what").click()
    view.page.get_by_role("option", name="person 3").click()
    view.button("Approach")
    wait_for(lambda: len(vehicle.commands) >= 2, what="the commands of Approach")
    assert vehicle.commands[0][1].label == "person 3"

    vehicle.script.approach = ApproachTarget(
        state="tracking", label="person 3", ned_p_m=(6.2, 1.0, -5.0), distance_m=4.2, goal_m=1.5
    )
    view.wait_text("4.2 m, to 1.5 m")
