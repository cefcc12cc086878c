"""The approach: what the operator means, what stays the same thing, the way to it; the node with scripted inputs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from common.config import Config, ConfigError, build
from common.messages import (
    ApproachTarget,
    Command,
    Obstacle,
    Obstacles,
    People,
    Person,
    Request,
    Vec3,
    VehicleState,
)
from common.node import ScriptedRun
from onboard.approach.config import ApproachConfig
from onboard.approach.law import closing
from onboard.approach.node import ApproachNode
from onboard.approach.target import SelectError, Sighting, Target, choose, follow
from tests.flying import flying

CONFIG = ApproachConfig()
S = 1_000_000_000
HERE = np.array([0.0, 0.0, -2.0])


def sighting(north: float, east: float, down: float = -2.0, label: str = "") -> Sighting:
    return Sighting(np.array([north, east, down]), np.zeros(3), label)


SEEN = [
    sighting(6.0, 0.5),
    sighting(5.8, 0.6),
    sighting(3.0, 4.0, label="person 2"),
    sighting(2.5, 0.0, 0.0),  # the ground ahead
    sighting(-1.0, 0.0),
]


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        (Command(), (5.8, 0.6)),
        (Command(label="person 2"), (3.0, 4.0)),
        (Command(bearing_rad=math.radians(50.0)), (3.0, 4.0)),
        (Command(bearing_rad=math.pi), (-1.0, 0.0)),
        (Command(ned_p_m=(6.2, 0.2, -2.5)), (5.8, 0.6)),
    ],
)
def test_the_operator_means_what_lies_there(command: Command, expected: tuple[float, float]) -> None:
    target = choose(SEEN, command, HERE, 0.0, S, CONFIG)
    assert tuple(target.ned_p_m[:2]) == expected


@pytest.mark.parametrize(
    ("command", "seen", "message"),
    [
        (Command(label="person 3"), SEEN, "'person 3', which is not seen; named things that are seen: person 2"),
        (Command(bearing_rad=-1.5), SEEN, "within 15 degrees of -86 degrees"),
        (Command(ned_p_m=(20.0, 0.0, 0.0)), SEEN, "within 1.5 m of the point"),
        (Command(), [sighting(-4.0, 0.0)], "nothing is seen ahead; the nearest of 1 points is 4.0 m away"),
        (Command(), [], "nothing is seen at all"),
    ],
)
def test_what_is_not_there_is_refused_with_what_is(command: Command, seen: list[Sighting], message: str) -> None:
    with pytest.raises(SelectError, match=message):
        choose(seen, command, HERE, 0.0, S, CONFIG)


def test_a_walking_body_is_followed_past_a_standing_one_and_its_nearest_point_counts() -> None:
    """The points of a body of 0.4 m, walking at 1.2 m/s towards one that stands 2 m off its way."""
    target = Target(np.array([4.0, 0.0, -2.0]), np.zeros(3), "", 0)
    for k in range(1, 40):
        east = 1.2 * 0.1 * k
        body = [sighting(4.0 + 0.2 * (1 - math.cos(a)), east + 0.2 * math.sin(a)) for a in (-1.0, -0.5, 0.0, 0.5, 1.0)]
        target = follow(target, [*body, sighting(6.0, 2.4), sighting(5.5, 2.5)], HERE, k * S // 10, CONFIG)
        assert abs(target.ned_p_m[1] - east) < 0.35, k
    assert target.seen_ns == 39 * S // 10
    assert target.ned_v_m_s[1] == pytest.approx(1.2, abs=0.4)


def test_a_thing_that_is_not_seen_stays_as_it_was_and_another_one_does_not_take_its_place() -> None:
    target = Target(np.array([4.0, 0.0, -2.0]), np.zeros(3), "", 0)
    assert follow(target, [sighting(4.0, 2.5)], HERE, S, CONFIG) is target
    assert follow(target, [], HERE, S, CONFIG) is target
    assert follow(target, [sighting(4.2, 0.1)], HERE, 10 * S, CONFIG) is target, "forgotten"
    named = Target(np.array([4.0, 0.0, -2.0]), np.zeros(3), "person 1", 0)
    assert follow(named, [sighting(4.0, 0.1, label="person 2")], HERE, S // 10, CONFIG) is named
    found = follow(named, [sighting(8.0, 3.0, label="person 1")], HERE, 20 * S, CONFIG)
    assert found.seen_ns == 20 * S, "a name is recognised wherever it is"


def test_it_sinks_above_what_lies_below_and_never_climbs() -> None:
    config = ApproachConfig(sink_m_s=0.5)
    high = np.array([0.0, 0.0, -5.0])

    def down(north: float, height_m: float, config: ApproachConfig = config) -> float:
        return closing(np.array([north, 0.0, 0.0]), np.array([0.0, 0.0, -height_m]), 0.0, 2.5, config).vector[2]

    assert down(4.0, 5.0) == 0.5 and down(6.0, 5.0) == 0.0, "in a cone of 45 degrees"
    assert down(0.1, 5.0) == 0.5 and down(0.1, 2.65) == pytest.approx(0.3, abs=0.02), "slower as it arrives"
    assert down(0.1, 2.5) == 0.0 and down(0.1, 1.0) == 0.0, "there, and nearer"
    assert down(0.0, 5.0, CONFIG) == 0.0, "it keeps its height unless told to"
    assert closing(np.array([3.0, 0.0, -9.0]), high, 0.0, 2.5, config).vector[2] == 0.0, "above: no climb"


def test_the_way_faces_first_then_closes_in_then_holds() -> None:
    far = closing(np.array([0.0, 6.0, -2.0]), HERE, 0.0, 1.5, CONFIG)
    assert far.vector == (0.0, 0.0, 0.0), "not before it faces it"
    assert far.yaw_rate_rad_s == CONFIG.yaw_rate_rad_s
    assert {type(c) for c in (*far.vector, far.yaw_rate_rad_s)} == {float}, "nothing else can be sent"
    ahead = closing(np.array([6.0, 0.0, -2.0]), HERE, 0.0, 1.5, CONFIG)
    assert ahead.vector == pytest.approx((CONFIG.speed_m_s, 0.0, 0.0))
    near = closing(np.array([1.8, 0.0, -2.0]), HERE, 0.0, 1.5, CONFIG)
    assert near.vector[0] == pytest.approx(CONFIG.gain_1_s * 0.3)
    for distance in (1.55, 1.2, 0.5):
        held = closing(np.array([distance, 0.0, -2.0]), HERE, 0.0, 1.5, CONFIG)
        assert held.vector == (0.0, 0.0, 0.0), "it holds, and does not back away"
    above = closing(np.array([0.1, 0.0, 0.0]), HERE, 0.0, 1.5, CONFIG)
    assert (above.vector, above.yaw_rate_rad_s) == ((0.0, 0.0, 0.0), 0.0)


def test_contradicting_settings_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"lost_after_s: got 4.*less than forget_after_s = 3"):
        build(ApproachConfig, {"lost_after_s": 4.0}, "test")


class Rig:
    """The node on a vehicle that flies as asked, before a barrel that a depth camera sees while it looks there."""

    def __init__(self) -> None:
        sections = {
            "approach": "onboard.approach.config:ApproachConfig",
            "limiter": "onboard.limiter.config:LimiterConfig",
        }
        self.run = ScriptedRun(ApproachNode(Config({}, sections), "approach"))
        self.t_ns = S
        self.p, self.yaw, self.v = np.array([0.0, 0.0, -2.0]), 0.5, np.zeros(3)
        self.barrel = np.array([6.0, 0.0, -2.0])
        self.sees = True
        self.requests: list[Request] = []
        self.told: ApproachTarget | None = None

    def go(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.05)):
            self.t_ns += S // 20
            self.p = self.p + 0.05 * self.v
            self.run.feed("helm/state", self._state(), self.t_ns)
            if self.sees and self.t_ns % (S // 10) == 0:
                self.run.feed("obstacles/depth", self._depth(), self.t_ns)
            requests = []
            for output in self.run.step(self.t_ns):
                if isinstance(output.message, ApproachTarget):
                    self.told = output.message
                elif isinstance(output.message, Request):
                    assert output.topic == "helm/request/approach"
                    requests.append(output.message)
            self.requests += requests
            asked = requests[-1] if requests else None
            self.v = np.array(asked.vector) if asked else np.zeros(3)
            self.yaw += 0.05 * asked.yaw_rate_rad_s if asked else 0.0

    def call(self, name: str, command: Command) -> str:
        call, outputs = self.run.call(f"approach/do/{name}", command, self.t_ns)
        if call.answer is None:
            assert [o for o in outputs if isinstance(o.message, Request)], "the first request comes before the answer"
            self.go(0.05)
        assert call.answer is not None
        return f"{call.answer.outcome}: {call.answer.reason}"

    def _state(self) -> VehicleState:
        half = self.yaw / 2
        return flying(
            ned_p_m=_vec(self.p), ned_v_m_s=_vec(self.v), ned_q_body=(math.cos(half), 0.0, 0.0, math.sin(half))
        )

    def _depth(self) -> Obstacles:
        offset = self.barrel - self.p
        distance = float(np.linalg.norm(offset))
        return Obstacles(obstacles=(Obstacle(distance_m=distance, ned_direction=_vec(offset / distance)),))


def _vec(v: np.ndarray) -> Vec3:
    return float(v[0]), float(v[1]), float(v[2])


def test_node_closes_in_to_the_distance_facing_the_thing_and_hovers_when_it_is_lost() -> None:
    rig = Rig()
    rig.go(1.0)
    assert rig.requests == []
    assert rig.told is not None and (rig.told.state, rig.told.reason) == ("idle", "nothing is selected")
    assert rig.call("select", Command()) == "done: the thing at 6.0 m; `approach` closes in"
    rig.go(12.0)
    assert np.linalg.norm(rig.barrel - rig.p) == pytest.approx(1.5, abs=0.15)
    assert rig.yaw == pytest.approx(0.0, abs=0.05)
    assert rig.told.state == "tracking"
    assert rig.told.distance_m == pytest.approx(1.5, abs=0.15)

    rig.sees = False
    rig.go(0.7)
    rig.requests.clear()
    rig.go(1.0)
    assert rig.requests == [], "what is not seen is not approached"
    assert rig.told.state == "lost" and "not seen for" in rig.told.reason
    rig.sees = True
    rig.go(0.5)
    assert rig.requests and rig.told.state == "tracking", "found again where it was"

    assert rig.call("stop", Command()).startswith("done")
    rig.requests.clear()
    rig.go(0.5)
    assert rig.requests == []
    rig.barrel = np.array([-6.0, 0.0, -2.0])
    rig.go(0.2)
    assert rig.call("select", Command()).startswith("refused: nothing is seen ahead")


def test_node_flies_to_where_a_person_was_last_seen_and_loses_who_is_not_there() -> None:
    rig = Rig()
    rig.sees = False
    person = Person(
        number=3, name="Anna", state="away", ned_p_m=(5.0, 2.0, -1.9), first_seen_ns=0, last_seen_ns=0, pictures=9
    )
    gone = Person(
        number=4, name="x", state="dismissed", ned_p_m=(1.0, 0.0, 0.0), first_seen_ns=0, last_seen_ns=0, pictures=9
    )

    def fly(seconds: float) -> None:
        for _ in range(round(2 * seconds)):
            rig.run.feed("people/tracks", People(people=(person, gone)), rig.t_ns)
            rig.go(0.5)

    fly(0.5)
    assert rig.call("select", Command(label="person 4")).startswith("refused")
    assert rig.call("select", Command(label="person 3")).startswith("done: person 3 at 5.4 m")
    fly(3.0)
    assert rig.told is not None and rig.told.state == "tracking"
    fly(7.0)
    assert np.hypot(*(rig.p - (5.0, 2.0, -1.9))[:2]) == pytest.approx(1.7, abs=0.15)
    assert rig.told.state == "lost" and "not seen for" in rig.told.reason
