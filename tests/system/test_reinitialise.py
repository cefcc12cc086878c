"""The pictures stop while the car drives on: the tracker finds it again by itself, elsewhere, and the chase goes on."""

from __future__ import annotations

import math
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

from common.messages import Track
from tests.system.flight import Flight, Seen

SCENARIO = """
seed = 5
[car.path]
turn_radius_m = 0.8
start_delay_s = 9.0
waypoints = [
    { north_m = 1.2, east_m = 0.0, speed_m_s = 1.0 },
    { north_m = 1.2, east_m = 3.0, speed_m_s = 1.0 },
    { north_m = -1.8, east_m = 3.0, speed_m_s = 1.0 },
    { north_m = -1.8, east_m = 0.0, speed_m_s = 1.0 },
]
"""


def _target_moves(flight: Flight) -> bool:
    return math.hypot(*flight.truth.last.target_ned_v_m_s[:2]) > 0.5


def test_target_is_found_again_by_itself_in_flight(make_flight: Callable[..., Flight], tmp_path: Path) -> None:
    scenario = tmp_path / "square.toml"
    scenario.write_text(SCENARIO)
    flight = make_flight(f"world.scenario={scenario}")
    health = Seen(flight.bus, "health/pursuit")
    flight.take_off(7.0)
    flight.chase()
    flight.wait("chase of the moving car", lambda: _target_moves(flight) and flight.error_m < 1.0, 20)

    pid = flight.stack.kill("camera", signal.SIGSTOP)
    time.sleep(3.5)
    os.kill(pid, signal.SIGCONT)
    back_ns = time.monotonic_ns()
    flight.wait("reinitialisation", lambda: bool(health.last) and health.last.metrics["reinitialisations"] >= 1, 8)
    flight.wait(
        "chase after the reinitialisation",
        lambda: flight.tracking and flight.state == "pursuit" and flight.error_m < 1.2,
        10,
    )
    tracks: list[Track] = [r.message for r in flight.track.since(back_ns)]
    assert any(t.state == "lost" for t in tracks), "it was lost first"
    assert not flight.stack.log("ground").count("Traceback")
    assert flight.height_m > 5.0
