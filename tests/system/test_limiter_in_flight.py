"""The pilot pushes, the limiter stops: one flight at walls, a person, a barrel and into a corner, judged by the true
distances.

Nothing of what is judged comes from the vehicle: the world measures how far every surface is from its centre. Each leg
begins at a place and heading of its own, so far off that the full speed is flown before the limiter takes any away.
"""

from __future__ import annotations

import math
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from common.geometry.rotation import euler_from_quat
from common.header import Received
from common.messages import LimiterStatus, Request, VehicleState
from common.truth import Truth
from onboard.limiter.config import LimiterConfig
from tests.system.flight import Flight, Seen
from tests.system.stack import Stack

pytestmark = pytest.mark.own_autopilot

FULL_M_S = 2.1
REACHED_M_S = 0.95 * FULL_M_S
HEIGHT_M = 1.6
NEAREST_M = 1.3
"""What the paper's law, flown with low drag, never comes nearer than, m."""
SETTLED_M = 0.2
"""It stops within so much of h_desired, m: the paper's decimetre, and what the push-back has yet to give back."""
BESIDE_M = 0.4
"""The same before somebody slender who has just come to a stop, m."""
FREEZE_AT_M, FREEZE_S = 5.8, 6.0
"""So far off that the limiter has to stop the vehicle for want of sight, before the wall does."""
KILL_AT_M = 4.0
"""So near that the wall has to be remembered."""
PERSON_NE_M = (7.0, 9.2)
"""Where the person stops in the vehicle's way."""
WALL_NE_M, BARREL_NE_M, CORNER_NE_M = (-1.4, 7.5), (0.2, 17.3), (10.54, 18.56)
CORNER_FROM_NE_M = (-0.36, 14.6)
"""On the line that halves the corner's angle, and not beside the barrel."""
SCENARIO = f"""
seed = 11

[ground]
kind = "gravel"
trees = 0
houses = 0
road = false

[car]
north_m = -12.0
east_m = -12.0

[[walls]]
start = [9.1, -2.5]
end = [9.1, 2.5]

[[people]]

[people.path]
mode = "ping_pong"
waypoints = [
    {{ north_m = {PERSON_NE_M[0] - 4.0}, east_m = {PERSON_NE_M[1]}, speed_m_s = 1.0, stop_s = 9.0 }},
    {{ north_m = {PERSON_NE_M[0]}, east_m = {PERSON_NE_M[1]}, speed_m_s = 1.0, stop_s = 6.0 }},
    {{ north_m = {PERSON_NE_M[0] + 5.0}, east_m = {PERSON_NE_M[1]}, speed_m_s = 1.0, stop_s = 15.0 }},
]

[[walls]]
start = [{WALL_NE_M[0]}, {WALL_NE_M[1] - 1.5}]
end = [{WALL_NE_M[0]}, {WALL_NE_M[1] + 1.5}]

[[barrels]]
north_m = {BARREL_NE_M[0]}
east_m = {BARREL_NE_M[1]}
radius_m = 1.0
height_m = 3.0

[[walls]]
start = [{CORNER_NE_M[0]}, {CORNER_NE_M[1]}]
end = [6.91, 20.25]

[[walls]]
start = [{CORNER_NE_M[0]}, {CORNER_NE_M[1]}]
end = [8.85, 14.93]

[depth]
noise_m = 0.004
noise_per_m = 0.0008
flying = 0.3
edge_holes = 0.2
holes = 0.03

[[depth_faults]]
kind = "frozen"
within_m = {FREEZE_AT_M}
for_s = {FREEZE_S}
"""


@dataclass(frozen=True)
class Leg:
    """What a push of the stick came to."""

    truths: list[Truth]
    """The world's truth while it lasted."""
    told: list[LimiterStatus]
    """What the limiter said meanwhile."""

    def distances_m(self, label: str = "") -> list[float]:
        """True distances to the nearest thing whose name begins so, m."""
        return [min(o.distance_m for o in t.obstacles if o.label.startswith(label)) for t in self.truths]

    def speeds_m_s(self) -> list[float]:
        """Horizontal speeds, m/s."""
        return [math.hypot(*t.ned_v_m_s[:2]) for t in self.truths]

    def check(self) -> None:
        """It was flown at the full speed, and nothing came nearer than it may."""
        assert max(self.speeds_m_s()) >= REACHED_M_S, "it never flew as fast as was asked"
        assert min(self.distances_m()) >= NEAREST_M
        assert "collision" not in {s.zone for s in self.told}

    def __str__(self) -> str:
        why = sorted({s.why for s in self.told})
        return (
            f"{max(self.speeds_m_s()):.2f} m/s, closest {min(self.distances_m()):.2f} m, at the end "
            f"{self.distances_m()[-1]:.2f} m at {self.speeds_m_s()[-1]:.2f} m/s, {len(self.truths)} pictures, {why}"
        )


