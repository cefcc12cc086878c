"""People in the console, in Chromium: who was found is to be seen, and orders about them go out."""

from __future__ import annotations

import cv2
import numpy as np

from common.messages import JOINTS, Command, Person, PersonDetection, SearchStatus
from tests.browser.scripted import ScriptedVehicle
from tests.browser.view import View, wait_for

BLUE = (255, 90, 30)
"""Of the picture of a person, BGR."""
GREEN = (132, 220, 61)


def person(number: int, name: str = "", state: str = "away", east_m: float = 2.0) -> Person:
    return Person(
        number=number,
        name=name or f"person {number}",
        state=state,  # type: ignore[arg-type]
        ned_p_m=(4.0, east_m, 0.0),
        ned_p_cov_m2=(0.25, 0.0, 0.0, 0.04, 0.0, 0.01),
        first_seen_ns=1,
        last_seen_ns=1,
        pictures=12,
    )


def in_the_middle() -> PersonDetection:
    """Someone who lies across the middle of the picture."""
    joints = tuple((260.0 + 8.0 * k, 240.0, 0.9) for k in range(len(JOINTS)))
    return PersonDetection(
        number=1, box_px=(250.0, 200.0, 140.0, 80.0), joints_px=joints, presence=1.0, fresh=True, with_depth=True
    )


def test_found_people_are_seen_listed_and_ordered_about(view: View, vehicle: ScriptedVehicle) -> None:
    face = cv2.imencode(".jpg", np.full((64, 48, 3), BLUE, np.uint8))[1].tobytes()
    vehicle.script.track_state = ""
    vehicle.script.people = (person(1, state="seen"), person(2, east_m=-3.0), person(3, state="provisional"))
    vehicle.script.detections, vehicle.script.faces = (in_the_middle(),), {1: face}
    wait_for(lambda: view.middle_share(GREEN) > 0.01, what="a box and a skeleton in the picture")

    view.page.get_by_role("tab", name="People").click()
    view.wait_text("4.0 m N, 3.0 m W ± 1.0 m")
    for words in ("in sight", "out of sight, last seen", "not sure yet"):
        assert words in view.text(), words
    wait_for(lambda: _share(view, ".face1", BLUE) > 0.5, what="the picture of a person")
    assert _share(view, ".face2", BLUE) == 0.0

    def press(label: str, expected: Command, *commands: str) -> None:
        vehicle.commands.clear()
        view.button(label)
        wait_for(lambda: len(vehicle.commands) >= len(commands), what=f"the order of {label}")
        assert [name for name, _ in vehicle.commands] == list(commands)
        given = vehicle.commands[0][1]
        assert (given.label, given.name, given.into) == (expected.label, expected.name, expected.into)

    vehicle.script.search = SearchStatus(state="idle", reason="nothing was searched yet")
    press("Search area", Command(), "search/do/start", "helm/do/search")
    way = ((0.0, 0.0), (0.0, 9.0), (4.0, 9.0), (4.0, 0.0))
    vehicle.script.search = SearchStatus(state="searching", way_m=way, next_corner=2)
    view.wait_text("interrupted, line 2 of 2")
    press("Search area", Command(), "helm/do/search")
    vehicle.script.state = "search"
    view.wait_text("under way, line 2 of 2")
    press("Stop search", Command(), "helm/do/hold", "search/do/stop")

    view.choose("Person", "person 2")
    press("Approach this one", Command(label="person 2"), "approach/do/select", "helm/do/approach")
    view.button("Rename")
    view.wait_text("Write a name of 1 to 40 letters")
    view.fill("Name", "Anna")
    press("Rename", Command(label="person 2", name="Anna"), "people/do/rename")
    vehicle.script.people = (person(1, state="seen"), person(2, "Anna", east_m=-3.0), person(3, state="provisional"))
    view.wait_text("Anna")
    view.choose("Same as", "person 1")
    press("Merge", Command(label="person 2", into="person 1"), "people/do/merge")
    press("Dismiss", Command(label="person 2"), "people/do/dismiss")
    vehicle.script.people = (person(1, state="seen"), person(2, "Anna", "dismissed"))
    view.wait_text("1 dismissed")
    assert "Anna" not in view.page.locator(".man").all_inner_texts()


def _share(view: View, selector: str, bgr: tuple[int, int, int]) -> float:
    """Share of an element that has a colour; the list is replaced once a second, so by its place."""
    place = view.page.evaluate(
        "(s) => { const e = document.querySelector(s); e.scrollIntoView(); return e.getBoundingClientRect().toJSON() }",
        selector,
    )
    shot = view.page.screenshot(clip={name: place[name] for name in ("x", "y", "width", "height")})  # type: ignore[arg-type]
    pixels = cv2.imdecode(np.frombuffer(shot, np.uint8), cv2.IMREAD_COLOR)
    assert pixels is not None
    return float((np.abs(pixels.astype(int) - bgr).max(axis=2) < 60).mean())
