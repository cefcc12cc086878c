"""Marks of the test folders, and how property tests run."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest
from hypothesis import settings

_FOLDER_MARKS = ("system", "browser")


def pytest_configure() -> None:
    """Property tests: no deadline (other processes share the cores), and in CI the same examples in every run."""
    settings.register_profile("outrider", deadline=None, derandomize=bool(os.environ.get("CI")), print_blob=True)
    settings.load_profile("outrider")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Point the system tests at an autopilot that runs already (PX4 in the loop): standing, disarmed, at home."""
    parser.addoption("--autopilot", metavar="URL", help="fly the system tests on this autopilot (default: our own)")
    parser.addoption("--pose", choices=("truth", "local"), default="truth", help="with --autopilot: as `outrider sim`")


@pytest.hookimpl(tryfirst=True)  # before xdist reads the groups
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark every test by its folder; with another autopilot, leave out what needs ours; group for several processes."""
    for item in items:
        for mark in _FOLDER_MARKS:
            if mark in Path(item.path).parent.parts:
                item.add_marker(mark)
    if hasattr(config, "workerinput"):
        _group(items)
    if config.getoption("--autopilot"):
        ours = [item for item in items if item.get_closest_marker("own_autopilot")]
        config.hook.pytest_deselected(items=ours)
        items[:] = [item for item in items if item not in ours]


def sample_video() -> Path:
    """Debian's sample video vtest.avi, where the package or set-up has put it."""
    places = (
        Path("/usr/share/doc/opencv-doc/examples/data/vtest.avi"),
        Path(sys.prefix) / "share" / "outrider" / "vtest.avi",
    )
    for place in places:
        if place.is_file():
            return place
    raise FileNotFoundError(f"vtest.avi: expected it at one of {[str(p) for p in places]}; run scripts/setup.sh test")


def _group(items: list[pytest.Item]) -> None:
    """Of tests on several processes, a file stays together, and so do those in real time; the longest begin first."""
    groups = {item: "real time" if item.get_closest_marker("real_time") else str(item.path) for item in items}
    long = {groups[item] for item in items if item.get_closest_marker("slow")}
    for item, group in groups.items():
        item.add_marker(pytest.mark.xdist_group(group))
    items.sort(key=lambda item: (groups[item] != "real time", groups[item] not in long))
