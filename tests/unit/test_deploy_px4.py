"""What is shipped for PX4 agrees with itself, with the vehicle file, and with the page that explains it."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from common import pose_options
from common.processes import load_config
from onboard.helm.config import HelmConfig

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "deploy" / "px4"
PAGE = (ROOT / "docs" / "px4.md").read_text(encoding="utf-8")
INT32, REAL32 = "6", "9"
# Only where there is no pilot's radio.
ONLY_IN_THE_LOOP = {"COM_RCL_EXCEPT": 4.0}


def vehicle_parameters() -> dict[str, tuple[float, str]]:
    """Value and MAV_PARAM_TYPE by name."""
    rows = [
        line.split("\t") for line in (FOLDER / "vehicle.params").read_text().splitlines() if not line.startswith("#")
    ]
    assert all(len(row) == 5 and row[:2] == ["1", "1"] for row in rows)
    return {name: (float(value), kind) for _, _, name, value, kind in rows}


def loop_parameters() -> dict[str, float]:
    lines = (FOLDER / "sitl.env").read_text().split()
    assert all(line.startswith("PX4_PARAM_") for line in lines)
    return {name.removeprefix("PX4_PARAM_"): float(value) for name, value in (line.split("=") for line in lines)}


def test_parameters_are_helm_s_and_the_same_in_the_loop() -> None:
    vehicle, loop = vehicle_parameters(), loop_parameters()

    for name, value in load_config("kite").section(HelmConfig).parameters.items():
        assert vehicle[name] == (value, INT32 if isinstance(value, int) else REAL32)
    for name, value in loop.items():
        assert value == ONLY_IN_THE_LOOP.get(name, vehicle[name][0]), name


def test_every_parameter_is_explained() -> None:
    for name in vehicle_parameters().keys() | loop_parameters().keys():
        assert name in PAGE, f"docs/px4.md does not say why {name}"


def test_the_world_listens_where_px4_sends() -> None:
    link = (FOLDER / "mavlink-local.sh").read_text()

    assert f"-o $(({pose_options.POSE_PORTS['local']}+px4_instance))" in link
    assert link.count(f"-u $(({pose_options.POSE_ASKED['local']}+px4_instance))") == 4
    for message in ("LOCAL_POSITION_NED", "ATTITUDE_QUATERNION"):
        assert f"mavlink stream -r 100 -s {message} " in link


@pytest.mark.parametrize("script", ["start.sh", "mavlink-local.sh"])
def test_scripts_can_be_read_by_the_shell(script: str) -> None:
    read = subprocess.run(["sh", "-n", str(FOLDER / script)], capture_output=True, text=True, check=False)

    assert (read.returncode, read.stderr) == (0, "")


def test_a_simulator_that_is_not_there_is_one_line() -> None:
    ended = subprocess.run([str(FOLDER / "start.sh"), "jmavsim"], capture_output=True, text=True, check=False)

    assert (ended.returncode, ended.stdout) == (2, "")
    assert ended.stderr.strip() == "start.sh: got 'jmavsim', expected sih or gazebo"


@pytest.mark.parametrize("simulator", ["sih", "gazebo"])
def test_images_are_pinned_and_get_the_link(simulator: str) -> None:
    text = (FOLDER / f"Containerfile.{simulator}").read_text()

    [base] = [line for line in text.splitlines() if line.startswith("FROM ")]
    assert base.split(":")[-1].startswith("v1.")
    assert "mavlink-local.sh >> /opt/px4" in text
