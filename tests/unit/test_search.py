"""The search: lines that see all of an area, the law that flies them, the node with scripted inputs."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from common.config import ConfigError, build
from common.geometry.rotation import as_quat, quat_from_euler, wrap_angle
from common.messages import Command, Reply, Request, SearchStatus, VehicleState
from common.node import ScriptedRun
from common.processes import load_config
from onboard.limiter.volume import inside
from onboard.search.config import SearchConfig
from onboard.search.law import along
from onboard.search.node import SearchNode
from onboard.search.sweep import length_m, sweep
from tests.flying import helm_status

S = 1_000_000_000
AREA = ((-4.0, -6.0), (-4.0, 6.0), (4.0, 6.0), (4.0, -6.0))
HOLLOW = ((0.0, 0.0), (0.0, 10.0), (10.0, 10.0), (10.0, 6.0), (4.0, 5.0), (10.0, 4.0), (10.0, 0.0))


@pytest.mark.parametrize("turn_deg", [0.0, 30.0, -75.0])
@pytest.mark.parametrize("area", [AREA, HOLLOW], ids=["rectangle", "hollow"])
def test_every_place_of_the_area_is_near_a_line(area: tuple, turn_deg: float):
    a = math.radians(turn_deg)
    turned = np.array(area) @ np.array([[math.cos(a), math.sin(a)], [-math.sin(a), math.cos(a)]])
    way = sweep([(float(n), float(e)) for n, e in turned], 3.0, (0.0, 0.0))
    lines = way.reshape(-1, 2, 2)
    assert len(way) % 2 == 0
    rng = np.random.default_rng(4)
    places = rng.uniform(turned.min(axis=0), turned.max(axis=0), (400, 2))
    for place in places[[inside((float(p[0]), float(p[1])), turned) for p in places]]:
        assert min(_distance(place, *line) for line in lines) <= 1.5 + 1e-6
    for begin, end in lines:
        middle = 0.5 * (begin + end)
        assert inside((float(middle[0]), float(middle[1])), turned), "no line outside"


def _distance(place: np.ndarray, begin: np.ndarray, end: np.ndarray) -> float:
    """Across an endless line where the place lies beside it; what a camera on it sees reaches beyond its ends, too."""
    line = end - begin
    share = np.clip((place - begin) @ line / (line @ line), -0.5, 1.5)
    return float(np.linalg.norm(begin + share * line - place))


def test_lines_run_along_the_longest_side_and_begin_near_the_vehicle():
    way = sweep(AREA, 3.0, (4.0, 6.0))
    assert len(way) == 6
    assert np.allclose(np.abs(np.diff(way.reshape(-1, 2, 2), axis=1))[:, 0], (0.0, 12.0))
    assert np.allclose(way[0], (4.0 - 4.0 / 3.0, 6.0))
    assert length_m(way, (4.0, 6.0)) == pytest.approx(3 * 12.0 + 2 * 8.0 / 3.0 + 4.0 / 3.0)


def test_along_a_line_the_vehicle_flies_nose_first_and_stops_at_the_end():
    config = SearchConfig()
    place, yaw, t = np.array([1.0, -1.0, -4.0]), math.pi, 0.0
    begin, end = np.array([0.0, 0.0]), np.array([0.0, 12.0])
    fastest, beside = 0.0, []
    while np.linalg.norm(end - place[:2]) > config.reached_m and t < 60.0:
        request = along(begin, end, place, yaw, config)
        velocity = np.array(request.vector)
        speed = float(np.linalg.norm(velocity[:2]))
        assert speed <= config.speed_m_s + 1e-9 and abs(velocity[2]) <= config.climb_m_s
        if speed > 1e-6:
            assert abs(wrap_angle(math.pi / 2 - yaw)) <= config.facing_rad
        fastest = max(fastest, speed)
        place = place + 0.05 * velocity
        yaw, t = yaw + 0.05 * request.yaw_rate_rad_s, t + 0.05
        if place[1] > 6.0:
            beside.append(abs(place[0]))
    assert t < 25.0 and fastest == pytest.approx(config.speed_m_s) and max(beside) < 0.1
    assert place[2] == pytest.approx(-config.height_m, abs=0.05)


def test_an_area_needs_three_corners():
    with pytest.raises(ConfigError, match="area: got 2 corners, expected at least three"):
        build(SearchConfig, {"area": [[0.0, 0.0], [1.0, 0.0]]}, "test")


class Vehicle:
    """The node and a vehicle that does as it is asked, or nothing while it is held."""

    def __init__(self, *overrides: str):
        self.run = ScriptedRun(SearchNode(load_config(None, [f"search.area={_text(AREA)}", *overrides]), "search"))
        self.place, self.yaw, self.t_ns = np.array([0.0, 0.0, -5.0]), 0.0, S
        self.held, self.obeyed = False, True
        self.status = SearchStatus(state="idle")
        self.asked: list[Request] = []
        self.places: list[np.ndarray] = []

    def fly(self, seconds: float) -> None:
        for _ in range(round(20 * seconds)):
            self.t_ns += S // 20
            self.tell()
            for output in self.run.step(self.t_ns):
                self.take(output.message)

    def tell(self) -> None:
        q = as_quat(quat_from_euler(0.0, 0.0, self.yaw))
        state = {"ned_v_m_s": (0.0, 0.0, 0.0), "body_rates_rad_s": (0.0, 0.0, 0.0), "armed": True, "in_air": True}
        north, east, down = self.place.tolist()
        self.run.feed(
            "helm/state",
            VehicleState(ned_p_m=(north, east, down), ned_q_body=q, mode="OFFBOARD", battery_fraction=0.9, **state),
            self.t_ns,
        )
        self.run.feed("helm/status", helm_status("search" if self.obeyed else "approach"), self.t_ns)

    def take(self, message: Any) -> None:
        if isinstance(message, SearchStatus):
            self.status = message
        elif isinstance(message, Request):
            self.asked.append(message)
            if self.obeyed and not self.held:
                self.place = self.place + 0.05 * np.array(message.vector)
                self.yaw += 0.05 * message.yaw_rate_rad_s
            self.places.append(self.place)

    def begin(self) -> Reply | None:
        self.tell()
        call, outputs = self.run.call("search/do/start", Command(operator="test"), self.t_ns)
        for output in outputs:
            self.take(output.message)
        if call.answer is None:
            assert any(isinstance(output.message, Request) for output in outputs), "helm has it before the reply"
            self.fly(0.05)
        return call.answer


def _text(area: tuple) -> str:
    return "[" + ",".join(f"[{n},{e}]" for n, e in area) + "]"


def test_the_whole_way_is_flown_then_nothing_is_asked():
    vehicle = Vehicle()
    assert vehicle.status.state == "idle"
    reply = vehicle.begin()
    assert reply == Reply(outcome="done", reason="2 lines, 34 m, about 23 s; `search` flies them")
    vehicle.fly(90.0)
    assert (vehicle.status.state, vehicle.status.reason) == ("idle", "flown to its end")
    places = np.array(vehicle.places)
    for corner in ((-2.0, -6.0), (-2.0, 6.0), (2.0, 6.0), (2.0, -6.0)):
        assert np.linalg.norm(places[:, :2] - corner, axis=1).min() < 0.6
    asked = len(vehicle.asked)
    vehicle.fly(1.0)
    assert len(vehicle.asked) == asked


def test_lines_lie_as_close_as_depth_sees_where_that_is_less():
    depth = "camera.down.depth={aligned=false,width=320,height=240,fx_px=320.0,fy_px=320.0,cx_px=159.5,cy_px=119.5}"
    narrow = Vehicle(depth).begin()
    assert narrow is not None and narrow.reason.startswith("3 lines"), "5.0 m wide instead of 7.3 m"
    colour_alone = Vehicle(depth, "people.use_depth=false").begin()
    assert colour_alone is not None and colour_alone.reason.startswith("2 lines")


def test_what_blocks_the_way_is_left_out_and_an_approach_only_interrupts():
    vehicle = Vehicle()
    vehicle.begin()
    vehicle.fly(3.0)
    vehicle.obeyed = False
    vehicle.fly(20.0)
    assert vehicle.status.state == "searching" and vehicle.status.skipped == 0, "helm obeys something else"
    corner = vehicle.status.next_corner
    vehicle.obeyed = vehicle.held = True
    vehicle.fly(9.0)
    assert (vehicle.status.next_corner, vehicle.status.skipped) == (corner + 1, 1)
    vehicle.held = False
    vehicle.fly(90.0)
    assert vehicle.status.reason == "flown to its end, 1 corners of it not reached"


def test_stop_ends_it():
    vehicle = Vehicle()
    vehicle.begin()
    call, _ = vehicle.run.call("search/do/stop", Command(), vehicle.t_ns)
    assert call.answer and call.answer.outcome == "done"
    asked = len(vehicle.asked)
    vehicle.fly(0.5)
    assert (vehicle.status.state, vehicle.status.reason, len(vehicle.asked)) == ("idle", "stopped", asked)


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["search.area=[]"], "names no area"),
        (["search.height_m=40.0"], "search.height_m: got 40, expected 1.5 to 20"),
        (
            ["limiter.fence=[[-5.0,-5.0],[-5.0,5.0],[5.0,5.0],[5.0,-5.0]]"],
            "0.0 m inside the fence, expected 1 or more",
        ),
        (["helm.containment.radius_m=7.0", "helm.containment.fence_band_m=2.0"], "0.7 m inside the fence"),
    ],
)
def test_what_cannot_be_searched_is_refused_with_the_reason(overrides: list[str], words: str):
    reply = Vehicle(*overrides).begin()
    assert reply and reply.outcome == "refused" and words in reply.reason
