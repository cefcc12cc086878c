"""What the console makes of messages: snapshot, alarms, texts."""

from __future__ import annotations

import re
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from common.config import ConfigError, build
from common.geometry.config import CameraConfig, FrontCameraConfig
from common.geometry.rotation import as_quat, quat_from_euler
from common.messages import (
    ApproachTarget,
    FollowMembers,
    Health,
    HelmStatus,
    MemberBox,
    PreflightItem,
    Session,
    Track,
)
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
from ground.console.config import ConsoleConfig
from ground.console.page import next_actions
from ground.console.plot import ErrorHistory
from ground.console.snapshot import APPROACH, FOLLOWED, MEMBERS, STATE, STATUS, TRACK, Snapshot, picture_topic
from ground.console.target import aimed_at, bearing_rad, ground_point_m, pixels_of, point_on_ray
from tests.flying import flying, helm_status

CONFIG = ConsoleConfig()
PICTURE = picture_topic("down")
FRONT = picture_topic("front")
MS = 1_000_000
JPEG = b"\xff\xd8 pixels \xff\xd9"
STATE_NOW = flying(ned_p_m=(3.0, 4.0, -5.0), battery_fraction=0.8)
STATUS_NOW = helm_status("hold", source="helm", reason="hovering", limiter_distance_m=8.0, request_age_ms=40.0)
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


@pytest.mark.parametrize("state", ["approach", "landing"])
def test_near_where_it_was_told_to_go_is_no_alarm_until_too_near(state: str) -> None:
    def near(zone: str) -> list[str]:
        view = snapshot(status=status(state=state, limiter_zone=zone, limiter_distance_m=0.9))
        return [alarm.level for alarm in alarms(view, CONFIG) if "0.9 m" in alarm.title]

    assert (near("transition"), near("collision")) == ([], ["danger"])


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
        (
            snapshot(track=Track(state="lost"), followed=Track(state="tracking"), ages={STATUS: 100.0, FOLLOWED: 50.0}),
            {"Follow"},
        ),
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


def test_a_place_in_the_picture_is_a_direction_and_back() -> None:
    camera = FrontCameraConfig().camera()
    turned = msgspec.structs.replace(STATE_NOW, ned_q_body=as_quat(quat_from_euler(0.1, -0.15, 0.7)))
    bearing = bearing_rad(camera, STATE_NOW, camera.cx_px + camera.fx_px * np.tan(0.3), camera.cy_px)
    assert bearing == pytest.approx(0.3), "to the right is clockwise"
    place = np.add(turned.ned_p_m, (4.0 * np.cos(0.7 - 0.2), 4.0 * np.sin(0.7 - 0.2), 0.5))
    x, y = pixels_of([place], camera, turned)[0]
    assert bearing_rad(camera, turned, float(x), float(y)) == pytest.approx(-0.2, abs=0.01), "seen from 0.1 m ahead"
    assert np.isnan(pixels_of([np.array(turned.ned_p_m) - [4.0, 0.0, 0.0]], camera, turned)).all(), "behind it"


def test_a_click_means_the_obstacle_on_its_ray() -> None:
    points = [np.array(p, float) for p in ((5.0, 0.1, -2.0), (5.0, 0.3, -2.0), (-5.0, 0.0, -2.0))]
    eye, ahead = np.array([0.0, 0.0, -2.0]), np.array([2.0, 0.0, 0.0])
    assert point_on_ray(points, eye, ahead) is points[0]
    assert point_on_ray(points, eye, np.array([0.0, 1.0, 0.0])) is None
    assert point_on_ray([], eye, ahead) is None


def test_a_follow_that_flies_after_nothing_is_an_alarm() -> None:
    following = status(state="follow", source="follow")
    seen, ages = Track(state="tracking"), {FOLLOWED: 50.0}
    assert not alarms(snapshot(status=following, followed=seen, ages=ages), CONFIG)
    assert not alarms(snapshot(followed=Track(state="lost"), ages=ages), CONFIG), "helm holds: nobody follows"
    for wrong, level, title in (
        ({"followed": Track(state="lost"), "followed_ago_ms": 800.0}, "warning", "Followed target lost for 0.8 s"),
        ({"followed": Track(state="idle")}, "warning", "Nothing is followed"),
        ({"followed": seen, "ages": {FOLLOWED: 900.0}}, "warning", "No word from the follower"),
        ({"followed": seen, "status": status(state="follow")}, "notice", "Helm hovers, though the target is seen"),
    ):
        found = alarms(snapshot(**{"status": following, "ages": ages, **wrong}), CONFIG)
        assert [(a.level, a.title) for a in found] == [(level, title)]


def test_the_target_tab_tells_who_sees_what_is_followed() -> None:
    members = FollowMembers(
        camera="down", members=(MemberBox(name="dsst", box_px=(1.0, 2.0, 3.0, 4.0)), MemberBox(name="cmt"))
    )
    ages = {FOLLOWED: 50.0, MEMBERS: 50.0}
    followed = Track(state="tracking", reason="no vehicle state for this picture")
    html = target_html(snapshot(followed=followed, members=members, ages=ages), None, None)
    for words in ("Followed", "tracking", "Seen by</span><span>dsst<", "No request: no vehicle state"):
        assert words in html
    assert "Followed" not in target_html(snapshot(followed=Track(state="idle"), ages=ages), None, None)
    assert "Followed" not in target_html(snapshot(followed=followed), None, None), "nothing old"


def test_the_ground_shows_what_is_followed_where_helm_obeys_the_follower_or_nothing_is_chased() -> None:
    ages = {FOLLOWED: 50.0, MEMBERS: 50.0}
    both = snapshot(
        followed=Track(state="lost"), followed_capture_ns=7, members=FollowMembers(camera="down"), ages=ages
    )

    def shown(**changes: object) -> str | None:
        aim = aimed_at(replace(both, **changes))  # type: ignore[arg-type]
        return None if aim is None else f"{aim.word} {aim.capture_ns}"

    assert shown(track_capture_ns=3) == "target 3"
    assert shown(status=status(state="follow")) == "followed 7"
    assert shown(track=Track(state="idle")) == "followed 7"
    assert shown(track=Track(state="idle"), members=FollowMembers(camera="front")) is None, (
        "its middle is no place there"
    )
    assert shown(track=Track(state="idle"), followed=Track(state="idle")) is None
    assert shown(track=None, ages_ms={**both.ages_ms, FOLLOWED: 900.0}) is None, "nothing old"


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
