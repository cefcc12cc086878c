"""The doctor on the autopilot's link: what it hears and reads there, and that it changes nothing."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from common.config import build
from common.doctor.finding import Finding
from common.helm_lock import HelmLock
from common.processes import load_config
from onboard.doctor.autopilot import autopilot, of_gate
from onboard.helm.actions import Action
from onboard.helm.autopilot_link import AutopilotLink
from onboard.helm.dialect.base import Kind
from simulation.autopilot.config import AutopilotSimConfig
from simulation.autopilot.process import AutopilotProcess
from tests.machine import free_ports
from tests.unit.autopilot_rig import settings
from tests.unit.test_preflight_tool import BAD, GOOD, status


@contextmanager
def flying(ports: list[int], **parameters: float) -> Iterator[AutopilotProcess]:
    """A simulated autopilot in a thread, in real time."""
    process = AutopilotProcess(build(AutopilotSimConfig, settings(ports, parameters=parameters), "test"))
    stop = threading.Event()

    def run() -> None:
        while not stop.wait(0.003):
            process.cycle()

    thread = threading.Thread(target=run)
    thread.start()
    yield process
    stop.set()
    thread.join()
    process.close()


@pytest.fixture(autouse=True)
def short_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    """No router is there in these tests."""
    monkeypatch.setattr("common.doctor.routers._OPEN_S", 0.1)


def look(port: int) -> dict[str, Finding]:
    absent = f"tcp/127.0.0.1:{free_ports(1)[0]}"
    url = f"udpin://127.0.0.1:{port}"
    config = load_config("kite", [f"bus.onboard_router={absent}", f"helm.autopilot_url={url}"])
    return {f.subject: f for f in autopilot(config, ("onboard",))}


def test_a_wrong_parameter_is_found_and_nothing_is_changed() -> None:
    ports = free_ports(6)
    with flying(ports, RTL_RETURN_ALT=60.0, COM_OBL_RC_ACT=5, COM_OF_LOSS_T=1.0) as process:
        found = look(ports[1])
        kept = process.vehicle.parameters["RTL_RETURN_ALT"]

    assert found["autopilot"].severity == "ok", found
    assert found["parameter COM_OF_LOSS_T"].severity == "ok", found
    wrong = found["parameter RTL_RETURN_ALT"]
    assert (wrong.severity, wrong.found) == ("warning", "got 60, expected 8")
    assert kept == 60.0


def test_silence_is_said_with_its_cure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("onboard.doctor.autopilot._FIND_S", 0.5)
    found = look(free_ports(1)[0])["autopilot"]

    assert found.severity == "warning" and "outrider sim" in found.cure


def test_a_port_or_lock_that_another_holds_is_left_alone() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind(("127.0.0.1", 0))
        port = holder.getsockname()[1]
        assert "is held" in look(port)["autopilot"].found
    lock = HelmLock(f"udpin://127.0.0.1:{port}", "kite")
    assert "is held by helm of vehicle 'kite'" in look(port)["autopilot"].found
    lock.close()


def test_a_link_that_listens_refuses_to_command_and_to_write() -> None:
    link = AutopilotLink(f"udpin://127.0.0.1:{free_ports(1)[0]}", listen_only=True)
    for action in (Action(Kind.ARM), Action(Kind.PARAMETERS, {"RTL_RETURN_ALT": 8.0}, write=True)):
        with pytest.raises(ValueError, match="only listens"):
            link.submit(action)
    link.close(hold=False)


def test_the_gate_of_a_running_helm_becomes_findings() -> None:
    helm, battery, home = of_gate(status(GOOD, BAD))

    assert (helm.severity, battery.severity) == ("ok", "ok")
    assert (home.severity, home.subject, home.found) == ("fault", "gate: home", "not set")
    assert home.cure == "wait for the position estimate; then look again"
