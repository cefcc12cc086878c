"""The command line: help where a user asks for it, one clear line for what it cannot read."""

from __future__ import annotations

import pytest

from common import cli
from common.cli import main
from common.processes import load_config
from simulation.world.config import WorldConfig

COMMANDS = (
    "sim",
    "onboard",
    "ground",
    "node",
    "do",
    "topics",
    "preflight",
    "doctor",
    "demo",
    "conformance",
    "console-password",
    "bench",
)


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("flag", ["-h", "--help"])
def test_every_command_has_help(command: str, flag: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main([command, flag])

    assert ended.value.code == 0
    assert f"usage: outrider {command}" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["demo", "--hedless"], "unrecognized arguments: --hedless"),
        (["bench", "latency", "--quik"], "unrecognized arguments: --quik"),
        (["preflight", "--wait", "-1"], "expected seconds, 0 or more"),
        (["preflight", "--wait", "long"], "got 'long', expected seconds"),
        (["track", "film.avi", "--init", "1,1,9,9", "--seed", "-1"], "got '-1', expected a whole number, 0 or more"),
        (["demo", "--seed", "two"], "got 'two', expected a whole number, 0 or more"),
        (["fly"], "invalid choice: 'fly'"),
    ],
)
def test_an_unknown_argument_is_named(arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)

    assert ended.value.code == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["bench", "laten"], "did you mean 'latency'"),
        (["node", "persuit"], "did you mean 'pursuit'"),
        (["do", "fly"], "expected one of: "),
        (["do", "select", "1,2,3"], "expected X,Y,W,H in px"),
        (["do", "push-back", "of"], "expected on or off"),
        (["do", "push-back"], "expected on or off"),
        (["ground", "--set", "pursuit.hight=3"], "pursuit"),
        (["sim", "--config", "kyte"], "kyte"),
        (["sim", "--pose", "local"], "expected it beside --autopilot external"),
        (["demo", "--pose-port", "19420"], "expected it beside --autopilot external"),
        (["demo", "--autopilot", "udp:14540"], "expected udpin://HOST:PORT"),
        (["sim", "--autopilot", "external", "--pose-port", "70000"], "65535"),
    ],
)
def test_what_cannot_be_read_is_one_line(arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(arguments) == 2
    error = capsys.readouterr().err.strip()
    assert said in error and "\n" not in error


@pytest.mark.parametrize(
    ("extra", "expected"),
    [
        ([], ["truth", 19410, (47.397742, 8.545594, 488.0)]),
        (["--autopilot", "external"], ["truth", 19410, "first"]),
        (["--autopilot", "external", "--pose", "local"], ["local", 19420, "first"]),
        (["--autopilot", "external", "--pose", "local", "--pose-port", "14551"], ["local", 14551, "first"]),
        (["--autopilot", "external", "--set", "world.home=[1.0, 2.0, 3.0]"], ["truth", 19410, (1.0, 2.0, 3.0)]),
    ],
)
def test_sim_runs_the_world_alone_beside_an_external_autopilot(
    extra: list[str], expected: list[object], monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[tuple[str, list[str], list[str]]] = []

    def run_side(side: str, arguments: list[str], without: list[str]) -> int:
        started.append((side, arguments, without))
        return 0

    monkeypatch.setattr(cli, "run_side", run_side)

    assert cli.main(["sim", *extra]) == 0

    [(side, arguments, without)] = started
    assert (side, without) == ("sim", ["autopilot"] if extra else [])
    overrides = [arguments[i + 1] for i, word in enumerate(arguments) if word == "--set"]
    world = load_config("kite", overrides).section(WorldConfig)
    assert [world.source, world.port, world.home] == expected
