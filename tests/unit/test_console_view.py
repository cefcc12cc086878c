"""What the console makes of messages: snapshot, alarms, texts."""

from __future__ import annotations

import re
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from common.config import Config, ConfigError, build
from common.geometry.config import CameraConfig, FrontCameraConfig
from common.geometry.rotation import as_quat, quat_from_euler
from common.messages import (
    SECTORS,
    ApproachTarget,
    Health,
    HelmStatus,
    Image,
    LimiterStatus,
    PreflightItem,
    Session,
    Track,
)
from common.node import Inputs, Node, On, ScriptedRun
from ground.console import ring
from ground.console.alarms import alarms
from ground.console.cards import (
    alarms_html,
    approach_html,
    checks_html,
    flight_html,
    headline_html,
    nodes_html,
    target_html,
)
from ground.console.collector import Collector
from ground.console.config import ConsoleConfig
from ground.console.page import next_actions
from ground.console.plot import ErrorHistory
from ground.console.snapshot import APPROACH, STATE, STATUS, TRACK, Snapshot, picture_topic
from ground.console.target import bearing_rad, ground_point_m, pixels_of, point_on_ray
from tests.flying import flying

CONFIG = ConsoleConfig()
PICTURE = picture_topic("down")
FRONT = picture_topic("front")
MS = 1_000_000
JPEG = b"\xff\xd8 pixels \xff\xd9"
STATE_NOW = flying(ned_p_m=(3.0, 4.0, -5.0), battery_fraction=0.8)
STATUS_NOW = HelmStatus(
    state="hold",
    source="helm",
    reason="hovering",
    streaming=True,
    mode="OFFBOARD",
    armed=True,
    in_air=True,
    limiter_zone="safe",
    limiter_distance_m=8.0,
    request_age_ms=40.0,
)
ALIVE = {"camera": 1, "helm": 1, "pursuit": 1}


def snapshot(**changes: object) -> Snapshot:
    """All well, but for the changes."""
    status = changes.pop("status", STATUS_NOW)
    ages = {PICTURE: 40.0, STATE: 10.0, STATUS: 100.0, TRACK: 40.0, **changes.pop("ages", {})}  # type: ignore[dict-item]
    view = Snapshot(
        t_ns=0,
        ages_ms=ages,
        picture_age_ms=50.0,
        state=STATE_NOW,
        status=status,  # type: ignore[arg-type]
        track=Track(state="tracking"),
        track_age_ms=50.0,
        tracked_ago_ms=40.0,
        alive=ALIVE,
    )
    return replace(view, **changes)  # type: ignore[arg-type]


def status(**changes: object) -> HelmStatus:
    """Helm's status with other values in some fields."""
    return msgspec.structs.replace(STATUS_NOW, **changes)


def test_no_alarm_when_all_is_well() -> None:
    assert alarms(snapshot(), CONFIG) == []
    assert "All well" in headline_html([])