class Pilot:
    """A hand on the stick, and the world's own measure of where the vehicle is."""

    def __init__(self, flight: Flight):
        self.flight = flight
        self.state = Seen(flight.bus, "helm/state")
        self.limiter = Seen(flight.bus, "helm/limiter")
        self.depth = Seen(flight.bus, "obstacles/depth")
        self.law = flight.stack.config.section(LimiterConfig)

    def push(
        self, from_ne_m: tuple[float, float], at_ne_m: tuple[float, float], limit_s: float, until: Callable[[], bool]
    ) -> Leg:
        """From a place, hold the stick fully forward, the nose on another place, until a condition; then let go."""
        self.begin(from_ne_m, at_ne_m)
        start_ns = time.monotonic_ns()
        while time.monotonic_ns() - start_ns < limit_s * 1e9 and not until():
            self._ask((FULL_M_S, 0.0), at_ne_m)
            time.sleep(0.05)
        self._ask((0.0, 0.0), None)
        return self.leg(start_ns)

    def leg(self, start_ns: int) -> Leg:
        """What came of it since a time."""
        truths = [r.message for r in self.flight.truth.since(start_ns)]
        return Leg(truths, [r.message for r in self.limiter.since(start_ns)])

    def begin(self, from_ne_m: tuple[float, float], at_ne_m: tuple[float, float]) -> None:
        """Fly to where a leg begins, nose where it leads to, by the stick and through the limiter as always."""
        limit_ns = time.monotonic_ns() + int(15e9)
        while True:
            north, east = (a - p for a, p in zip(from_ne_m, self.flight.truth.last.ned_p_m, strict=False))
            off_m, off_rad = math.hypot(north, east), self._aside_rad(at_ne_m)
            if off_m < 0.3 and abs(off_rad) < 0.1 and self.flight.speed_m_s < 0.3:
                return
            assert time.monotonic_ns() < limit_ns, f"{off_m:.2f} m, {off_rad:.2f} rad off; {self.limiter.last}"
            share = min(1.2, 1.0 / max(off_m, 1e-6))
            c, s = math.cos(self._yaw_rad()) * share, math.sin(self._yaw_rad()) * share
            self._ask((c * north + s * east, c * east - s * north), at_ne_m)
            time.sleep(0.05)

    def _ask(self, ahead_right_m_s: tuple[float, float], at_ne_m: tuple[float, float] | None) -> None:
        """Ask for a velocity, and for a turn of the nose to a place."""
        turn = min(max(1.5 * self._aside_rad(at_ne_m), -0.8), 0.8) if at_ne_m else 0.0
        request = Request(frame="heading", vector=(*ahead_right_m_s, 0.0), yaw_rate_rad_s=turn)
        newest: Received[VehicleState] = self.state.all[-1]
        self.flight.bus.publish("helm/request/operator", request, newest.header.capture_ns)

    def _yaw_rad(self) -> float:
        return euler_from_quat(self.state.all[-1].message.ned_q_body)[2]

    def _aside_rad(self, ne_m: tuple[float, float]) -> float:
        """How far to the right of the nose a place lies, rad."""
        north, east, _ = self.flight.truth.last.ned_p_m
        return math.remainder(math.atan2(ne_m[1] - east, ne_m[0] - north) - self._yaw_rad(), math.tau)

    def distance_m(self, label: str = "") -> float:
        """True distance to the nearest thing whose name begins so, m."""
        return min(o.distance_m for o in self.flight.truth.last.obstacles if o.label.startswith(label))

    def stands(self) -> bool:
        """Whether the vehicle has about stopped for 0.3 s."""
        recent = self.flight.truth.since(time.monotonic_ns() - 300_000_000)
        return len(recent) > 3 and max(math.hypot(*r.message.ned_v_m_s[:2]) for r in recent) < 0.15

    def arrived(self, label: str, beyond_m: float) -> Callable[[], bool]:
        """A condition: it stands within so much beyond h_desired of a thing."""
        return lambda: self.distance_m(label) <= self.law.h_desired_m + beyond_m and self.stands()

    def person(self) -> tuple[float, float]:
        """True place and speed of the walking person towards the north, m and m/s."""
        truth: Truth = self.flight.truth.last
        found = next(o for o in truth.obstacles if o.label == "person 1")
        return found.ned_p_m[0], found.ned_v_m_s[0]


@pytest.fixture(scope="module")
def pilot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Pilot]:
    """A heron that hovers at home, with all that flies it."""
    folder = tmp_path_factory.mktemp("limiter")
    scenario: Path = folder / "places.toml"
    scenario.write_text(SCENARIO)
    stack = Stack(folder, (f"world.scenario={scenario}",), vehicle="heron")
    try:
        stack.start("onboard", "--without", "follow", "--without", "approach")
        stack.start("sim")
        stack.start("ground", "--without", "console", "--without", "pursuit", "--without", "recorder")
        flight = Flight(stack)
        pilot = Pilot(flight)
        flight.take_off(HEIGHT_M)
        flight.wait("sight", lambda: pilot.limiter.last is not None and max(pilot.limiter.last.sectors_m) > 0.0, 5)
        yield pilot
        flight.check_machine()
    finally:
        stack.end()


