"""Helm on a scripted ArduCopter: real MAVSDK, real MAVLink over UDP, real time."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from common.messages import Request
from tests.machine import free_ports
from tests.unit.arducopter import BRAKE, GUIDED, LAND, LOITER, ArduCopter
from tests.unit.helm_rig import HelmRig

_ARM, _TAKEOFF, _MODE = 400, 22, 176


@pytest.fixture
def start() -> Iterator[Callable[..., tuple[ArduCopter, HelmRig]]]:
    """Starts a copter and a helm on it, with settings for helm and arguments for the copter."""
    opened: list[ArduCopter | HelmRig] = []

    def begin(settings: dict[str, Any] | None = None, **copter: int) -> tuple[ArduCopter, HelmRig]:
        (port,) = free_ports(1)
        vehicle = ArduCopter(port, **copter)
        opened.append(vehicle)
        rig = HelmRig(port, takeoff_height_m=3.0, **settings or {})
        opened.append(rig)
        return vehicle, rig

    yield begin
    for it in reversed(opened):
        it.close()


@pytest.mark.slow
def test_a_flight_on_ardupilot(start):
    """Gate, takeoff, hover, a request, a hang, a pilot's switch, helm stopped and started again, landing."""
    copter, rig = start()
    _open_the_gate(copter, rig)
    _take_off(copter, rig)
    _obey_and_stop(copter, rig)
    _hang(copter, rig)
    _yield_to_the_pilot(copter, rig)
    _stop_and_start_again(copter, rig)
    landing = rig.call("land")
    assert rig.go(15.0, lambda: rig.state == "standby"), rig.status
    assert landing.answer and landing.answer.outcome == "done"
    assert (copter.mode, copter.armed, copter.invalid_setpoints) == (LAND, False, 0)
    assert rig.node.metrics()["malformed"] == 0


def _open_the_gate(copter: ArduCopter, rig: HelmRig) -> None:
    assert rig.go(10.0, rig.gate_open), rig.status
    assert rig.status and rig.status.mode == "STABILIZE"
    assert (copter.parameters["GUID_TIMEOUT"][0], copter.parameters["FS_EKF_ACTION"][0]) == (1.0, 1.0)
    details = {item.name: item.detail for item in rig.status.preflight}
    assert "ArduPilot" in details["link"] and "GUID_TIMEOUT = 1" in details["guided setpoint timeout"]
    assert copter.intervals_s[31] == pytest.approx(0.02) and set(copter.intervals_s) >= {0, 1, 32, 49, 147, 242, 245}


def _take_off(copter: ArduCopter, rig: HelmRig) -> None:
    takeoff = rig.call("takeoff")
    assert rig.go(15.0, lambda: takeoff.answer is not None)
    assert takeoff.answer and takeoff.answer.outcome == "done", takeoff.answer
    told = [
        (number, params[1] if number == _MODE else params[0 if number == _ARM else 6])
        for number, params in copter.commands
    ]
    assert told[:4] == [(_MODE, GUIDED), (_ARM, 1.0), (_MODE, GUIDED), (_TAKEOFF, 3.0)]
    rig.go(2.0)
    assert copter.height_m == pytest.approx(3.0, abs=0.2)
    assert rig.vehicle.ned_p_m == pytest.approx((0.0, 0.0, -3.0), abs=0.3)  # from home, not from the local origin


def _obey_and_stop(copter: ArduCopter, rig: HelmRig) -> None:
    rig.request = Request(frame="ned", vector=(1.2, 0.0, 0.0))
    rig.step()
    assert rig.call("chase").answer
    rig.go(3.0)
    assert copter.v[0] == pytest.approx(1.2, abs=0.2)
    rig.request = None
    rig.go(3.0)
    assert math.hypot(*copter.v) < 0.2
    assert copter.height_m == pytest.approx(3.0, abs=0.3)


def _hang(copter: ArduCopter, rig: HelmRig) -> None:
    """The last velocity is flown for GUID_TIMEOUT, then the vehicle stands, still in GUIDED."""
    rig.request = Request(frame="ned", vector=(0.0, 1.0, 0.0))
    rig.go(1.5)
    assert copter.v[1] > 0.6
    time.sleep(0.7)
    assert copter.v[1] > 0.6
    time.sleep(1.3)
    assert abs(copter.v[1]) < 0.2 and copter.mode == GUIDED
    rig.request = None
    heard = copter.setpoints
    rig.go(0.5)
    assert rig.state == "yielded" and "stands in GUIDED" in rig.node.flight.machine.reason
    assert copter.setpoints == heard
    _engage(rig)


def _yield_to_the_pilot(copter: ArduCopter, rig: HelmRig) -> None:
    copter.switch(LOITER)
    assert rig.go(1.0, lambda: rig.state == "yielded"), rig.status
    assert "mode LOITER was set by" in rig.node.flight.machine.reason
    heard = copter.ignored_setpoints
    copter.switch(GUIDED)
    rig.go(1.0)
    assert rig.state == "yielded" and copter.ignored_setpoints == heard  # GUIDED alone does not give helm the stick
    _engage(rig)


def _stop_and_start_again(copter: ArduCopter, rig: HelmRig) -> None:
    rig.restart()
    assert copter.mode == BRAKE
    assert rig.go(6.0, lambda: rig.state == "yielded"), rig.status
    assert "in the air, mode BRAKE" in rig.node.flight.machine.reason
    _engage(rig)


def _engage(rig: HelmRig) -> None:
    engaged = rig.call("engage")
    assert rig.go(5.0, lambda: engaged.answer is not None)
    assert engaged.answer and engaged.answer.outcome == "done", engaged.answer


@pytest.mark.parametrize(
    ("copter", "text"),
    [
        ({"autopilot": 4}, "MAV_AUTOPILOT 4, expected one of PX4 (12), ArduPilot (3)"),
        ({"vehicle_type": 1}, "MAV_TYPE 1, expected a multicopter"),
    ],
)
def test_what_helm_cannot_fly_is_refused_in_one_line_and_gets_no_command(start, copter, text: str):
    vehicle, rig = start(**copter)
    assert rig.go(5.0, lambda: rig.status is not None and text in rig.status.reason), rig.status
    assert rig.state == "disconnected" and "\n" not in rig.status.reason
    takeoff = rig.call("takeoff")
    assert takeoff.answer and takeoff.answer.outcome == "refused" and text in takeoff.answer.reason
    assert not vehicle.commands and not vehicle.setpoints


def test_a_parameter_that_cannot_be_read_is_named_with_its_cure(start, caplog: pytest.LogCaptureFixture):
    _, rig = start(settings={"ardupilot_parameters": {"GUID_TIMEOUT": 1, "FS_EKF_ACTION": 1}})
    found = "GUID_TIMEOUT: it is of the other type; configure 1 for an integer parameter, 1.0 for a float"
    assert rig.go(6.0, lambda: found in caplog.text), caplog.text
    assert not rig.gate_open()
