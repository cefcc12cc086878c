"""The node `proximity`: pictures in, obstacles and what was seen out; silence, missing poses, wrong settings."""

from __future__ import annotations

import pytest

from common.config import Config, ConfigError
from common.geometry.depth import to_image
from common.messages import Obstacles, VehicleState
from common.node import Output, ScriptedRun
from onboard.proximity.node import ProximityNode
from tests.flying import flying
from tests.unit.test_proximity import FRONT, MS, scene

SECTIONS = {
    "camera": "common.geometry.config:CamerasConfig",
    "proximity": "onboard.proximity.config:ProximityConfig",
    "limiter": "onboard.limiter.config:LimiterConfig",
}


def state(north: float, up: float = 2.0) -> VehicleState:
    return flying(ned_p_m=(north, 0.0, -up))


def node_run(**tables: object) -> ScriptedRun:
    return ScriptedRun(ProximityNode(Config({"camera": {"front": FRONT}, **tables}, SECTIONS), "proximity"))


def only(outputs: list[Output]) -> Obstacles:
    assert [o.topic for o in outputs] == ["obstacles/depth"]
    message = outputs[0].message
    assert isinstance(message, Obstacles)
    return message


def test_the_node_turns_each_picture_into_obstacles_with_its_stamp() -> None:
    run = node_run()
    for t in (0, 20, 40):
        run.feed("helm/state", state(0.0), t * MS)
    run.feed("camera/front/depth", to_image("front", scene(wall_m=4.0)), 30 * MS, 45 * MS)
    outputs = run.step(46 * MS)
    message = only(outputs)
    assert outputs[0].capture_ns == 30 * MS
    assert min(o.distance_m for o in message.obstacles) == pytest.approx(4.1, abs=0.01)
    assert len(message.views) == 1 and any(message.views[0].seen)
    assert run.step(60 * MS) == [], "one message a picture"
    assert run.node.metrics()["pictures"] == 1 and run.node.metrics()["blind_now"] == 0


def test_silence_and_a_missing_pose_are_reported_as_seeing_nothing() -> None:
    run = node_run()
    message = only(run.step(10 * MS))
    assert not message.obstacles and not any(message.views[0].seen)
    run.feed("camera/front/depth", to_image("front", scene(wall_m=4.0)), 30 * MS)
    message = only(run.step(40 * MS))
    assert not message.obstacles and not any(message.views[0].seen)
    metrics = run.node.metrics()
    assert metrics["blind_no_pose"] == 1 and metrics["blind_silent"] == 1 and metrics["blind_now"] == 1
    run.feed("helm/state", state(0.0), 60 * MS)
    run.feed("camera/front/depth", to_image("front", scene(wall_m=4.0)), 80 * MS)
    assert any(only(run.step(90 * MS)).views[0].seen)
    assert run.step(350 * MS) == [], "not silent yet"
    assert not any(only(run.step(450 * MS)).views[0].seen)
    assert not any(only(run.step(550 * MS)).views[0].seen), "it goes on saying so"


def test_a_sensor_that_comes_and_goes_by_the_picture_has_one_line_in_two_seconds(
    caplog: pytest.LogCaptureFixture,
) -> None:
    run = node_run()
    with caplog.at_level("INFO"):
        for i in range(50):
            capture_ns = (i * 100 + (5 if i % 2 else 0)) * MS  # each second one is too long after the last pose
            if i % 2 == 0:
                run.feed("helm/state", state(0.0), capture_ns)
            run.feed("camera/front/depth", to_image("front", scene(wall_m=4.0 - 0.02 * i)), capture_ns)
            only(run.step(capture_ns + MS))
    assert [r.getMessage() for r in caplog.records] == [
        "front: the depth pictures show something",
        "front: the depth pictures show nothing: no pose",
        "front: the depth pictures show something",
    ]


def test_a_vehicle_without_depth_says_nothing() -> None:
    run = ScriptedRun(ProximityNode(Config({}, SECTIONS), "proximity"))
    assert run.node.inputs == ()
    assert run.step(10 * MS) == []


def test_a_clearance_below_the_limiters_distance_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"proximity\.clearance_m: got 1\.2, expected more than limiter\.h_desired_m"):
        node_run(proximity={"clearance_m": 1.2})


def test_pictures_of_another_size_scale_the_calibration() -> None:
    run = node_run()
    run.feed("helm/state", state(0.0), 0)
    run.feed("camera/front/depth", to_image("front", scene(wall_m=4.0)[::2, ::2].copy()), 10 * MS)
    message = only(run.step(20 * MS))
    assert min(o.distance_m for o in message.obstacles) == pytest.approx(4.1, abs=0.02)
