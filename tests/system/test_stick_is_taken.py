"""Who holds the stick: a ground station, a hung helm, a lost link, a second helm, a lost autopilot."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import common as mavlink

from tests.system.flight import LANDS_FAST, Flight, Seen

MakeFlight = Callable[..., Flight]
FREEZER = Path(__file__).parent / "freezer"


def _ground_station_holds(port: int) -> None:
    """What QGroundControl's pause button sends, from a second MAVLink client."""
    station = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}", source_system=255)
    assert station.recv_match(type="HEARTBEAT", blocking=True, timeout=5) is not None
    station.mav.heartbeat_send(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0)
    station.mav.command_long_send(1, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1, 4, 3, 0, 0, 0, 0)
    deadline = time.monotonic() + 3
    while time.monotonic() < deadline:
        ack = station.recv_match(type="COMMAND_ACK", blocking=True, timeout=1)
        if ack is not None and ack.command == mavlink.MAV_CMD_DO_SET_MODE:
            assert ack.result == mavlink.MAV_RESULT_ACCEPTED
            station.close()
            return
    raise AssertionError("the autopilot did not acknowledge the ground station's HOLD")


def _stays_yielded(flight: Flight, seconds: float) -> None:
    """Helm sends nothing and obeys nobody."""
    since_ns = time.monotonic_ns()
    time.sleep(seconds)
    assert flight.state == "yielded"
    assert flight.setpoints.since(since_ns) == []
    assert flight.speed_m_s < 0.5
    assert flight.height_m > 3.0


def _second_helm_is_refused(flight: Flight) -> None:
    """A second helm for the same vehicle does not start, and the first keeps the stick."""
    second = subprocess.run(
        [sys.executable, "-m", "common.cli", "node", "helm", *flight.stack.arguments()],
        capture_output=True,
        text=True,
        timeout=30,
    )
    assert second.returncode == 3, second.stderr
    assert "one helm commands a vehicle" in second.stderr
    assert flight.state == "hold"


@pytest.mark.own_autopilot
def test_stick_changes_hands(make_flight: MakeFlight) -> None:
    path = os.pathsep.join(filter(None, [str(FREEZER), os.environ.get("PYTHONPATH", "")]))
    flight = make_flight(
        "helm.link_loss_after_s=4",
        'helm.link_loss_action="return"',
        LANDS_FAST,
        link=True,
        parked=True,
        environment={"PYTHONPATH": path},
    )
    flight.take_off()
    flight.chase()
    flight.wait("place over the car", lambda: flight.error_m < 1.5, 10)

    # A ground station commands HOLD: helm lets go at once and stays away until told otherwise.
    _ground_station_holds(flight.stack.gcs_port)
    flight.wait("helm to yield", lambda: flight.state == "yielded", 3)
    assert "engage" in flight.status.last.reason.lower()
    time.sleep(1.5)
    _stays_yielded(flight, 3)
    flight.must("helm/do/engage")
    flight.wait("hold", lambda: flight.state == "hold", 5)
    if not flight.tracking:
        flight.select()
    flight.must("helm/do/chase")
    flight.wait("chase", lambda: flight.state == "pursuit" and flight.error_m < 1.5, 20)

    # Python stands still inside helm: setpoints stop with it, the autopilot holds, helm does not take it back.
    flight.stack.kill("helm", signal.SIGUSR1)
    flight.wait("helm to yield after its hang", lambda: flight.state == "yielded", 8)
    time.sleep(1.5)
    _stays_yielded(flight, 2)
    flight.must("helm/do/engage")
    flight.wait("hold", lambda: flight.state == "hold", 5)

    _second_helm_is_refused(flight)

    # The ground link is cut for a second: hover, then the chase goes on by itself.
    vehicle_bus = flight.stack.bus("onboard", "test-onboard")
    onboard_status, onboard_setpoints = Seen(vehicle_bus, "helm/status"), Seen(vehicle_bus, "helm/setpoint")
    if not flight.tracking:
        flight.select()
    flight.must("helm/do/chase")
    flight.wait("chase", lambda: flight.state == "pursuit" and flight.error_m < 1.5, 20)
    assert flight.link is not None
    cut_ns = time.monotonic_ns()
    flight.link.cut()
    time.sleep(1.0)
    flight.link.join()
    assert any(s.message.source == "helm" for s in onboard_setpoints.since(cut_ns)), "no hover while the link was cut"
    flight.wait(
        "chase after a short cut",
        lambda: onboard_status.last.state == "pursuit" and onboard_setpoints.last.source == "pursuit",
        5,
    )

    # For ten seconds: after the configured time helm flies home and lands, all by itself.
    flight.link.cut()
    flight.wait("return without the link", lambda: onboard_status.last.state in ("returning", "landing"), 8)
    time.sleep(3)
    flight.link.join()
    flight.wait("landing at home", lambda: not onboard_status.last.armed, 60)
    flight.wait("truth again", lambda: bool(flight.truth.since(time.monotonic_ns() - 500_000_000)), 10)
    truth = flight.truth.last
    assert (truth.ned_p_m[0] ** 2 + truth.ned_p_m[1] ** 2) ** 0.5 < 2.0, "landed away from home"

    # The autopilot hangs: helm says so, and finds the next one.
    flight.stack.kill("autopilot", signal.SIGSTOP)
    flight.wait("helm to miss the autopilot", lambda: onboard_status.last.state == "disconnected", 8)
    flight.wait("helm to find it again", lambda: onboard_status.last.state == "standby", 25)
    flight.check_machine()
