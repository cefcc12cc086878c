"""The doctor's checks, each with the trouble that it is there for, caused for real on this machine."""

from __future__ import annotations

import io
import json
import os
import socket
import threading
import time
from collections.abc import Iterable, Iterator
from importlib import metadata
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest

from common.cli import main
from common.config import Config
from common.doctor import finding, host
from common.doctor.finding import Finding
from common.doctor.packages import compare
from common.doctor.ports import PortUse, examine_ports
from common.doctor.routers import routers
from common.doctor.run import CHECKS, Check, doctor, examine
from common.geometry.config import CameraConfig
from common.processes import load_config
from common.session import BusConfig, open_router
from ground.doctor.station import disk
from onboard.doctor.camera import camera, fits, plausible
from onboard.doctor.ports import device, locks
from onboard.doctor.ports import ports as vehicle_ports
from simulation.doctor.graphics import graphics
from tests.machine import free_ports

HERE = "tests.unit.test_doctor"


def only(findings: Iterable[Finding]) -> Finding:
    (found,) = findings
    return found


def quiet_config(*settings: str) -> Config:
    """The shipped vehicle with routers where nobody listens."""
    onboard, ground = (f"tcp/127.0.0.1:{port}" for port in free_ports(2))
    return load_config(
        "kite",
        [f"bus.onboard_router={onboard}", f"bus.ground_router={ground}", f"bus.link={onboard}", *settings],
    )


# ---------------------------------------------------------------- the framework


def healthy(config: Config, sides: tuple[str, ...]) -> Iterator[Finding]:
    yield finding.ok("heart", "beats")


def crashes(config: Config, sides: tuple[str, ...]) -> Iterator[Finding]:
    yield finding.ok("first", "well")
    raise RuntimeError("the stethoscope broke")


def hangs(config: Config, sides: tuple[str, ...]) -> Iterator[Finding]:
    threading.Event().wait(30)
    yield finding.ok("late", "never")


def test_a_check_that_crashes_hangs_or_cannot_be_loaded_is_a_finding_and_the_others_go_on() -> None:
    checks = (
        Check("slow", f"{HERE}:hangs", limit_s=0.5),
        Check("broken", f"{HERE}:crashes"),
        Check("absent", "no_such_library.doctor:check", ("onboard",)),
        Check("heart", f"{HERE}:healthy"),
    )
    began_s = time.monotonic()

    slow, first, broken, absent, heart = examine(Config({}, {}), ("onboard",), checks)

    assert time.monotonic() - began_s < 5.0
    assert (slow.severity, slow.found) == ("fault", "the check did not end in 0.5 s")
    assert first == finding.ok("first", "well")
    assert broken.severity == "fault" and "RuntimeError: the stethoscope broke" in broken.found
    assert absent.severity == "fault" and absent.cure == "pip install 'outrider[onboard]'"
    assert heart == finding.ok("heart", "beats")


def test_only_the_checks_of_the_side_run() -> None:
    checks = (Check("heart", f"{HERE}:healthy", ("ground",)), Check("broken", f"{HERE}:crashes", ("sim",)))

    assert [f.subject for f in examine(Config({}, {}), ("ground",), checks)] == ["heart"]


def test_faults_are_the_exit_code_and_each_has_its_cure_below(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("common.doctor.run.examine", lambda *_: [finding.fault("heart", "still", "call for help")])
    table, plain = io.StringIO(), io.StringIO()

    assert doctor(Config({}, {}), ("sim",), False, table) == 1
    assert doctor(Config({}, {}), ("sim",), True, plain) == 1

    assert table.getvalue().splitlines()[1:] == [
        "✗  heart      still",
        "              → call for help",
        "faults: 1, warnings: 0, ok: 0",
    ]
    shown = json.loads(plain.getvalue())
    assert shown["fault"] == 1 and shown["findings"][0]["cure"] == "call for help"


def test_every_check_of_the_table_exists() -> None:
    from common.config import load_object

    assert all(callable(load_object(check.entry)) for check in CHECKS)
    assert max(check.limit_s for check in CHECKS) < 10.0


def test_a_wrong_vehicle_file_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "--config", "kyte"]) == 2
    assert "kyte" in capsys.readouterr().err


