"""RGB-D pictures in the layout of TUM's benchmark: `rgb.txt` and `depth.txt` with times and files, and where there is
one `groundtruth.txt` with the camera's poses.

Sturm et al. 2012, A Benchmark for the Evaluation of RGB-D SLAM Systems; depth is 16-bit PNG, 5000 units to the metre.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np

from common.config import ConfigError
from common.geometry.rotation import Array
from onboard.people.depth import Floats
from onboard.people.pose import Picture
from onboard.people.trajectory import TRUTH, CameraPose, Trajectory

_Read = TypeVar("_Read")
COLOURS, DEPTHS, PAIRS = "rgb.txt", "depth.txt", "associations.txt"


@dataclass(frozen=True)
class Recorded:
    """One picture of a recording."""

    number: int
    """From 0."""
    t_ns: int
    """Its time, ns."""
    colour: Picture | None
    """(H, W, 3) BGR; None when it cannot be decoded."""
    depth_m: Floats | None = None
    """(H, W), m, 0 where nothing returned; None without."""
    depth_ns: int | None = None
    """When that was taken, ns."""
    depth_broken: bool = False
    """Whether there is a depth picture that cannot be decoded."""
    camera: CameraPose | None = None
    """Where the camera was; None where that is not known."""


@dataclass(frozen=True)
class _Entry:
    t_s: float
    colour: Path
    depth_s: float | None
    depth: Path | None


class TumSequence:
    """Reads such a folder in the order of its times.

    Args:
        folder: with `rgb.txt`; `depth.txt` beside it, or `associations.txt` with both; `groundtruth.txt` where there is
            one.
        depth_scale: depth units in a metre.

    Raises:
        ConfigError: a list is missing or malformed, names no picture, a picture is not there, none can be decoded, or
            the depth is of another kind than the format's.
    """

    def __init__(self, folder: str | Path, depth_scale: float):
        self._folder, self._scale = Path(folder), depth_scale
        self._entries = self._read()
        missing = [e.colour for e in self._entries if not e.colour.is_file()]
        missing += [e.depth for e in self._entries if e.depth is not None and not e.depth.is_file()]
        if missing:
            raise ConfigError(
                f"people: {missing[0]} is listed in {folder}, but {len(missing)} such files are not there"
            )
        first = _first(cv2.imread(str(e.colour), cv2.IMREAD_COLOR) for e in self._entries)
        if first is None:
            raise ConfigError(
                f"people: {self._entries[0].colour} cannot be decoded, nor can any other picture of {folder}; expected "
                "pictures"
            )
        self.height, self.width = first.shape[:2]
        depth = _first(self._depth(e.depth) for e in self._entries if e.depth is not None)
        self.depth_size = None if depth is None else (depth.shape[1], depth.shape[0])
        """Width and height of the depth pictures, px; None where none can be decoded."""
        span_s = self._entries[-1].t_s - self._entries[0].t_s
        self.rate_hz = (len(self._entries) - 1) / span_s if span_s > 0 else None
        """Pictures a second on average; None for a single one."""
        self.count = len(self._entries)
        """Number of pictures."""
        self.with_depth = any(entry.depth is not None for entry in self._entries)
        """Whether any picture has depth."""
        truth = self._folder / TRUTH
        self.trajectory = Trajectory(_poses(truth), str(truth)) if truth.is_file() else None
        """Where the camera was; None where the folder does not say."""
        self.in_world = self.trajectory is not None
        """Whether places can be given in a world's frame."""

    def frames(self) -> Iterator[Recorded]:
        """Every picture with the depth nearest in time."""
        start_s = self._entries[0].t_s
        for number, entry in enumerate(self._entries):
            colour = cv2.imread(str(entry.colour), cv2.IMREAD_COLOR)
            depth = None if entry.depth is None else self._depth(entry.depth)
            depth_ns = None if entry.depth_s is None else round((entry.depth_s - start_s) * 1e9)
            pixels = None if colour is None else np.asarray(colour, np.uint8)
            camera = None if self.trajectory is None else self.trajectory.at(entry.t_s)
            broken = entry.depth is not None and depth is None
            yield Recorded(number, round((entry.t_s - start_s) * 1e9), pixels, depth, depth_ns, broken, camera)

    def _depth(self, path: Path) -> Floats | None:
        """Metres (H, W) of a file; None when it cannot be decoded."""
        raw = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        if raw is None:
            return None
        if raw.ndim != 2 or raw.dtype != np.uint16:
            raise ConfigError(
                f"people: {path}: got {raw.dtype} of shape {raw.shape}, expected a 16-bit picture of one channel: "
                f"depth in m times {self._scale:g} (--depth-scale), 0 where there is none"
            )
        return raw.astype(np.float32) / np.float32(self._scale)

    def _read(self) -> list[_Entry]:
        pairs = self._folder / PAIRS
        if pairs.is_file():
            rows = _rows(pairs, 4)
            found = [_Entry(float(t), self._folder / c, float(td), self._folder / d) for t, c, td, d in rows]
        else:
            colours = sorted((float(t), self._folder / name) for t, name in _rows(self._folder / COLOURS, 2))
            listed = self._folder / DEPTHS
            depths = sorted((float(t), self._folder / name) for t, name in _rows(listed, 2)) if listed.is_file() else []
            found = [_Entry(t, path, *_nearest(t, depths)) for t, path in colours]
        if not found:
            raise ConfigError(f"people: {self._folder} lists no picture; expected lines of a time and a file")
        return sorted(found, key=lambda entry: entry.t_s)


def is_tum(source: str) -> bool:
    """Whether a source is a folder in this layout."""
    return (Path(source) / COLOURS).is_file() or (Path(source) / PAIRS).is_file()


def _first(pictures: Iterator[_Read | None]) -> _Read | None:
    """The first picture that could be decoded; None when there is none."""
    return next((picture for picture in pictures if picture is not None), None)


def _nearest(t_s: float, depths: list[tuple[float, Path]]) -> tuple[float | None, Path | None]:
    """The depth nearest in time, however far: whether it belongs to the picture is judged by who uses it."""
    if not depths:
        return None, None
    index = bisect_left(depths, (t_s, Path()))
    return min(depths[max(index - 1, 0) : index + 1], key=lambda depth: abs(depth[0] - t_s))


def _rows(path: Path, columns: int) -> list[list[str]]:
    """Words of each line that is no comment, the first of which (and the third) are times, s."""
    rows = []
    for number, words in _lines(path):
        if len(words) != columns or not all(_is_number(word) for word in words[::2]):
            expected = "time file" if columns == 2 else "time file time file"
            raise ConfigError(f"people: {path}, line {number}: got {' '.join(words)!r}, expected `{expected}`")
        rows.append(words)
    return rows


def _poses(path: Path) -> Array:
    """Lines of time, place and quaternion, (N, 8)."""
    rows = []
    for number, words in _lines(path):
        if len(words) != 8 or not all(_is_number(word) for word in words):
            raise ConfigError(
                f"people: {path}, line {number}: got {' '.join(words)!r}, expected `time x y z qx qy qz qw`"
            )
        rows.append([float(word) for word in words])
    if not rows:
        raise ConfigError(f"people: {path} holds no pose; expected lines `time x y z qx qy qz qw`, or no such file")
    return np.array(rows)


def _lines(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Number and words of each line that is no comment."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"people: {path} cannot be read ({error})") from None
    for number, line in enumerate(lines, 1):
        words = line.split()
        if words and not words[0].startswith("#"):
            yield number, words


def _is_number(word: str) -> bool:
    try:
        return math.isfinite(float(word))
    except ValueError:
        return False
