"""A vehicle with a depth camera faces somebody who walks, keeps its distance, and has the right one after a barrel.

With real processes: four trackers, the depth camera's pictures, the limiter before the barrel.
"""

from __future__ import annotations

import math
import time
from pathlib import Path

import numpy as np
import pytest

from common.geometry.config import CamerasConfig
from common.geometry.rotation import euler_from_quat, quat_conjugate, quat_multiply, quat_rotate, wrap_angle
from common.messages import Command
from common.tracking.base import Box
from common.truth import Truth, TruthObstacle
from tests.system.flight import Flight, Seen
from tests.system.stack import Stack

SCENARIO = """
seed = 5
[ground]
kind = "gravel"
trees = 0
houses = 0
road = false
[car]
north_m = -9.0
east_m = -6.0
[[barrels]]
north_m = 4.6
east_m = 0.8
radius_m = 0.35
height_m = 2.4
[[people]]
shirt = "#d9480f"
[people.path]
mode = "ping_pong"
start_delay_s = 2.0
acceleration_m_s2 = 1.5
waypoints = [
    { north_m = 6.5, east_m = -0.6, speed_m_s = 0.9, stop_s = 0.5 },
    { north_m = 6.5, east_m = 4.5, speed_m_s = 0.9, stop_s = 0.5 },
]
[[people]]
north_m = 7.6
east_m = 2.4
heading_deg = 180.0
shirt = "#d9480f"
"""
HIM, FOLLOWED_S = "person 1", 45.0


def _box_px(flight: Flight) -> Box:
    """What the front camera's picture shows of him, where he truly is."""
    truth: Truth = flight.truth.last
    section = flight.stack.config.section(CamerasConfig).by_name()["front"]
    camera, him = section.camera(), _him(truth)
    turn = quat_conjugate(quat_multiply(truth.ned_q_body, camera.body_q_camera))
    eye = np.array(truth.ned_p_m) + quat_rotate(truth.ned_q_body, np.array(camera.body_p_camera_m))
    ends = [np.array([*him.ned_p_m[:2], down_m]) - eye for down_m in (-1.7, 0.0)]
    (u, top), (_, foot) = camera.project(np.array([quat_rotate(turn, end) for end in ends])).tolist()
    tall = foot - top
    return u - 0.15 * tall, top, 0.3 * tall, tall


def _him(truth: Truth) -> TruthObstacle:
    return next(o for o in truth.obstacles if o.label == HIM)


def _off_nose_rad(truth: Truth) -> float:
    north, east = (a - b for a, b in zip(_him(truth).ned_p_m[:2], truth.ned_p_m[:2], strict=True))
    return abs(wrap_angle(math.atan2(east, north) - euler_from_quat(truth.ned_q_body)[2]))


@pytest.mark.timeout(200)
def test_who_is_followed_is_faced_also_after_he_was_hidden_beside_somebody_in_the_same_shirt(tmp_path: Path) -> None:
    scenario = tmp_path / "person.toml"
    scenario.write_text(SCENARIO)
    stack = Stack(tmp_path, (f"world.scenario={scenario}", "follow.camera=front"), vehicle="heron")
    try:
        for side in ("onboard", "sim"):
            stack.start(side)
        stack.start("ground", "--without", "console", "--without", "pursuit")
        flight = Flight(stack)
        track, limiter = Seen(flight.bus, "follow/track"), Seen(flight.bus, "helm/limiter")
        flight.take_off(1.5)
        flight.must(
            "follow/do/select", Command(box_px=_box_px(flight), capture_ns=flight.truth.all[-1].header.capture_ns)
        )
        flight.wait("fused target", lambda: track.last is not None and track.last.state == "tracking", 15)
        time.sleep(0.5)  # helm hears of it
        flight.must("helm/do/follow")
        begun_ns = time.monotonic_ns()
        time.sleep(FOLLOWED_S)
        truths: list[Truth] = [r.message for r in flight.truth.since(begun_ns)]
        off = np.array([_off_nose_rad(truth) for truth in truths])
        away = np.array([_him(truth).distance_m for truth in truths])
        states = [r.message.state for r in track.since(begun_ns)]
        print(f"off the nose, rad: {np.percentile(off, 50):.2f}, {np.percentile(off, 95):.2f}, {off.max():.2f}")
        print(
            f"distance, m: {away.min():.2f} to {away.max():.2f}; tracking {states.count('tracking') / len(states):.2f}"
        )
        walked_m = np.ptp([_him(truth).ned_p_m[1] for truth in truths])
        flight.check_machine()
        assert walked_m > 4.0
        assert flight.state == "follow" and track.last.state == "tracking"
        assert np.percentile(off, 95) < 0.35 and off[-20:].max() < 0.3
        closest_m = min(o.distance_m for truth in truths for o in truth.obstacles)
        assert closest_m >= limiter.last.h_min_m
    finally:
        stack.end()