# ---------------------------------------------------------------- machine, packages, clock, graphics


def test_a_loaded_or_small_machine_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    config = Config({}, {})
    monkeypatch.setattr(os, "getloadavg", lambda: (0.1, 0.1, 0.1))
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})
    assert next(host.machine(config, ("sim",))).severity == "ok"
    monkeypatch.setattr(os, "getloadavg", lambda: (7.0, 7.0, 7.0))
    assert next(host.machine(config, ("sim",))).severity == "warning"
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0})
    assert next(host.machine(config, ("onboard", "ground", "sim"))).severity == "fault"
    monkeypatch.setattr(host, "_MEMORY_GB", {"sim": 1e6})
    assert [f.severity for f in host.machine(config, ("sim",)) if f.subject == "memory"] == ["warning"]


def test_a_clock_that_steps_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    began_ns = time.monotonic_ns()
    monkeypatch.setattr(time, "time_ns", lambda: began_ns + 2 * (time.monotonic_ns() - began_ns))

    steps = [f for f in host.clock(Config({}, {}), ()) if f.subject == "clock steps"]

    assert only(steps).severity == "warning" and "within 0.5 s" in only(steps).found


def test_a_renderer_that_hangs_is_a_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("simulation.doctor.graphics._LIMIT_S", 0.05)

    assert only(graphics(quiet_config(), ("sim",))).found == "no picture in 0.05 s"


def test_missing_and_old_packages_are_faults() -> None:
    installed = {"numpy": "2.4.1", "mavsdk": "5.0.0", "mcap": "1.6rc1"}

    def version_of(name: str) -> str:
        if name not in installed:
            raise metadata.PackageNotFoundError(name)
        return installed[name]

    required = (
        "numpy>=2.2",
        "mavsdk<5,>=4.1; extra == 'onboard'",
        "viser<2,>=1.1; extra == 'ground'",
        "mcap>=1.6; extra == 'ground'",
        "outrider[onboard]; extra == 'all'",
        "pytest>=9; extra == 'dev'",
    )
    mavsdk, viser, good = compare(required, ("onboard", "ground"), version_of)

    assert (mavsdk.severity, mavsdk.found) == ("fault", "got 5.0.0, expected <5,>=4.1")
    assert (viser.severity, viser.cure) == ("fault", "pip install 'outrider[ground]'")
    assert good.found.startswith("2 in accepted versions")


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """The start of a renderer takes seconds where other tests share the cores."""
    monkeypatch.setattr("simulation.doctor.graphics._LIMIT_S", 60.0)


@pytest.mark.usefixtures("patient")
def test_a_picture_is_rendered_and_timed() -> None:
    found = only(graphics(quiet_config(), ("sim",)))

    assert found.severity in ("ok", "warning"), found
    assert "640x480 in" in found.found


