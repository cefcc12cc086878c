"""Marks of the test folders, and how property tests run."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

import common  # noqa: F401 — before NumPy, which looks at import how many threads linear algebra has: one a process

_FOLDER_MARKS = ("system", "browser")
_LANES = {
    "flights": (
        "test_autopilot_flight.py",
        "test_follow_node.py",
        "test_fusion_members.py",
        "test_helm_autopilot_link.py",
        "test_helm_on_ardupilot.py",
    ),
    "conformance": ("test_conformance.py",),
    "processes": (
        "test_bad_input.py",
        "test_recorder.py",
        "test_rtsp_camera.py",
        "test_topics_command.py",
        "test_video.py",
    ),
}
"""Tests in real time that wait more than they compute: on several processes each row runs in one, file after file, and
they go first. The other tests fill the cores beside them."""
_PAIRS = (
    "test_doctor_command.py",
    "test_external_autopilot.py",
    "test_reinitialise.py",
    "test_two_machines.py",
)
"""Flights that take less than half of two cores: two at a time, and nothing else beside them. Not those whose console
draws, that start half of their processes anew, or that freeze helm and cut links for a minute: their pictures came too
late beside another."""
_LANE = {name: lane for lane, names in _LANES.items() for name in names}


def pytest_configure() -> None:
    """Property tests: no deadline (other processes share the cores), and in CI the same examples in every run.

    `--hypothesis-profile thorough` tries 3,000 examples where a test leaves it to the profile.
    """
    worker = os.environ.get("PYTEST_XDIST_WORKER", "gw0")
    if int(worker.removeprefix("gw")) >= len(_LANES):
        os.nice(5)  # what only computes gives way to what flies
    settings.register_profile("outrider", deadline=None, derandomize=bool(os.environ.get("CI")), print_blob=True)
    unhurried = [HealthCheck.too_slow]  # at low priority, beside other work
    settings.register_profile(
        "thorough", settings.get_profile("outrider"), max_examples=3000, suppress_health_check=unhurried
    )
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
                if item.path.name in _PAIRS:
                    item.add_marker("in_pairs")
                elif item.path.name not in _LANE:
                    item.add_marker("alone")
    if hasattr(config, "workerinput"):
        long = {item.path for item in items if item.get_closest_marker("slow")}
        items.sort(key=lambda item: (item.path.name not in _LANE, item.path not in long))
    if config.getoption("--autopilot"):
        ours = [item for item in items if item.get_closest_marker("own_autopilot")]
        config.hook.pytest_deselected(items=ours)
        items[:] = [item for item in items if item not in ours]


def _group(path: Path) -> str:
    """What runs in one process, one after the other."""
    return _LANE.get(path.name, str(path))
