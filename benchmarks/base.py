"""What a benchmark returns, and what every result file says."""

from __future__ import annotations

import importlib.metadata
import json
import os
import platform
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Outcome:
    """Figures of one run."""

    results: dict[str, float]
    """Metric name (unit in the name) to figure."""
    baseline: dict[str, Any]
    """What it was run against in the same run: name, version, figures, ratio."""
    paper: dict[str, float] = field(default_factory=dict)
    """The paper's figures under the same names."""
    table: tuple[str, ...] = ()
    """Lines to print instead of the plain list of figures, where that list would be hard to read."""


@dataclass(frozen=True)
class Settings:
    """How to run."""

    seed: int = 0
    """Of everything random."""
    quick: bool = False
    """Within 60 s: shorter, never easier."""
    plots: Path | None = None
    """Folder for PNG plots; None for none."""
    sequences: Path | None = None
    """Folder of real sequences with ground truth; None for none. Only `fusion` reads it."""
    platform: str | None = None
    """`follow`: one of its platforms; None for all."""


@dataclass(frozen=True)
class Benchmark:
    """One entry of the list."""

    name: str
    """Name on the command line."""
    doc: str
    """One line."""
    run: Callable[[Settings], Outcome]
    """Does it."""


_PACKAGES = ("numpy", "opencv-python-headless", "filterpy", "eclipse-zenoh", "mavsdk", "mujoco", "pymavlink")


def environment() -> dict[str, Any]:
    """Processor, cores and versions of the machine that ran it."""
    versions = {}
    for package in _PACKAGES:
        try:
            versions[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            versions[package] = "not installed"
    return {"cpu": _cpu_name(), "cores": os.cpu_count(), "python": platform.python_version(), "versions": versions}


def _cpu_name() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.machine()


def as_json(benchmark: Benchmark, settings: Settings, outcome: Outcome) -> str:
    """Result file of one run."""
    return (
        json.dumps(
            {
                "name": benchmark.name,
                "seed": settings.seed,
                "quick": settings.quick,
                "environment": environment(),
                "results": outcome.results,
                "paper": outcome.paper,
                "baseline": outcome.baseline,
            },
            indent=2,
        )
        + "\n"
    )
