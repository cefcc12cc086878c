"""Where a target truly was in each picture, from the files of three well-known formats."""

from __future__ import annotations

import math
import re
from pathlib import Path

from common.config import ConfigError
from common.tracking.base import Box

FORMATS = ("otb", "tld", "mot")
"""`otb`: x,y,w,h a line, by comma, tab or space. `tld`: x1,y1,x2,y2. `mot`: frame,id,x,y,w,h,... (MOTChallenge)."""


def read_ground_truth(path: str, form: str, target: int | None = None) -> dict[int, Box | None]:
    """Boxes (x, y, w, h, px) by picture number from 0; None where the target is not visible.

    `otb` and `tld` have one line a picture, and NaN or an empty box where there is no target. `mot` counts from 1 and
    leaves such pictures out: those between its first and its last one are taken as without the target.

    Args:
        path: the file.
        form: one of `FORMATS`.
        target: `mot`: the identifier to take; None takes the only one.

    Raises:
        ConfigError: unknown format, unreadable file, a line that is no box, or several targets and none named.
    """
    if form not in FORMATS:
        raise ConfigError(f"--format: got {form!r}, expected one of: {', '.join(FORMATS)}")
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"ground truth: cannot read {path!r}: {error}") from None
    lines = [(number, line.strip()) for number, line in enumerate(text.splitlines(), 1) if line.strip()]
    if not lines:
        raise ConfigError(f"ground truth: {path!r} is empty, expected one box a line")
    if form == "mot":
        return _motchallenge([_numbers(path, number, line, 6) for number, line in lines], path, target)
    return {
        index: _box(_numbers(path, number, line, 4)[:4], corners=form == "tld")
        for index, (number, line) in enumerate(lines)
    }


def _numbers(path: str, number: int, line: str, least: int) -> list[float]:
    try:
        values = [float(part) for part in re.split(r"[,;\s]+", line.strip(" ,;\t"))]
    except ValueError:
        values = []
    if len(values) < least:
        raise ConfigError(
            f"ground truth: {path}:{number}: got {line[:60]!r}, expected at least {least} numbers; is --format right?"
        )
    return values


def _box(values: list[float], corners: bool) -> Box | None:
    if not all(map(math.isfinite, values)):
        return None
    x, y, width, height = values
    if corners:
        width, height = width - x, height - y
    return (x, y, width, height) if width > 0 and height > 0 else None


def _motchallenge(rows: list[list[float]], path: str, target: int | None) -> dict[int, Box | None]:
    known = sorted({int(row[1]) for row in rows})
    if target is None and len(known) > 1:
        raise ConfigError(f"ground truth: {path!r} has the targets {known[:10]}; name one with --target")
    own = [row for row in rows if target is None or int(row[1]) == target]
    if not own:
        raise ConfigError(f"--target: got {target}, expected one of: {known[:10]}")
    boxes = {int(row[0]) - 1: _box(row[2:6], corners=False) for row in own}
    return {frame: boxes.get(frame) for frame in range(min(boxes), max(boxes) + 1)}