@pytest.mark.parametrize(
    ("view", "level", "words"),
    [
        (snapshot(status=status(state="yielded", mode="POSCTL")), "warning", "Press Engage"),
        (snapshot(status=status(state="failsafe", reason="telemetry stopped")), "danger", "telemetry stopped"),
        (snapshot(status=status(state="disconnected", in_air=False)), "warning", "power"),
        (snapshot(status=status(limiter_zone="collision", limiter_distance_m=0.6)), "danger", "0.6 m"),
        (snapshot(status=status(limiter_zone="transition", limiter_distance_m=2.1)), "warning", "2.1 m"),
        (snapshot(alive={**ALIVE, "helm": 2}), "danger", "2 helms"),
        (snapshot(alive={"camera": 1, "pursuit": 1}, ages={STATUS: 4000.0}), "danger", "Helm is not running"),
        (snapshot(ages={STATUS: 4000.0}), "danger", "No word from helm for 4 s"),
        (snapshot(status=None, ages={STATUS: -1.0}), "warning", "No word from helm"),
        (snapshot(ages={STATE: 900.0}), "danger", "0.9 s old"),
        (snapshot(picture_age_ms=3200.0), "warning", "No picture for 3.2 s"),
        (snapshot(picture_age_ms=3200.0, status=status(state="pursuit")), "danger", "No picture for 3.2 s"),
        (snapshot(picture_age_ms=-1.0), "warning", "No picture yet"),
        (snapshot(state=msgspec.structs.replace(STATE_NOW, battery_fraction=0.25)), "warning", "Press Return"),
        (snapshot(state=msgspec.structs.replace(STATE_NOW, battery_fraction=0.1)), "danger", "Land now"),
        (snapshot(alive={"camera": 1, "helm": 1}), "warning", "Node pursuit is not running"),
        (snapshot(alive={**ALIVE, "camera": 3}), "warning", "runs 3 times"),
        (
            snapshot(status=status(state="pursuit"), track=Track(state="lost"), tracked_ago_ms=2500.0),
            "warning",
            "Target lost for 2.5 s",
        ),
        (snapshot(status=status(state="pursuit"), track=Track(state="idle")), "warning", "no target"),
        (
            snapshot(
                status=status(
                    state="standby",
                    in_air=False,
                    preflight=(PreflightItem(name="calibration", ok=False, detail="absent"),),
                )
            ),
            "notice",
            "Not ready to fly: calibration",
        ),
    ],
)
def test_each_alarm_says_what_and_what_to_do(view: Snapshot, level: str, words: str) -> None:
    found = alarms(view, CONFIG)
    assert len(found) == 1, found
    assert found[0].level == level
    assert words in f"{found[0].title} {found[0].action}"
    assert found[0].action


def test_worst_alarm_comes_first() -> None:
    view = snapshot(picture_age_ms=3000.0, status=status(limiter_zone="collision", limiter_distance_m=0.5))
    assert [a.level for a in alarms(view, CONFIG)] == ["danger", "warning"]
    assert "collision" in headline_html(alarms(view, CONFIG))


def test_failed_steps_of_a_node_are_a_notice() -> None:
    health = Health(
        node="pursuit",
        pid=1,
        steps=9,
        step_ms_median=1.0,
        step_ms_max=2.0,
        input_age_ms={},
        dropped={},
        rejected={},
        errors=3,
        last_error="ValueError: no histogram",
    )
    found = alarms(snapshot(health={"pursuit": health}, ages={"health/pursuit": 500.0}), CONFIG)
    assert [a.level for a in found] == ["notice"]
    assert "ValueError: no histogram" in found[0].action


def test_everything_from_outside_is_escaped() -> None:
    evil = '<img src=x onerror="alert(1)">'
    hostile = status(
        state=evil,
        source=evil,
        reason=evil,
        mode=evil,
        limiter_zone=evil,
        preflight=(PreflightItem(name=evil, ok=False, detail=evil),),
        in_air=False,
    )
    view = snapshot(
        status=hostile,
        track=Track(state="tracking", reason=evil),
        ages={"session": 1.0},
        session=Session(vehicle=evil, monotonic_ns=0, utc_ns=0),
    )
    standby = snapshot(status=msgspec.structs.replace(hostile, state="standby"))
    pages = (
        flight_html(view),
        checks_html(view),
        target_html(view, 1.0, 2.0),
        nodes_html(view, (evil,), 20.0),
        alarms_html(alarms(standby, CONFIG)),
        headline_html(alarms(standby, CONFIG)),
    )
    for html in pages:
        assert "<img" not in html
        assert re.search(r"&lt;img", html), html


def test_old_status_is_not_shown() -> None:
    html = flight_html(snapshot(ages={STATUS: 4000.0, STATE: 4000.0}))
    assert "hovering" not in html
    assert "OFFBOARD" not in html
    assert "5.0" not in html


def test_flight_state_in_words() -> None:
    html = flight_html(snapshot())
    for words in ("5.0 <i>m</i>", "80%", "in air", "5 m away", "request 40 ms old", "nearest 8.0 m"):
        assert words in html


@pytest.mark.parametrize(
    ("view", "expected"),
    [
        (snapshot(status=status(state="yielded")), {"Engage"}),
        (snapshot(status=status(state="standby", in_air=False)), {"Take off"}),
        (snapshot(), {"Start chase"}),
        (snapshot(track=Track(state="lost")), set()),
        (snapshot(ages={STATUS: 4000.0}), set()),
    ],
)
def test_next_button_is_the_one_that_leads_on(view: Snapshot, expected: set[str]) -> None:
    assert next_actions(view) == expected


