"""An autopilot that Outrider did not start: the world beside it, and the links that reach it."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable

import cv2
import numpy as np
import pytest

from tests.machine import free_ports
from tests.system.bridge import Bridge
from tests.system.flight import Flight, Seen
from tests.system.stack import Stack

MakeStack = Callable[..., Stack]
pytestmark = [pytest.mark.slow, pytest.mark.own_autopilot]
WITHOUT = ("--without", "console", "--without", "recorder", "--without", "pursuit")


def _start_autopilot(stack: Stack) -> None:
    """The autopilot alone, as another program would be."""
    stack.start("node", "autopilot")


def _picture(pictures: Seen) -> np.ndarray:
    """Newest picture, smoothed so that the sensor's noise does not count."""
    image = cv2.imdecode(np.frombuffer(pictures.last.data, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    return cv2.GaussianBlur(image, (0, 0), 3.0).astype(float)


def _flies_and_is_seen(flight: Flight) -> None:
    """Takes off through the gate; truth and pictures follow the vehicle up."""
    pictures, state = Seen(flight.bus, "camera/down/jpeg"), Seen(flight.bus, "helm/state")
    flight.ready()
    flight.wait("a picture on the ground", lambda: pictures.last is not None and flight.truth.last is not None, 10)
    assert abs(flight.height_m) < 0.5
    low = _picture(pictures)
    flight.take_off()  # done at the true height, which the world knows from the autopilot alone
    assert flight.height_m == pytest.approx(-state.last.ned_p_m[2], abs=0.6)
    seen = len(pictures.all)
    flight.wait("pictures from above", lambda: len(pictures.all) > seen + 5, 5)
    assert np.abs(_picture(pictures) - low).mean() > 4.0, "the picture did not change with the height"


def test_flies_over_a_serial_line_with_the_world_on_the_truth_port(make_stack: MakeStack) -> None:
    stack = make_stack("world.scenario=calm")
    bridge, device = Bridge.serial(stack.helm_port, stack.autopilot_onboard)
    try:
        _start_autopilot(stack)
        stack.start("sim", "--autopilot", "external")
        stack.start("onboard", "--autopilot", f"serial://{device}:921600")
        stack.start("ground", *WITHOUT)
        _flies_and_is_seen(Flight(stack))
        assert stack.pid("autopilot") is None, "the sim side started an autopilot of its own"
    finally:
        bridge.close()


def test_flies_over_tcp_with_the_world_on_the_autopilot_s_estimate(make_stack: MakeStack) -> None:
    stack = make_stack("world.scenario=calm")
    # the command line's own port is tested: the world listens where the autopilot's second link sends
    stack.settings = [s for s in stack.settings if not s.startswith(("world.port", "world.autopilot_port"))]
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(20)
        _start_autopilot(stack)
        stack.start("sim", "--autopilot", "external", "--pose", "local", "--pose-port", str(stack.gcs_port))
        stack.start("onboard", "--autopilot", f"tcpout://127.0.0.1:{listener.getsockname()[1]}")
        stack.start("ground", *WITHOUT)
        bridge = Bridge.tcp_from(listener, stack.helm_port, stack.autopilot_onboard)
        try:
            _flies_and_is_seen(Flight(stack))
            assert stack.pid("autopilot") is None, "the sim side started an autopilot of its own"
        finally:
            bridge.close()


@pytest.mark.parametrize("scheme", ["tcpin", "udpout"])
def test_the_gate_opens_over_the_other_links(scheme: str, make_stack: MakeStack) -> None:
    stack = make_stack("helm.camera_required=false")
    _start_autopilot(stack)
    port = stack.autopilot_onboard if scheme == "udpout" else free_ports(1)[0]
    stack.start("onboard", "--without", "camera", "--autopilot", f"{scheme}://127.0.0.1:{port}")
    status = Seen(stack.bus("onboard"), "helm/status")
    bridge = _connected(port, stack) if scheme == "tcpin" else None
    try:
        deadline = time.monotonic() + 25
        while not (status.last and status.last.preflight and all(item.ok for item in status.last.preflight)):
            assert time.monotonic() < deadline, f"{status.last}; {stack.logs()}"
            time.sleep(0.05)
        assert status.last.state == "standby"
    finally:
        if bridge is not None:
            bridge.close()


def _connected(port: int, stack: Stack) -> Bridge:
    """A bridge to helm's listening socket, once it is there."""
    deadline = time.monotonic() + 15
    while True:
        try:
            return Bridge.tcp_to(port, stack.helm_port, stack.autopilot_onboard)
        except ConnectionRefusedError:
            assert time.monotonic() < deadline, stack.logs()
            time.sleep(0.1)
