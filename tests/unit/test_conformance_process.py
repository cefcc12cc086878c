"""The command: what it refuses, and with which exit code."""

from __future__ import annotations

import json
import socket
from pathlib import Path

import pytest

from common.cli import main
from common.helm_lock import HelmLock
from simulation.conformance import process
from simulation.conformance.client import COMPANION, Client
from tests.machine import free_ports
from tests.unit.conformance_rig import ConformanceRig


@pytest.fixture(autouse=True)
def own_locks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr(process, "_HEARD_WITHIN_S", 0.2)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "got no URL, expected"),
        (["udp:127.0.0.1"], "expected udpin://HOST:PORT"),
        (["udpin://127.0.0.1:70000"], "expected udpin://HOST:PORT"),
        (["udpin://127.0.0.1:1", "--only", "velocty"], "did you mean 'velocity'"),
        (["serial:///dev/absent:57600"], "cannot be opened"),
        (["serial:///dev/null:57601"], "expected a standard rate"),
        (["serial:///dev/null:57600"], "not a serial device"),
        (["udpin://127.0.0.1:24000", "--json", "no/such/folder/x.json"], "expected a file in a folder that exists"),
    ],
)
def test_what_cannot_be_used_is_one_line(arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["conformance", *arguments]) == 2
    error = capsys.readouterr().err.strip()
    assert said in error and "\n" not in error


def test_an_absent_autopilot_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    (port,) = free_ports(1)
    assert main(["conformance", f"udpin://127.0.0.1:{port}"]) == 2
    assert "no autopilot was heard" in capsys.readouterr().err


def test_a_port_in_use_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        assert main(["conformance", f"udpin://127.0.0.1:{other.getsockname()[1]}"]) == 2
    assert "Address already in use" in capsys.readouterr().err


def test_a_link_that_helm_holds_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    lock = HelmLock("udpin://127.0.0.1:24001", "kite")
    try:
        assert main(["conformance", "udpin://127.0.0.1:24001"]) == 3
    finally:
        lock.close()
    assert "helm of vehicle 'kite'" in capsys.readouterr().err


def test_it_does_not_fly_beside_another_companion() -> None:
    rig = ConformanceRig()
    try:
        other = Client(rig.wire)
        other.run(0.1)
        beat = next(s.message for s in rig.client.seen if s.message.get_type() == "HEARTBEAT")
        beat.type = COMPANION
        rig.client.others[(1, 191)] = rig.client.latest["HEARTBEAT"]
        process._refuse_company(rig.client, may_fly=False)
        with pytest.raises(process.ConfigError, match="one hand commands a vehicle"):
            process._refuse_company(rig.client, may_fly=True)
    finally:
        rig.close()


def test_the_list_names_every_check(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["conformance", "--list"]) == 0
    assert {"connect", "velocity", "loss-5", "reboot"} <= {
        line.split()[0] for line in capsys.readouterr().out.splitlines()
    }


def test_the_report_is_json(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = ConformanceRig()
    monkeypatch.setattr(process, "open_wire", lambda url: rig.wire)
    monkeypatch.setattr(process, "_HEARD_WITHIN_S", 8.0)
    path = tmp_path / "report.json"
    assert (
        main(["conformance", "udpin://10.1.1.1:14540", "--only", "home", "--only", "arming", "--json", str(path)]) == 0
    )
    report = json.loads(path.read_text())
    assert [(c["name"], c["outcome"]) for c in report["checks"]] == [("home", "pass"), ("arming", "not flown")]
    assert report["checks"][0]["lines"][0]["ok"] is True
    assert "motors stay off without --fly" in capsys.readouterr().out
