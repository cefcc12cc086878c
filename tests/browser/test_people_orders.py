"""What the operator says of people on the page is what the node `people` publishes: real node, real console, a picture
of the simulated world.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest
from playwright.sync_api import Browser

from common.bus import Bus
from common.config import build
from common.geometry.config import CamerasConfig
from common.header import Received
from common.messages import Image, People, Person
from common.session import BusConfig
from simulation.world.config import WorldConfig
from simulation.world.objects_config import PersonConfig
from simulation.world.scenario import CarConfig, GroundConfig, ScenarioConfig
from simulation.world.stage import Stage
from simulation.world.truth_filter import Motion
from tests.browser.conftest import Console, start_node
from tests.browser.view import View, open_view, wait_for
from tests.flying import flying
from tests.machine import free_ports

HEIGHT_M = 4.5
CAMERA = {
    "width": 512, "height": 424, "fx_px": 365.0, "fy_px": 365.0, "cx_px": 255.5, "cy_px": 211.5,
    "depth": {"aligned": True},
}  # fmt: skip
GREEN = (132, 220, 61)


def film() -> tuple[bytes, bytes]:
    """Colour and depth of two people who lie below the vehicle."""
    bare = GroundConfig(kind="gravel", trees=0, houses=0, road=False, size_m=20.0, texture_px=512)
    people = (
        PersonConfig(north_m=0.9, east_m=-1.2, heading_deg=80.0, posture="supine"),
        PersonConfig(north_m=-0.8, east_m=1.0, heading_deg=200.0, posture="supine", shirt="#1d7a4c"),
    )
    scenario = ScenarioConfig(seed=3, ground=bare, car=CarConfig(north_m=-9.0, east_m=-6.0), people=people)
    stage = Stage(WorldConfig(), scenario, build(CamerasConfig, {"down": CAMERA}, "test"))
    try:
        place = np.array([0.0, 0.0, -HEIGHT_M])
        stage.place(Motion(0, place, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)))
        colour, depth = stage.picture(0), stage.depth(0, "down")
    finally:
        stage.close()
    assert colour is not None and depth is not None
    return colour, depth


class Hovering:
    """A vehicle that hovers over them: its pictures and states, five times a second.

    Args:
        bus_config: routers and vehicle.
    """

    def __init__(self, bus_config: BusConfig):
        self.people: list[People] = []
        """What the node published."""
        self._buses = {name: Bus(bus_config, "onboard", name) for name in ("camera", "helm")}
        self._ground = Bus(bus_config, "ground", "test")
        self._ground.subscribe("people/tracks", self._hear)
        self._camera = build(CamerasConfig, {"down": CAMERA}, "test").down.camera()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, args=film(), daemon=True)
        self._thread.start()

    def _hear(self, received: Received[People]) -> None:
        self.people.append(received.message)

    def person(self, number: int) -> Person | None:
        """Somebody, as published last."""
        told = self.people[-1].people if self.people else ()
        return next((p for p in told if p.number == number), None)

    def close(self) -> None:
        """Leave the bus."""
        self._stop.set()
        self._thread.join(timeout=5)
        for bus in (*self._buses.values(), self._ground):
            bus.close()

    def _run(self, colour: bytes, depth: bytes) -> None:
        width, height = self._camera.width, self._camera.height
        pixels = np.frombuffer(colour, np.uint8).reshape(height, width, 3)
        jpeg = cv2.imencode(".jpg", pixels)[1].tobytes()
        streams = {"raw": ("bgr8", colour), "jpeg": ("jpeg", jpeg), "depth": ("depth_mm", depth)}
        state = flying(HEIGHT_M)
        while not self._stop.wait(0.2):
            capture_ns = time.monotonic_ns()
            self._buses["helm"].publish("helm/state", state, capture_ns)
            self._buses["camera"].publish("camera/down/info", self._camera.info("down"))
            for part, (encoding, data) in streams.items():
                picture = Image(camera="down", width=width, height=height, encoding=encoding, data=data)  # type: ignore[arg-type]
                self._buses["camera"].publish(f"camera/down/{part}", picture, capture_ns)


@pytest.fixture
def scene(bus_config: BusConfig, browser: Browser, tmp_path: Path) -> Iterator[tuple[Hovering, View]]:
    """Vehicle, node and console of their own, and the page."""
    own = msgspec.structs.replace(bus_config, vehicle="finch")
    with (tmp_path / "people.log").open("wb") as log:
        tables = {"bus": msgspec.to_builtins(own), "camera": {"down": CAMERA}, "people": {"camera": "down"}}
        with ExitStack() as ends:
            node = start_node("people", tables, log)
            ends.callback(node.kill)
            vehicle = Hovering(own)
            ends.callback(vehicle.close)
            console = Console(own, free_ports(1)[0], tmp_path / "console.log")
            ends.callback(console.close)
            view = open_view(browser, console.url)
            ends.callback(view.page.close)
            yield vehicle, view
            node.terminate()
            assert node.wait(10) == 0, (tmp_path / "people.log").read_text()


def test_what_the_operator_says_of_people_is_what_is_published(scene: tuple[Hovering, View]) -> None:
    vehicle, view = scene
    view.page.get_by_role("tab", name="People").click()

    def published(number: int) -> Person:
        person = vehicle.person(number)
        assert person is not None, f"person {number} is not among {vehicle.people[-1:]}"
        return person

    wait_for(
        lambda: all((p := vehicle.person(n)) is not None and p.state == "seen" for n in (1, 2)),
        what="both people, sure of them",
    )
    view.wait_text("person 2")
    wait_for(lambda: (np.abs(view.pixels().astype(int) - GREEN).max(axis=2) < 60).mean() > 0.002, what="boxes")
    wait_for(lambda: "data:image/jpeg" in view.page.content(), what="a picture of somebody")

    view.choose("Person", "person 2")
    view.fill("Name", "Anna")
    view.button("Rename")
    wait_for(lambda: published(2).name == "Anna", what="the name in the tracks")
    view.wait_text("Rename: done")
    view.page.get_by_text("person 2: Anna").or_(view.page.locator('input[value="person 2: Anna"]')).first.wait_for()

    view.choose("Same as", "person 1")
    view.button("Merge")
    wait_for(lambda: published(1).merged == (2,), what="both as one in the tracks")
    assert vehicle.person(2) is None
    assert published(1).name == "Anna", "the name that was given goes on"
    view.wait_text("also 2")

    view.choose("Person", "person 1: Anna")
    view.button("Dismiss")
    wait_for(lambda: published(1).state == "dismissed", what="nobody of that number in the tracks")
    view.wait_text("1 dismissed")
