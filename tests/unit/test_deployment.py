"""What is deployed: systemd units, container files; every command line in them is one that the parser knows."""

from __future__ import annotations

import configparser
import json
import os
import re
import shlex
import socket
import subprocess
from pathlib import Path

import pytest

from common import heartbeat
from common.cli_parser import make_parser
from common.processes import PROCESSES, side_processes

ROOT = Path(__file__).parents[2]
UNITS = sorted((ROOT / "deploy/systemd").glob("*.service"))
DOCKERFILE = ROOT / "deploy/containers/Dockerfile"
COMPOSE = sorted(DOCKERFILE.parent.glob("compose.*.yaml"))


def unit(path: Path) -> configparser.ConfigParser:
    """A unit, its last value of each key."""
    parser = configparser.ConfigParser(strict=False, interpolation=None, delimiters=("=",))
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read_string(path.read_text())
    return parser


def check_command(arguments: list[str]) -> None:
    """Parse a command line as `outrider` does; a wrong one ends with SystemExit. Names of processes must exist."""
    parsed = make_parser().parse_args(arguments)
    if parsed.action == "node":
        assert parsed.name in PROCESSES
    if parsed.action in ("onboard", "ground", "sim"):
        assert set(parsed.without) <= {p.name for p in side_processes(parsed.action)}


def test_the_files_are_found() -> None:
    assert [p.stem for p in UNITS] == ["outrider-ground", "outrider-helm", "outrider-onboard", "outrider-sim"]
    assert [p.name.split(".")[1] for p in COMPOSE] == ["desk", "ground", "onboard"]


@pytest.mark.parametrize("path", UNITS, ids=lambda p: p.stem)
def test_unit_starts_a_command_that_exists_and_is_locked_down(path: Path) -> None:
    service = unit(path)["Service"]
    program, *arguments = shlex.split(service["ExecStart"])

    assert program == "/opt/outrider/.venv/bin/outrider"
    check_command(arguments)
    assert service["User"] == "outrider"
    assert service["NoNewPrivileges"] == "yes"
    assert service["ProtectSystem"] == "strict"
    assert service["Restart"] == "always"
    assert service["RestartPreventExitStatus"].split() == ["2", "3"]
    assert service["KillMode"] == "mixed", "the supervisor ends its processes in order"


def test_systemd_itself_finds_no_fault(tmp_path: Path) -> None:
    for path in UNITS:
        text = path.read_text().replace("/opt/outrider/.venv/bin/outrider", "/bin/true")
        (tmp_path / path.name).write_text(text)
    units = [str(tmp_path / path.name) for path in UNITS]
    verdict = subprocess.run(["systemd-analyze", "verify", *units], capture_output=True, text=True, timeout=60)
    about_us = [line for line in verdict.stderr.splitlines() if "outrider" in line]

    assert verdict.returncode == 0, verdict.stderr
    assert not about_us


def test_helm_outlives_the_rest_of_its_side() -> None:
    """No unit's stop or restart may take helm with it, and the vehicle's side must not start a second one."""
    helm = unit(ROOT / "deploy/systemd/outrider-helm.service")
    onboard = unit(ROOT / "deploy/systemd/outrider-onboard.service")

    assert "--without helm" in onboard["Service"]["ExecStart"]
    assert not {"Requires", "BindsTo", "PartOf", "Requisite"} & set(helm["Unit"])
    assert float(helm["Service"]["TimeoutStopSec"]) > 1.5 + 4.0, "HOLD, then the link's end"
    compose = (DOCKERFILE.parent / "compose.onboard.yaml").read_text()
    assert "[onboard, --without, helm," in compose


def test_watchdog_is_fed_by_the_process_that_systemd_watches(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(str(tmp_path / "notify"))
        systemd.settimeout(2)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        monkeypatch.setenv("WATCHDOG_PID", str(os.getpid() + 1))
        heartbeat.beat()
        monkeypatch.setenv("WATCHDOG_PID", str(os.getpid()))
        heartbeat.beat()

        assert systemd.recv(100) == b"WATCHDOG=1"
        systemd.setblocking(False)
        with pytest.raises(BlockingIOError):
            systemd.recv(100)
    heartbeat.beat()  # systemd has gone: no concern of the process


def test_dockerfile_copies_what_exists_and_runs_commands_that_exist() -> None:
    text = DOCKERFILE.read_text()
    copied = [name for line in re.findall(r"^COPY (?!--from)(.+)$", text, re.M) for name in line.split()[:-1]]

    assert {"common", "onboard", "ground", "simulation", "pyproject.toml", "constraints.txt"} <= set(copied)
    assert all((ROOT / name).exists() for name in copied)
    commands = [json.loads(words) for words in re.findall(r"^CMD (\[.+\])$", text, re.M)]
    commands += [json.loads(words)[1:] for words in re.findall(r"HEALTHCHECK .*CMD (\[.+\])$", text, re.M)]
    assert len(commands) == 5
    for words in commands:
        check_command(words)


def test_dockerfile_installs_declared_extras_under_the_constraints_as_no_root() -> None:
    text = DOCKERFILE.read_text()
    declared = set(re.findall(r"^(\w+) = \[", (ROOT / "pyproject.toml").read_text(), re.M))
    installs = re.findall(r"^RUN pip install (.+)$", text, re.M)

    assert len(installs) == 3
    for words in installs:
        assert "-c constraints.txt" in words
        assert set(re.findall(r"\.\[(\w+)\]", words)) <= declared
    for stage in re.split(r"^FROM ", text, flags=re.M)[1:]:
        users = re.findall(r"^USER (\w+)", stage, re.M)
        assert not users or users[-1] == "outrider"


@pytest.mark.parametrize("path", COMPOSE, ids=lambda p: p.stem)
def test_compose_builds_stages_and_runs_commands_that_exist(path: Path) -> None:
    text = path.read_text()
    stages = set(re.findall(r"^FROM \S+ AS (\S+)$", DOCKERFILE.read_text(), re.M))
    commands = [words.split(", ") for words in re.findall(r"^\s+command: \[(.+)\]$", text, re.M)]

    assert set(re.findall(r"target: (\w+)", text)) <= stages
    assert len(commands) == (2 if "onboard" in path.name else 1)
    for words in commands:
        check_command(words)
    assert "privileged: true" not in text
