"""The node that searches for people: pairs pictures with depth, publishes, obeys the operator."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import cv2
import numpy as np
import pytest

from benchmarks.people_scene import DepthScene, barrel, person
from common.config import ConfigError
from common.geometry.depth import to_image
from common.header import Header, Received
from common.messages import Command, Image, Obstacles, People, PeopleDetections, PersonPicture
from common.node import ScriptedRun
from common.processes import idle, load_config
from onboard.people.node import PeopleNode
from onboard.people.pairing import Pairing
from tests.flying import flying
from tests.unit.people_rig import DOWN, SECOND, Knower, paint

SETTINGS = (
    "people.camera=down",
    "camera.down.width=512",
    "camera.down.height=424",
    "camera.down.fx_px=365.0",
    "camera.down.fy_px=365.0",
    "camera.down.cx_px=255.5",
    "camera.down.cy_px=211.5",
    "camera.down.depth.aligned=true",
)
SCENE = DepthScene(
    (person("lying", -1.2, 0.5, 0.4), person("sitting", 1.2, -0.8, 2.0), barrel(0.6, 1.2)), 5.0, camera=DOWN
)
STEP_NS = SECOND // 10


@pytest.fixture(scope="module")
def pictures() -> tuple[Image, Image]:
    """Colour and depth of the scene."""
    colour, depth_m = paint(SCENE)
    image = Image(camera="down", width=512, height=424, encoding="bgr8", data=colour.tobytes())
    return image, to_image("down", depth_m)


@pytest.fixture
def run(pictures: tuple[Image, Image]) -> Callable[..., list[Any]]:
    """Feeds pictures 100 ms apart from 1 s on, the vehicle 5 m above home; everything that came out, by time."""
    node = PeopleNode(load_config(None, SETTINGS), "people", Knower().network)
    script = ScriptedRun(node)
    clock = [SECOND]

    def fly(steps: int, depth: Image | None = pictures[1], late_ms: float = 0.0, state: bool = True) -> list[Any]:
        outputs = []
        for _ in range(steps):
            clock[0] += STEP_NS
            if state:
                script.feed("helm/state", flying(5.05), clock[0])
            script.feed("camera/down/raw", pictures[0], clock[0])
            if depth is not None:
                script.feed("camera/down/depth", depth, clock[0] - round(late_ms * 1e6), clock[0])
            outputs += script.step(clock[0] + STEP_NS // 2)
        return outputs

    fly.script = script  # type: ignore[attr-defined]
    fly.clock = clock  # type: ignore[attr-defined]
    return fly


def of(outputs: list[Any], topic: str) -> list[Any]:
    """Messages of a topic."""
    return [output.message for output in outputs if output.topic == topic]


def test_people_are_published_with_identity_place_and_picture(run: Callable[..., list[Any]]):
    outputs = run(32)
    seen: PeopleDetections = of(outputs, "people/detections")[-1]
    assert (seen.camera, seen.width, seen.height, seen.with_depth, seen.reason) == ("down", 512, 424, True, "")
    assert [p.number for p in seen.people] == [1, 2]
    for found in seen.people:
        assert found.with_depth and found.ned_p_m is not None and found.size_m is not None and found.size_m[0] > 0.4
    told: People = of(outputs, "people/tracks")[-1]
    assert [(p.number, p.name, p.state, p.label) for p in told.people] == [
        (1, "person 1", "seen", "person 1"),
        (2, "person 2", "seen", "person 2"),
    ]
    assert all(p.pictures >= 3 and p.ned_v_m_s == (0.0, 0.0, 0.0) for p in told.people)
    obstacles: Obstacles = of(outputs, "obstacles/people")[-1]
    assert sorted(o.label for o in obstacles.obstacles) == ["person 1", "person 2"]
    for thing in obstacles.obstacles:
        down = thing.distance_m * thing.ned_direction[2]
        assert 3.5 < down < 5.1 and thing.distance_m < 5.5, "the nearest point of a body below"
    jpegs: list[PersonPicture] = of(outputs, "people/pictures")
    assert {p.number for p in jpegs} == {1, 2}
    decoded = cv2.imdecode(np.frombuffer(jpegs[0].jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert decoded is not None and max(decoded.shape) <= 160
    metrics = cast(Any, run).script.node.metrics()
    assert metrics["pictures"] == 32 and metrics["without_depth"] == metrics["without_pose"] == 0
    assert metrics["people_seen"] == 2 and 0 < metrics["looks"] < 50


def test_who_is_not_believed_yet_is_no_obstacle(run: Callable[..., list[Any]]):
    outputs = run(1)
    assert of(outputs, "people/tracks")[-1].people[0].state == "provisional"
    assert of(outputs, "obstacles/people")[-1].obstacles == ()


def test_when_the_pictures_stop_people_are_away_at_their_places(run: Callable[..., list[Any]]):
    run(12)
    script, clock = cast(Any, run).script, cast(Any, run).clock
    told = of(script.step(clock[0] + 2 * SECOND), "people/tracks")[-1]
    assert [p.state for p in told.people] == ["away", "away"]
    assert all(p.ned_p_m is not None for p in told.people)


def test_depth_of_another_time_is_waited_for_and_then_named(run: Callable[..., list[Any]]):
    found = of(run(6, late_ms=60.0), "people/detections")
    assert found, "a picture that waited in vain is used without"
    assert {p.with_depth for p in found} == {False}
    assert "picture and depth are" in found[-1].reason and "ms apart, expected 20 ms or less" in found[-1].reason


def test_without_a_vehicle_state_nothing_is_placed(run: Callable[..., list[Any]]):
    outputs = run(3, state=False)
    seen = of(outputs, "people/detections")[-1]
    assert seen.people and "no pose of the vehicle" in seen.reason
    assert all(p.ned_p_m is None and p.camera_p_m is not None for p in seen.people)
    assert not of(outputs, "obstacles/people")


def test_the_operator_renames_merges_and_dismisses(run: Callable[..., list[Any]]):
    run(12)
    script, clock = cast(Any, run).script, cast(Any, run).clock

    def order(word: str, **fields: Any) -> tuple[str, str, People]:
        clock[0] += SECOND // 100
        call, outputs = script.call(f"people/do/{word}", Command(operator="test", **fields), clock[0])
        assert call.answer is not None
        return call.answer.outcome, call.answer.reason, of(outputs, "people/tracks")[-1]

    outcome, reason, told = order("rename", label="person 1", name="  Anna  B. ")
    assert (outcome, reason) == ("done", "person 1 is called Anna B. now")
    assert (told.people[0].number, told.people[0].name, told.people[0].label) == (1, "Anna B.", "person 1")
    assert order("rename", label="person 2", name="Anna B.")[:2] == (
        "refused",
        "name: got 'Anna B.', which is somebody else's; expected one of its own",
    )
    assert order("rename", label="person 2", name="person 1")[0] == "refused"
    assert order("rename", label="person 2", name=" ")[0] == "refused"
    outcome, reason, _ = order("rename", label="person 9", name="x")
    assert (outcome, reason) == (
        "refused",
        "label: got 'person 9', which is nobody; expected one of: Anna B., person 2",
    )
    assert order("merge", label="person 1", into="Anna B.")[0] == "refused"
    outcome, reason, told = order("merge", label="Anna B.", into="person 2")
    assert outcome == "done", reason
    assert [(p.number, p.name, p.merged) for p in told.people] == [(2, "Anna B.", (1,))]
    assert order("dismiss", label="person 1")[1] == "label: person 1 is one with person 2"
    outcome, _, told = order("dismiss", label="person 2")
    assert outcome == "done" and told.people[0].state == "dismissed"


def test_pictures_of_another_size_scale_the_calibration(run: Callable[..., list[Any]], pictures: tuple[Image, Image]):
    colour = np.frombuffer(pictures[0].data, np.uint8).reshape(424, 512, 3)[::2, ::2]
    half = Image(camera="down", width=256, height=212, encoding="bgr8", data=colour.tobytes())
    script = cast(Any, run).script
    script.feed("helm/state", flying(5.05), SECOND)
    script.feed("camera/down/raw", half, SECOND)
    script.feed("camera/down/depth", pictures[1], SECOND)
    (seen,) = of(script.step(SECOND), "people/detections")
    assert (seen.width, seen.height, seen.reason) == (256, 212, "")
    assert seen.people and all(p.box_px[0] + p.box_px[2] <= 256 for p in seen.people)


def test_a_vehicle_without_such_a_camera_is_refused_and_one_that_names_none_rests():
    with pytest.raises(ConfigError, match=r"people.camera: got 'front', which this vehicle has not; .* down"):
        PeopleNode(load_config(None, ["people.camera=front"]), "people", Knower().network)
    node = PeopleNode(load_config(None), "people")
    assert node.inputs == () and ScriptedRun(node).step(SECOND) == []
    assert idle("onboard", load_config(None)) == ["people", "search"]
    assert idle("onboard", load_config(None, SETTINGS)) == ["search"]


def _received(capture_ns: int, received_ns: int) -> Received[Image]:
    image = Image(camera="down", width=1, height=1, encoding="gray8", data=b"\0")
    return Received(image, Header(0, "test", 1, 0, capture_ns, capture_ns), received_ns)


def test_pairing_takes_the_newest_pair_and_waits_for_what_is_late():
    pairing = Pairing(pair_ms=20.0, wait_ms=100.0, with_depth=True)
    ms = 1_000_000
    pairing.add_colour(_received(0, 0))
    assert pairing.take(10 * ms) is None, "its depth may still come"
    pairing.add_depth(_received(5 * ms, 30 * ms))
    pairing.add_colour(_received(50 * ms, 55 * ms))
    pair = pairing.take(60 * ms)
    assert pair is not None and pair[1] is not None
    assert (pair[0].header.capture_ns, pair[1].header.capture_ns) == (0, 5 * ms)
    assert pairing.take(60 * ms) is None
    pair = pairing.take(160 * ms)
    assert pair is not None and pair[0].header.capture_ns == 50 * ms, "waited in vain"
    pairing.add_colour(_received(100 * ms, 170 * ms))
    pairing.add_colour(_received(150 * ms, 170 * ms))
    pairing.add_depth(_received(100 * ms, 170 * ms))
    pairing.add_depth(_received(150 * ms, 170 * ms))
    pair = pairing.take(170 * ms)
    assert pair is not None and pair[0].header.capture_ns == 150 * ms, "the newest; older ones are left out"
    assert pairing.take(400 * ms) is None
    alone = Pairing(pair_ms=20.0, wait_ms=100.0, with_depth=False)
    alone.add_colour(_received(0, 0))
    assert alone.take(0) is not None, "there is no depth to wait for"
