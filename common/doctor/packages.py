"""Checks of the installed Python packages against the distribution's own requirements."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from importlib import metadata

from common import __version__
from common.config import Config
from common.doctor.finding import Finding, fault, ok

_REQUIREMENT = re.compile(r"^(?P<name>[A-Za-z0-9._-]+)(?:\[[^]]*\])?\s*(?P<limits>[^;]*)(?:;(?P<marker>.*))?$")
_EXTRA = re.compile(r"""extra\s*==\s*['"]([a-z]+)['"]""")


def packages(config: Config, sides: tuple[str, ...]) -> Iterator[Finding]:
    """Whether every package that these sides need is there in a version that they accept."""
    try:
        required = metadata.requires("outrider") or []
    except metadata.PackageNotFoundError:
        yield fault("packages", "outrider itself is not installed", "pip install -e '.[all]' in its folder")
        return
    yield from compare(required, sides, metadata.version)


def compare(required: Iterable[str], sides: tuple[str, ...], version_of: Callable[[str], str]) -> Iterator[Finding]:
    """Findings for requirement texts such as `mavsdk<5,>=4.1; extra == 'onboard'`.

    Args:
        required: requirements of the distribution.
        sides: extras that count, besides what every side needs.
        version_of: installed version by name; raises PackageNotFoundError.
    """
    good = 0
    for text in required:
        match = _REQUIREMENT.match(text)
        if match is None or match["name"] == "outrider":
            continue
        extra = _EXTRA.search(match["marker"] or "")
        if extra is not None and extra[1] not in sides:
            continue
        name, limits = match["name"], match["limits"].strip()
        cure = f"pip install 'outrider[{extra[1] if extra else ','.join(sides)}]'"
        try:
            version = version_of(name)
        except metadata.PackageNotFoundError:
            yield fault(f"package {name}", f"not installed, expected {limits or 'any version'}", cure)
            continue
        if not all(_within(version, limit) for limit in limits.split(",") if limit.strip()):
            yield fault(f"package {name}", f"got {version}, expected {limits}", cure)
            continue
        good += 1
    yield ok("packages", f"{good} in accepted versions; outrider {__version__}")


def _within(version: str, limit: str) -> bool:
    match = re.match(r"\s*(>=|<=|<|>|==)\s*([\d.]+)", limit)
    if match is None:
        return True
    got, wanted = _numbers(version), _numbers(match[2])
    width = max(len(got), len(wanted))
    a, b = (numbers + [0] * (width - len(numbers)) for numbers in (got, wanted))
    return {">=": a >= b, "<=": a <= b, "<": a < b, ">": a > b, "==": a == b}[match[1]]


def _numbers(version: str) -> list[int]:
    release = re.match(r"[\d.]*", version)
    return [int(part) for part in (release[0] if release else "").split(".") if part]
