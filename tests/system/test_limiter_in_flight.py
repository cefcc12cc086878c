"""The pilot pushes, the limiter stops: one flight at a barrel, a person and a corner, judged by the true distances.

Nothing of what is judged comes from the vehicle: the world measures how far every surface is from its centre.
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
from common.messages import Request, VehicleState
from common.truth import Truth
from onboard.limiter.config import LimiterConfig
from tests.system.stack import Flight, Seen, Stack

pytestmark = pytest.mark.own_autopilot

FULL_M_S = 2.1
HEIGHT_M = 1.6
NEAR_M = 0.45
"""So far beyond h_desired a stop still is one before the obstacle, m."""
BESIDE_M = 0.7
"""The same before somebody slender, whom a stick held on slides round, m."""
FREEZE_AT_M, FREEZE_S = 4.0, 5.0
CROSSING_NORTH_M = 6.2
"""Where the person stops in the vehicle's way: about where it stands before the barrel."""
STILL_M_S = 0.12
SCENARIO = f"""
seed = 11

[ground]
kind = "gravel"
trees = 0
houses = 0
road = false

[car]
north_m = -12.0
east_m = 12.0

[[barrels]]
north_m = 8.6
east_m = 0.0
radius_m = 1.0
height_m = 3.0

[[walls]]
start = [-2.0, -4.0]
end = [0.1, -1.9]

[[walls]]
start = [-2.0, -4.0]
end = [0.1, -6.1]

[[people]]

[people.path]
mode = "ping_pong"
waypoints = [
    {{ north_m = 3.0, east_m = -5.0, speed_m_s = 1.0, stop_s = 1.0 }},
    {{ north_m = {CROSSING_NORTH_M}, east_m = -5.0, speed_m_s = 1.0, stop_s = 4.0 }},
    {{ north_m = 9.4, east_m = -5.0, speed_m_s = 1.0, stop_s = 1.0 }},
]

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
    """The world's truth while it lasted and just after."""

    def closest_m(self, kind: str = "") -> float:
        """Least true distance to a thing of a kind, m."""
        return min(o.distance_m for t in self.truths for o in t.obstacles if o.label.startswith(kind))

    def last_m(self, kind: str) -> list[float]:
        """True distances at its end to the things of a kind, m."""
        return [o.distance_m for o in self.truths[-1].obstacles if o.label.startswith(kind)]

    def speeds_m_s(self) -> list[float]:
        """Horizontal speeds, m/s."""
        return [math.hypot(*t.ned_v_m_s[:2]) for t in self.truths]


class Pilot:
    """A hand on the stick, and the world's own measure of where the vehicle is."""

    def __init__(self, flight: Flight):
        self.flight = flight
        self.state = Seen(flight.bus, "helm/state")
        self.limiter = Seen(flight.bus, "helm/limiter")
        self.depth = Seen(flight.bus, "obstacles/depth")
        self.law = flight.stack.config.section(LimiterConfig)

    def push(
        self,
        forward_m_s: float,
        limit_s: float,
        until: Callable[[float], bool] = lambda held_s: False,
        turn_rad_s: Callable[[], float] = lambda: 0.0,
    ) -> Leg:
        """Hold the stick for a time, or until a condition on the time it has been held; then let go."""
        start_ns = time.monotonic_ns()
        while (held_s := (time.monotonic_ns() - start_ns) / 1e9) < limit_s and not until(held_s):
            self._ask(Request(frame="heading", vector=(forward_m_s, 0.0, 0.0), yaw_rate_rad_s=turn_rad_s()))
            time.sleep(0.05)
        self._ask(Request(frame="heading", vector=(0.0, 0.0, 0.0)))
        return Leg([r.message for r in self.flight.truth.since(start_ns)])

    def _ask(self, request: Request) -> None:
        newest: Received[VehicleState] = self.state.all[-1]
        self.flight.bus.publish("helm/request/operator", request, newest.header.capture_ns)

    def face(self, bearing_deg: float) -> None:
        """Turn the nose by the stick; it is let go before the end, for the vehicle turns on a little."""

        def off() -> float:
            yaw = euler_from_quat(self.state.all[-1].message.ned_q_body)[2]
            return math.remainder(math.radians(bearing_deg) - yaw, math.tau)

        self.push(0.0, 8.0, until=lambda _: abs(off()) < 0.05, turn_rad_s=lambda: min(max(2.0 * off(), -0.8), 0.8))
        assert abs(off()) < 0.15, f"did not turn to {bearing_deg} degrees; {self.flight.status.last}"

    def still(self, for_s: float = 1.0) -> bool:
        """Whether it has not moved for a while."""
        recent = self.flight.truth.since(time.monotonic_ns() - int(for_s * 1e9))
        return len(recent) > 5 and max(math.hypot(*r.message.ned_v_m_s[:2]) for r in recent) < STILL_M_S

    def person(self) -> tuple[float, float]:
        """True place and speed of the walking person towards the north, m and m/s."""
        truth: Truth = self.flight.truth.last
        found = next(o for o in truth.obstacles if o.label == "person 1")
        return found.ned_p_m[0], found.ned_v_m_s[0]


