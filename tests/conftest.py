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


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark every test by its folder."""
    for item in items:
        for mark in _FOLDER_MARKS:
            if mark in Path(item.path).parent.parts:
                item.add_marker(mark)


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