def test_error_history_is_metres_on_the_ground_and_forgets() -> None:
    history = ErrorHistory(30.0)
    for second in range(40):
        history.add(
            snapshot(
                t_ns=second * 1000 * MS, track_capture_ns=second + 1, track=Track(state="tracking", error=(0.2, -0.1))
            )
        )
    x, forward, right = history.series(39_000 * MS)
    assert x[0] == pytest.approx(-30.0)
    assert x[-1] == 0.0
    assert np.allclose(forward, 1.0)  # 0.2 at 5 m
    assert np.allclose(right, -0.5)


def test_error_history_counts_each_estimate_once_and_only_when_tracked() -> None:
    history = ErrorHistory(30.0)
    history.add(snapshot(track_capture_ns=1))
    history.add(snapshot(track_capture_ns=1))
    history.add(snapshot(track_capture_ns=2, track=Track(state="lost")))
    history.add(snapshot(track_capture_ns=3, ages={TRACK: 5000.0}))
    assert len(history.series(0)[0]) == 1


def test_ground_point_takes_attitude_out() -> None:
    camera = CameraConfig().camera()
    centre = Track(state="tracking", x_px=camera.cx_px, y_px=camera.cy_px)
    level = ground_point_m(centre, camera, STATE_NOW)
    assert level == pytest.approx([3.0, 4.0, 0.0], abs=1e-6)
    nose_up = msgspec.structs.replace(STATE_NOW, ned_q_body=as_quat(quat_from_euler(0.0, 0.2, 0.0)))
    point = ground_point_m(centre, camera, nose_up)
    assert point is not None
    assert point[0] == pytest.approx(3.0 + 5.0 * np.tan(0.2), abs=0.05)  # it looks ahead
    assert ground_point_m(Track(state="idle"), camera, STATE_NOW) is None
    below = msgspec.structs.replace(STATE_NOW, ned_p_m=(0.0, 0.0, 1.0))
    assert ground_point_m(centre, camera, below) is None


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"picture_rate_hz": 30}, "picture_rate_hz"),
        ({"battery_empty_fraction": 0.5, "battery_low_fraction": 0.3}, "at most battery_low_fraction"),
        ({"essential_nodes": ["helm", "rudder"]}, "rudder"),
        ({"host": " "}, "empty address"),
        ({"camera": "rear"}, "camera: got 'rear', expected one of down, front"),
        ({"prot": 80}, "did you mean 'port'"),
    ],
)
def test_bad_settings_are_refused_by_name(table: dict[str, object], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        build(ConsoleConfig, table, "test [console]")


class _Reader(Node):
    """Stands for the console's input side alone."""

    trigger = On((PICTURE,))

    def __init__(self) -> None:
        super().__init__(Config({}, {}), "reader")
        self.collector = Collector(("helm",), ("down", "front"))
        self.inputs = self.collector.inputs
        self.view: Snapshot | None = None

    def step(self, inputs: Inputs, t_ns: int) -> tuple[()]:
        self.collector.collect(inputs)
        self.view = self.collector.snapshot(inputs, t_ns, None)
        return ()


def _run() -> tuple[ScriptedRun, _Reader]:
    node = _Reader()
    return ScriptedRun(node), node


def _image() -> Image:
    return Image(camera="down", width=640, height=480, encoding="jpeg", data=JPEG)


def test_repeated_picture_grows_old() -> None:
    run, node = _run()
    run.feed(PICTURE, _image(), 1000 * MS, 1010 * MS)
    run.step(1020 * MS)
    assert node.view is not None
    assert node.view.picture_live
    for t_ms in range(1060, 2060, 50):  # a frozen camera sends the same picture again and again
        run.feed(PICTURE, _image(), 1000 * MS, t_ms * MS)
        run.step((t_ms + 1) * MS)
    assert node.view.picture_age_ms > 1000
    assert not node.view.picture_live
    assert not node.view.fresh(PICTURE)
    assert len(node.collector.pictures) == 1


def test_picture_that_waited_on_the_link_is_known_to_be_old() -> None:
    run, node = _run()
    shift = 77_000_000 * MS  # the vehicle's clock is another machine's
    for t_ms in range(0, 4000, 20):
        run.feed(STATE, STATE_NOW, t_ms * MS + shift, (t_ms + 3) * MS)
        if t_ms >= 3000 and t_ms % 40 == 0:  # pictures arrive 3 s late, at a steady rate
            run.feed(PICTURE, _image(), (t_ms - 3000) * MS + shift, t_ms * MS)
        run.step((t_ms + 4) * MS)
    assert node.view is not None
    assert node.view.fresh(PICTURE)
    assert node.view.picture_age_ms == pytest.approx(3000, abs=50)
    assert not node.view.picture_live


def test_another_camera_begins_with_its_first_new_picture() -> None:
    run, node = _run()
    run.feed(FRONT, _image(), 500 * MS, 510 * MS)  # read when that camera was chosen before
    run.feed(PICTURE, _image(), 1000 * MS, 1010 * MS)
    run.step(1020 * MS)
    assert node.view is not None
    assert (node.view.shown, node.view.picture_live) == ("down", True)
    node.collector.look_through("front", 1050 * MS)
    run.feed(PICTURE, _image(), 1050 * MS, 1055 * MS)
    run.step(1060 * MS)
    assert node.view.shown == "front"
    assert node.view.picture is None, "neither the other camera's picture nor the old one"
    run.feed(FRONT, _image(), 1070 * MS, 1080 * MS)
    run.step(1090 * MS)
    assert node.view.picture_live and node.view.picture is not None
    assert node.view.picture.capture_ns == 1070 * MS


def test_a_place_in_the_picture_is_a_direction_and_back() -> None:
    camera = FrontCameraConfig().camera()
    turned = msgspec.structs.replace(STATE_NOW, ned_q_body=as_quat(quat_from_euler(0.1, -0.15, 0.7)))
    bearing = bearing_rad(camera, STATE_NOW, camera.cx_px + camera.fx_px * np.tan(0.3), camera.cy_px)
    assert bearing == pytest.approx(0.3), "to the right is clockwise"
    place = np.add(turned.ned_p_m, (4.0 * np.cos(0.7 - 0.2), 4.0 * np.sin(0.7 - 0.2), 0.5))
    x, y = pixels_of([place], camera, turned)[0]
    assert bearing_rad(camera, turned, float(x), float(y)) == pytest.approx(-0.2, abs=0.01), "seen from 0.1 m ahead"
    assert np.isnan(pixels_of([np.array(turned.ned_p_m) - [4.0, 0.0, 0.0]], camera, turned)).all(), "behind it"


def test_state_of_a_picture_is_the_nearest_in_time() -> None:
    run, node = _run()
    for t_ms in range(0, 1000, 20):
        run.feed(STATE, msgspec.structs.replace(STATE_NOW, ned_p_m=(float(t_ms), 0.0, -5.0)), t_ms * MS)
    run.step(1000 * MS)
    state = node.collector.state_at(505 * MS)
    assert state is not None
    assert state.ned_p_m[0] == 500.0
    assert node.collector.state_at(5000 * MS) is None


def test_a_click_means_the_obstacle_on_its_ray() -> None:
    points = [np.array(p, float) for p in ((5.0, 0.1, -2.0), (5.0, 0.3, -2.0), (-5.0, 0.0, -2.0))]
    eye, ahead = np.array([0.0, 0.0, -2.0]), np.array([2.0, 0.0, 0.0])
    assert point_on_ray(points, eye, ahead) is points[0]
    assert point_on_ray(points, eye, np.array([0.0, 1.0, 0.0])) is None
    assert point_on_ray([], eye, ahead) is None


def test_an_approach_without_its_thing_is_an_alarm() -> None:
    approaching = status(state="approach")
    lost = ApproachTarget(state="lost", label="person 3", distance_m=4.0, goal_m=1.5, reason="not seen for 0.8 s")
    ages = {APPROACH: 50.0}
    assert not alarms(snapshot(approach=lost, ages=ages), CONFIG), "helm holds: nobody approaches"
    found = alarms(snapshot(status=approaching, approach=lost, ages=ages), CONFIG)
    assert [(a.level, a.title) for a in found] == [("warning", "Nothing to approach: not seen for 0.8 s")]
    assert [a.title for a in alarms(snapshot(status=approaching), CONFIG)] == ["No word from the approach"]
    seen = msgspec.structs.replace(lost, state="tracking", reason="")
    assert not alarms(snapshot(status=approaching, approach=seen, ages=ages), CONFIG)
    assert "4.0 m, to 1.5 m" in approach_html(snapshot(approach=seen, ages=ages))


def limiter_status(**changes: object) -> LimiterStatus:
    """A limiter that sees 8 m in a quarter to the north-east and nothing elsewhere, but for the changes."""
    free = LimiterStatus(
        zone="safe",
        distance_m=-1.0,
        ned_direction=(0.0, 0.0, 0.0),
        asked_m_s=1.0,
        allowed_m_s=1.0,
        why="clear",
        h_min_m=0.8,
        h_desired_m=1.5,
        h_mid_m=2.5,
        h_max_m=6.0,
        sectors_m=tuple(8.0 if k < 18 else -1.0 for k in range(SECTORS)),
        seen=tuple(k < 18 for k in range(SECTORS)),
    )
    return msgspec.structs.replace(free, **changes)


def test_each_sector_of_the_ring_lies_at_its_distance_in_the_colour_of_its_zone() -> None:
    near = limiter_status(
        zone="collision",
        distance_m=0.7,
        ned_direction=(0.0, 1.0, 0.0),
        sectors_m=(0.7, 2.0, 4.0, 8.0, *(-1.0 for _ in range(SECTORS - 4))),
    )
    assert [ring.zone_of(d, near) for d in near.sectors_m[:5]] == [
        "collision",
        "transition",
        "warning",
        "safe",
        "blind",
    ]
    segments, colours = ring.arcs(near)
    assert segments.shape == colours.shape == (2 * SECTORS, 2, 3)
    radii = np.linalg.norm(segments[:, 0], axis=1)
    assert radii[[0, 2, 4, 6]] == pytest.approx([0.7, 2.0, 4.0, 6.36], abs=1e-3), "what is free: just outside h_max"
    assert segments[0, 0] == pytest.approx((0.7, 0.0, 0.0)), "from north"
    assert segments[2, 0] == pytest.approx((2.0 * np.cos(np.radians(5)), 2.0 * np.sin(np.radians(5)), 0.0)), "clockwise"
    filled = ring.wedge(near, "collision")
    assert len(ring.wedge_faces()) == 2 * SECTORS and ring.wedge_faces().max() < len(filled)
    assert np.linalg.norm(filled, axis=1).max() == pytest.approx(0.7), "the other zones' sectors collapse"
    assert (ring.limits(near)[1][-1] == ring.in_scene(ring.ZONES["collision"])).all(), "the rim tells the zone"
    east = ring.nearest_m(near)
    assert east is not None and east == pytest.approx((0.0, 0.7, 0.0))


def test_what_is_remembered_in_unseen_space_frees_none_of_it() -> None:
    behind = limiter_status(sectors_m=(*(8.0 for _ in range(18)), 2.0, 7.0, *(-1.0 for _ in range(SECTORS - 20))))
    near, far, unknown = ring.sectors(behind)[18:21]
    assert (near.zone, near.near_m, near.filled) == ("transition", 2.0, "blind"), "its edge alone"
    assert far == unknown, "beyond the ring it is not drawn as free space up to there"
    assert not np.linalg.norm(ring.wedge(behind, "transition"), axis=1).any()
    safe = np.linalg.norm(ring.wedge(behind, "safe"), axis=1)
    assert (safe > 6.0).sum() == 18 * 3, "what is filled as free was looked at"


def test_the_ring_over_the_picture_says_what_is_slowed_and_why() -> None:
    html = ring.hud_html(limiter_status(asked_m_s=2.1, allowed_m_s=0.4, why="bound", label="<b>"), 1.0)
    assert "rotate(-57.3)" in html, "the nose is up"
    assert "asked 2.1, allowed 0.4 m/s" in html and "what can be braked" in html and "<b>&" not in html
    assert not ring.knows_something(limiter_status(sectors_m=(-1.0,) * SECTORS)), "no sensor, no ring"
    assert ring.knows_something(limiter_status(sectors_m=(-1.0,) * SECTORS, why="no data"))