@pytest.fixture(scope="module")
def pilot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Pilot]:
    """A heron that hovers before the barrel, with all that flies it."""
    folder = tmp_path_factory.mktemp("limiter")
    scenario: Path = folder / "places.toml"
    scenario.write_text(SCENARIO)
    stack = Stack(folder, (f"world.scenario={scenario}",), vehicle="heron")
    try:
        stack.start("onboard")
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


def test_the_depth_camera_freezes_on_the_way_to_a_barrel(pilot: Pilot) -> None:
    """Also the plain barrel: the picture thaws while the stick is still held forward."""
    start_ns = time.monotonic_ns()
    leg = pilot.push(FULL_M_S, FREEZE_S + 4.5)
    assert max(leg.speeds_m_s()) > 1.3, "it never flew"
    frozen_m = Leg(leg.truths[: int(20 * (FREEZE_S + 2.0))]).closest_m("barrel")
    print(f"frozen at {FREEZE_AT_M} m: stood at {frozen_m:.2f} m; thawed: {leg.last_m('barrel')[0]:.2f} m")
    assert leg.closest_m() >= pilot.law.h_min_m
    assert leg.last_m("barrel")[0] <= pilot.law.h_desired_m + NEAR_M, "it stands before the barrel, not somewhere"
    told = [r.message for r in pilot.limiter.since(start_ns)]
    views = [v for r in pilot.depth.since(start_ns) for v in r.message.views]
    assert any(not any(v.seen) for v in views), "it was noticed: a frozen picture is no sight"
    assert {"warning", "transition"} <= {s.zone for s in told}


def test_backwards_off_the_sensors_view(pilot: Pilot) -> None:
    """From the command line, which holds the same stick."""
    start_ns = time.monotonic_ns()
    words = ["do", "stick", f"--forward={-FULL_M_S}", "--for", "5", *pilot.flight.stack.arguments()]
    held = subprocess.run([sys.executable, "-m", "common.cli", *words], capture_output=True, text=True, timeout=30)
    assert (held.returncode, held.stdout) == (0, "stick: done: held for 5 s\n"), held
    leg = Leg([r.message for r in pilot.flight.truth.since(start_ns)])
    print(f"backwards: {max(leg.speeds_m_s()):.2f} m/s")
    assert leg.closest_m() >= pilot.law.h_min_m
    assert max(leg.speeds_m_s()) <= pilot.law.unseen_speed_m_s + 0.25, "no faster than the unseen allows"
    assert leg.last_m("barrel")[0] > pilot.law.h_desired_m + 1.0, "it moves"
    assert "blind" in {r.message.why for r in pilot.limiter.since(start_ns)}


def test_the_node_that_supplies_obstacles_is_killed_on_approach(pilot: Pilot) -> None:
    flight, killed = pilot.flight, []

    def hold(held_s: float) -> bool:
        barrel_m = next(o.distance_m for o in flight.truth.last.obstacles if o.label == "barrel 1")
        if not killed and (barrel_m < 2.9 and flight.speed_m_s > 0.5):
            killed.append(flight.stack.kill("proximity"))
        return False

    leg = pilot.push(FULL_M_S, 8.0, until=hold)
    assert killed, "it never came near enough"
    print(f"proximity killed: {leg.closest_m():.2f} m, then {leg.last_m('barrel')[0]:.2f} m")
    assert flight.stack.pid("proximity") not in (None, killed[0]), "the supervisor brought it back"
    assert leg.closest_m() >= pilot.law.h_min_m
    assert leg.last_m("barrel")[0] <= pilot.law.h_desired_m + NEAR_M


def test_a_person_walks_into_the_way(pilot: Pilot) -> None:
    """Seen from the side at first, then right ahead, where the person stops."""
    pilot.face(270.0)
    south_m, near_m = CROSSING_NORTH_M - 2.6, CROSSING_NORTH_M - 1.4
    pilot.flight.wait("the person", lambda: south_m < pilot.person()[0] < near_m and pilot.person()[1] > 0.6, 40)
    leg = pilot.push(FULL_M_S, 5.0)
    walked = [o.ned_v_m_s[0] for t in leg.truths for o in t.obstacles if o.label == "person 1"]
    print(f"walking person: {leg.closest_m('person'):.2f} m, at the end {leg.last_m('person')[0]:.2f} m")
    assert walked[0] > 0.6 and min(walked) < 0.1, "the person came and stopped"
    assert leg.closest_m() >= pilot.law.h_min_m
    assert leg.last_m("person")[0] <= pilot.law.h_desired_m + BESIDE_M, "it stands before the person"
    assert max(leg.speeds_m_s()) > 0.8


def test_into_a_corner_of_two_walls(pilot: Pilot) -> None:
    pilot.face(180.0)
    pilot.flight.wait("the person to go away", lambda: pilot.person()[0] > CROSSING_NORTH_M + 1.2, 40)
    leg = pilot.push(FULL_M_S, 12.0, until=lambda held_s: held_s > 5.0 and pilot.still())
    print(f"corner: {leg.closest_m('wall'):.2f} m; at the end {leg.last_m('wall')}")
    assert leg.closest_m() >= pilot.law.h_min_m
    assert max(leg.speeds_m_s()) > 0.9, "it has some three metres to gather speed"
    assert max(leg.last_m("wall")) <= pilot.law.h_desired_m + NEAR_M, "it stands in the corner, before both walls"