@pytest.mark.usefixtures("patient")
@pytest.mark.parametrize(
    ("variable", "value"), [("MUJOCO_GL", "nonsense"), ("__EGL_VENDOR_LIBRARY_FILENAMES", "/nowhere")]
)
def test_a_broken_driver_is_a_fault_with_its_cure(variable: str, value: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(variable, value)

    found = only(graphics(quiet_config(), ("sim",)))

    assert found.severity == "fault", found
    assert found.found.startswith("renders nothing: ") and "libegl1" in found.cure


# ---------------------------------------------------------------- ports, devices, locks, disk


@pytest.mark.parametrize(("protocol", "kind"), [("udp", socket.SOCK_DGRAM), ("tcp", socket.SOCK_STREAM)])
def test_a_busy_port_names_the_process_that_holds_it(protocol, kind) -> None:
    with socket.socket(socket.AF_INET, kind) as holder:
        holder.bind(("127.0.0.1", 0))
        if protocol == "tcp":
            holder.listen()
        port = holder.getsockname()[1]
        use = PortUse(protocol, port, "helm", "helm.autopilot_url")
        found = only(examine_ports([use]))
    assert found.severity == "fault"
    assert f"held by process {os.getpid()} (" in found.found and "helm.autopilot_url" in found.cure
    assert only(examine_ports([use])) == finding.ok(f"{protocol.upper()} port {port}", "free for helm")


def test_a_device_that_is_absent_or_forbidden(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "ttyACM0"
    config = load_config("kite", [f"helm.autopilot_url=serial://{path}:57600"])
    assert [f.found for f in vehicle_ports(config, ()) if f.subject.startswith("device")] == ["is not there"]
    path.touch()
    assert device(path).severity == "ok"
    monkeypatch.setattr(os, "access", lambda *_: False)  # root may do anything
    assert device(path).severity == "fault" and "dialout" in device(path).cure


def test_a_held_lock_names_its_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from common.helm_lock import HelmLock

    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert "no helm holds one" in only(locks(Config({}, {}), ())).found
    lock = HelmLock("udpin://127.0.0.1:14540", "kite")
    assert only(locks(Config({}, {}), ())).found.endswith(f"is held by process {os.getpid()}")
    lock.close()
    monkeypatch.setenv("XDG_RUNTIME_DIR", "/proc/self")
    assert only(locks(Config({}, {}), ())).severity == "fault"


def test_a_folder_that_cannot_be_written_is_a_fault_and_a_full_disk_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read_only = only(disk(load_config("kite", ["recorder.folder=/proc/self/recordings"]), ()))
    assert read_only.severity == "fault" and "cannot be written" in read_only.found

    config = load_config("kite", [f"recorder.folder={tmp_path / 'new'}"])
    for free, severity in ((100e9, "ok"), (5e9, "warning"), (0.2e9, "fault")):
        monkeypatch.setattr("shutil.disk_usage", lambda _, f=free: type("Usage", (), {"free": f}))
        assert only(disk(config, ())).severity == severity
    assert not (tmp_path / "new").exists()


# ---------------------------------------------------------------- routers and camera


def test_absent_routers_are_a_warning_and_a_stranger_on_the_port_is_a_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("common.doctor.routers._OPEN_S", 0.1)
    config = quiet_config()
    assert [f.severity for f in routers(config, ("onboard", "ground"))] == ["warning", "warning"]
    port = int(config.section(BusConfig).onboard_router.rsplit(":", 1)[1])
    with socket.create_server(("127.0.0.1", port)):
        found = only(routers(config, ("onboard",)))
    assert (found.severity, "is no router of ours" in found.found) == ("fault", True)


def test_a_link_that_is_down_is_a_fault() -> None:
    config = quiet_config()
    router = open_router(config.section(BusConfig), "ground")
    try:
        found = {f.subject: f for f in routers(config, ("ground",))}
    finally:
        router.close()
    assert found["router-ground"].severity == "ok"
    assert found["link to the vehicle"].severity == "fault"
    assert "pursuit, console, recorder" in found["nodes"].found


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"fx_px": 60.0, "fy_px": 60.0}, "a view of 159°"),
        ({"fx_px": 880.0}, "fx_px / fy_px = 2.00"),
        ({"cx_px": 10.0}, "a principal point 48% off the middle"),
        ({"distortion": (0.0, 9.0, 0.0, 0.0, 0.0)}, "a distortion of 9.0"),
    ],
)
def test_a_calibration_that_no_camera_has_is_doubted(changes: dict, said: str) -> None:
    assert plausible(CameraConfig()).severity == "ok"
    doubted = plausible(msgspec.structs.replace(CameraConfig(), **changes))
    assert doubted.severity == "warning" and said in doubted.found


def test_pictures_of_another_size_than_the_calibration_s(tmp_path: Path) -> None:
    assert list(fits((640, 480), CameraConfig())) == []
    assert only(fits((320, 240), CameraConfig())).severity == "warning"
    cv2.imwrite(str(tmp_path / "1.png"), np.zeros((400, 700, 3), np.uint8))

    found = {f.subject: f for f in camera(quiet_config(f"video.source={tmp_path}"), ("onboard",))}

    assert found["video source"].severity == "ok"
    assert found["picture size"].severity == "fault" and "700x400" in found["picture size"].found


def test_a_source_that_does_not_open_is_a_fault() -> None:
    found = {f.subject: f for f in camera(quiet_config("video.source=/nowhere.avi"), ("onboard",))}

    assert found["video source"].severity == "fault"
    assert "does not exist" in found["video source"].found and found["video source"].cure
