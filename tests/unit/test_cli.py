"""The command line: help where a user asks for it, one clear line for what it cannot read."""

from __future__ import annotations

import pytest

from common.cli import main

COMMANDS = ("sim", "onboard", "ground", "node", "do", "topics", "preflight", "doctor", "demo", "bench")


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
        (["ground", "--set", "pursuit.hight=3"], "pursuit"),
        (["sim", "--config", "kyte"], "kyte"),
    ],
)
def test_what_cannot_be_read_is_one_line(arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(arguments) == 2
    error = capsys.readouterr().err.strip()
    assert said in error and "\n" not in error