def test_the_depth_camera_freezes_on_the_way_to_a_wall(pilot: Pilot) -> None:
    """It stands until the picture thaws; the later legs are flown in the sight that came back."""

    def blind() -> bool:
        views = pilot.depth.last.views
        return bool(views) and not any(any(v.seen) for v in views)

    leg = pilot.push((0.0, 0.0), (9.1, 0.0), 14.0, until=lambda: blind() and pilot.stands())
    print(f"frozen at {FREEZE_AT_M} m: {leg}")
    leg.check()
    assert leg.distances_m()[-1] < FREEZE_AT_M and blind() and pilot.stands(), "it stands while the picture is frozen"
    assert "blind" in {s.why for s in leg.told}


def test_a_person_walks_into_the_way(pilot: Pilot) -> None:
    """Seen from the side at first, then right ahead, where the person stops."""
    start_ne_m = (PERSON_NE_M[0], 0.0)
    pilot.begin(start_ne_m, PERSON_NE_M)
    south_m, near_m = PERSON_NE_M[0] - 3.2, PERSON_NE_M[0] - 1.5
    pilot.flight.wait("the person", lambda: south_m < pilot.person()[0] < near_m and pilot.person()[1] > 0.6, 90)
    leg = pilot.push(start_ne_m, PERSON_NE_M, 9.0, until=pilot.arrived("person", BESIDE_M))
    print(f"walking person: {leg}")
    leg.check()
    walked = [o.ned_v_m_s[0] for t in leg.truths for o in t.obstacles if o.label == "person 1"]
    assert walked[0] > 0.6 and min(walked) < 0.1, "the person came and stopped"
    assert leg.distances_m("person")[-1] <= pilot.law.h_desired_m + BESIDE_M, "it stands before the person"


def test_the_node_that_supplies_obstacles_is_killed_on_approach(pilot: Pilot) -> None:
    killed: list[int] = []

    def stands_before_the_wall() -> bool:
        if not killed and pilot.distance_m("wall") < KILL_AT_M:
            killed.append(pilot.flight.stack.kill("proximity"))
        return pilot.arrived("wall", SETTLED_M)()

    leg = pilot.push((PERSON_NE_M[0], WALL_NE_M[1]), WALL_NE_M, 20.0, until=stands_before_the_wall)
    print(f"proximity killed at {KILL_AT_M} m: {leg}")
    leg.check()
    assert killed, "it never came near enough"
    assert leg.distances_m("wall")[-1] <= pilot.law.h_desired_m + SETTLED_M, "it stands before the wall"
    pilot.flight.wait("proximity again", lambda: pilot.flight.stack.pid("proximity") not in (None, killed[0]), 10)


def test_a_barrel(pilot: Pilot) -> None:
    leg = pilot.push((BARREL_NE_M[0], WALL_NE_M[1]), BARREL_NE_M, 12.0, until=pilot.arrived("barrel", SETTLED_M))
    print(f"barrel: {leg}")
    leg.check()
    assert leg.distances_m("barrel")[-1] == pytest.approx(pilot.law.h_desired_m, abs=SETTLED_M)
    assert {"warning", "transition"} <= {s.zone for s in leg.told}


def test_into_a_corner_of_two_walls(pilot: Pilot) -> None:
    leg = pilot.push(CORNER_FROM_NE_M, CORNER_NE_M, 12.0, until=pilot.arrived("wall 3", SETTLED_M))
    both_m = [leg.distances_m(wall)[-1] for wall in ("wall 3", "wall 4")]
    print(f"corner: {leg}, {both_m}")
    leg.check()
    assert both_m == pytest.approx([pilot.law.h_desired_m] * 2, abs=2 * SETTLED_M), "it stands before both walls"


def test_backwards_off_the_sensors_view(pilot: Pilot) -> None:
    """From the command line, which holds the same stick."""
    start_ns, from_m = time.monotonic_ns(), pilot.distance_m()
    words = ["do", "stick", f"--forward={-FULL_M_S}", "--for", "3", *pilot.flight.stack.arguments()]
    held = subprocess.run([sys.executable, "-m", "common.cli", *words], capture_output=True, text=True, timeout=30)
    assert (held.returncode, held.stdout) == (0, "stick: done: held for 3 s\n"), held
    leg = pilot.leg(start_ns)
    print(f"backwards: {leg}")
    assert min(leg.distances_m()) >= NEAREST_M
    assert max(leg.speeds_m_s()) <= pilot.law.unseen_speed_m_s + 0.25, "no faster than the unseen allows"
    assert leg.distances_m()[-1] > from_m + 1.0, "it moves"
    assert "blind" in {s.why for s in leg.told}
