"""Marks of the test folders, and how property tests run."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

_FOLDER_MARKS = ("system", "browser")
_REAL_TIME = ("test_autopilot_flight.py", "test_helm_autopilot_link.py", "test_helm_on_ardupilot.py")
"""Flights in real time: on several processes they are flown in one of them, one after the other."""


def pytest_configure() -> None:
    """Property tests: no deadline (other processes share the cores), and in CI the same examples in every run."""
    settings.register_profile("outrider", deadline=None, derandomize=bool(os.environ.get("CI")), print_blob=True)
    settings.load_profile("outrider")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Point the system tests at an autopilot that runs already (PX4 in the loop): standing, disarmed, at home."""
    parser.addoption("--autopilot", metavar="URL", help="fly the system tests on this autopilot (default: our own)")
    parser.addoption("--pose", choices=("truth", "local"), default="truth", help="with --autopilot: as `outrider sim`")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """On several processes (`--dist loadfile`) a file stays together, and so do the flights in real time.

    That is what the mark `xdist_group` is for; with pytest 9.2 and xdist 3.8 it changes nothing.
    """
    from xdist.scheduler import LoadFileScheduling

    class ByGroup(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return _group(Path(super()._split_scope(nodeid)))

    return ByGroup(config, log) if config.getvalue("dist") == "loadfile" else None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark every test by its folder; with another autopilot, leave out what needs ours; the longest first."""
    for item in items:
        for mark in _FOLDER_MARKS:
            if mark in Path(item.path).parent.parts:
                item.add_marker(mark)
    if hasattr(config, "workerinput"):
        long = {item.path for item in items if item.get_closest_marker("slow")}
        items.sort(key=lambda item: (item.path.name not in _REAL_TIME, item.path not in long))
    if config.getoption("--autopilot"):
        ours = [item for item in items if item.get_closest_marker("own_autopilot")]
        config.hook.pytest_deselected(items=ours)
        items[:] = [item for item in items if item not in ours]


def _group(path: Path) -> str:
    """What runs in one process, one after the other."""
    return "real time" if path.name in _REAL_TIME else str(path)
