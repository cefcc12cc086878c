"""Fixtures of the system tests."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from common.config import find_file
from tests.system.flight import Flight
from tests.system.radio import Link
from tests.system.stack import External, Stack


@pytest.fixture
def make_stack(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Callable[..., Stack]]:
    """Makes stacks; all are ended after the test."""
    stacks: list[Stack] = []
    url = request.config.getoption("--autopilot")
    external = External(str(url), str(request.config.getoption("--pose"))) if url else None

    def make(*overrides: str, environment: dict[str, str] | None = None) -> Stack:
        folder = tmp_path / f"stack{len(stacks)}"
        folder.mkdir()
        stacks.append(Stack(folder, overrides, environment, external))
        return stacks[-1]

    yield make
    for stack in stacks:
        stack.end()


@pytest.fixture
def make_flight(make_stack: Callable[..., Stack], tmp_path: Path) -> Callable[..., Flight]:
    """Starts all three sides (calm scenario, no console) and returns the operator's hand."""

    def make(
        *overrides: str,
        environment: dict[str, str] | None = None,
        console: bool = False,
        link: bool = False,
        parked: bool = False,
    ) -> Flight:
        stack = make_stack(
            f"world.scenario={_parked(tmp_path) if parked else 'calm'}", *overrides, environment=environment
        )
        radio = Link(stack.onboard_port) if link else None
        if radio is not None:
            stack.settings.append(f"bus.link=tcp/127.0.0.1:{radio.port}")
        stack.start("onboard")
        stack.start("sim")
        stack.start("ground", *([] if console else ["--without", "console"]))
        flight = Flight(stack)
        flight.link = radio
        return flight

    return make


def _parked(folder: Path) -> Path:
    """The calm scenario with a car that stays where it is: for tests that leave it unwatched for long."""
    text, changed = re.subn(
        r"start_delay_s = [\d.]+", "start_delay_s = 100000.0", find_file("calm", "scenarios").read_text()
    )
    assert changed == 1
    path = folder / "parked.toml"
    path.write_text(text)
    return path
