"""Annotations in CAVIAR's XML (CVML), as ARMOT-style ground truth uses it: who is where, picture by picture."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from common.config import ConfigError

Box = tuple[float, float, float, float]
Boxes = dict[int, dict[int, Box]]
"""Number of the picture, then of the person: left, top, width, height, px."""


def read(path: str | Path) -> Boxes:
    """Boxes of a file; CAVIAR gives their middles.

    Raises:
        ConfigError: it cannot be read, is no such XML, or a box is none.
    """
    try:
        root = ElementTree.parse(path).getroot()
    except OSError as error:
        raise ConfigError(f"--annotations: cannot read {str(path)!r} ({error.strerror})") from None
    except ElementTree.ParseError as error:
        raise ConfigError(f"--annotations: {str(path)!r} is no XML ({error})") from None
    frames = root.findall("frame")
    if root.tag != "dataset" or not frames:
        raise ConfigError(f"--annotations: {str(path)!r} has no <frame> in a <dataset>; expected CAVIAR's XML")
    found: Boxes = {}
    for frame in frames:
        number = _whole(frame, "number", path)
        people = found.setdefault(number, {})
        for thing in frame.iterfind("objectlist/object"):
            people[_whole(thing, "id", path)] = _box(thing, number, path)
    return found


def _whole(element: ElementTree.Element, name: str, path: str | Path) -> int:
    try:
        return int(element.get(name, ""))
    except ValueError:
        raise ConfigError(
            f"--annotations: {str(path)!r}: <{element.tag}> has {name}={element.get(name)!r}, expected a whole number"
        ) from None


def _box(thing: ElementTree.Element, frame: int, path: str | Path) -> Box:
    box = thing.find("box")
    try:
        xc, yc, width, height = (float(box.get(name, "")) for name in ("xc", "yc", "w", "h"))  # type: ignore[union-attr]
    except (AttributeError, ValueError):
        xc = yc = width = height = math.nan
    if not (math.isfinite(xc + yc) and 0.0 < width < math.inf and 0.0 < height < math.inf):
        raise ConfigError(
            f"--annotations: {str(path)!r}, frame {frame}: an <object> without a <box> of xc, yc, w and h in px"
        )
    return xc - width / 2, yc - height / 2, width, height
