"""Picture strips of the benchmark `pursuit`, like the paper's figures 12 and 13: an occlusion, a re-initialisation."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from benchmarks.episode import Episode
from benchmarks.pursuit_count import Columns, found, occlusions
from benchmarks.pursuit_road import leaving_scenario
from common.processes import load_config
from ground.pursuit.pursuer import Pursued

_SIZE_PX = (320, 240)
_PER_ROW = 3
_QUALITY = 85
_BEFORE, _AFTER = 10, 20
"""Pictures between the event's edges and the first and the last one of a strip: 0.5 s and 1 s at 20 Hz."""
_LEAVING_S, _HELD_S, _HEIGHT_M = 26.0, (3.0, 23.0), 3.0


_BAND_PX = 22
_COLOURS = {
    "seen": (60, 220, 60),
    "predicted": (0, 140, 255),
    "lost": (80, 80, 255),
    "found by the search": (255, 200, 0),
}


class Kept(NamedTuple):
    """One picture of a flight."""

    state: str
    """What the tracker said: one of `seen`, `predicted`, `lost`, `found by the search`."""
    jpeg: bytes
    """The picture, small, with the tracker's rectangle and front drawn in."""


class Still(NamedTuple):
    """One picture of a strip."""

    t_s: float
    """Since the event began, s."""
    kept: Kept
    """The picture."""


Strips = Mapping[str, Sequence[Still]]
"""`occlusion`, `reinitialisation`, as far as there were any, to the pictures."""


class Album:
    """Small copies of every picture of a flight, with what the tracker said of it: `Episode.watch`."""

    def __init__(self) -> None:
        self._pictures: dict[int, Kept] = {}

    def take(self, number: int, frame: np.ndarray, pursued: Pursued) -> None:
        """Keep one: its number, the picture (H, W, 3), and the answer to it."""
        result = pursued.result
        state = result.state if not pursued.seen else "found by the search" if result.reinitialised else "seen"
        shown = frame.copy()
        corners = result.corners_px().round().astype(np.int32)
        cv2.polylines(shown, [corners], True, _COLOURS[state], 3, cv2.LINE_AA)
        middle, front = corners.mean(axis=0).astype(int), corners[:2].mean(axis=0).astype(int)
        cv2.line(shown, middle.tolist(), front.tolist(), (255, 255, 255), 2, cv2.LINE_AA)
        shown = cv2.resize(shown, _SIZE_PX, interpolation=cv2.INTER_AREA)
        jpeg = cv2.imencode(".jpg", shown, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes()
        self._pictures[number] = Kept(state, jpeg)

    def strips(self, columns: Columns) -> dict[str, list[Still]]:
        """The pictures around the flight's first occlusion and first right re-initialisation that it got over."""
        numbers = {"occlusion": around_occlusion(columns), "reinitialisation": around_reinitialisation(columns)}
        return {name: self._still(columns, chosen) for name, chosen in numbers.items() if chosen}

    def _still(self, columns: Columns, numbers: Sequence[int]) -> list[Still]:
        t_s, there = columns["t_s"], sorted(self._pictures)
        # A picture that the radio lost is replaced by the one before it.
        kept = [max((n for n in there if n <= number), default=there[0]) for number in numbers]
        return [Still(float(t_s[n] - t_s[numbers[1]]), self._pictures[n]) for n in kept]


def around_occlusion(columns: Columns) -> list[int]:
    """Pictures before the first occlusion that was got over, in it and after it; none without one."""
    has, last = found(columns), len(columns["t_s"]) - 1
    for span in occlusions(columns["covered"]):
        again = np.flatnonzero(has[span.end :])
        if span.begin >= _BEFORE and len(again):
            first = span.end + int(again[0])
            middle = (span.begin + span.end) // 2
            return [span.begin - _BEFORE, span.begin, middle, span.end - 1, first, min(first + _AFTER, last)]
    return []


def around_reinitialisation(columns: Columns) -> list[int]:
    """Pictures from the last sight of the target to the search that found it again and after; none without one."""
    has, seen, last = found(columns), columns["seen"] > 0, len(columns["t_s"]) - 1
    for at in np.flatnonzero(np.diff(columns["reinitialisations"]) > 0) + 1:
        before = np.flatnonzero(seen[:at])
        if not has[at] or not len(before):
            continue
        lost = int(before[-1])
        return [max(lost - _BEFORE, 0), lost, (lost + int(at)) // 2, int(at) - 1, int(at), min(int(at) + _AFTER, last)]
    return []


def leave_and_return(seed: int) -> Strips:
    """A short flight in which the operator holds the vehicle, the car drives away and comes back elsewhere."""
    episode = Episode(load_config("kite", ()), leaving_scenario(seed), seed, _HEIGHT_M)
    album = Album()
    episode.watch, episode.held_s = album.take, _HELD_S
    episode.fly(_LEAVING_S)
    trace = episode.trace
    return album.strips({name: trace.column(name).astype(float) for name in trace.rows[0]})


def draw_strips(flown: Sequence[Strips], seed: int, folder: Path) -> None:
    """Write `pursuit-occlusion.jpg` and `pursuit-reinitialisation.jpg`, each of the first flight that has it.

    Args:
        flown: strips of the flights.
        seed: of a flight of its own when none of them had to be initialised again.
        folder: where to.
    """
    for name in ("occlusion", "reinitialisation"):
        strip = next((strips[name] for strips in flown if name in strips), None)
        if strip is None and name == "reinitialisation":
            strip = leave_and_return(seed).get(name)
        if strip is not None:
            cv2.imwrite(str(folder / f"pursuit-{name}.jpg"), montage(strip), [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])


def montage(strip: Sequence[Still]) -> np.ndarray:
    """The pictures of a strip in rows of three, with their times, (H, W, 3)."""
    width, height = _SIZE_PX
    rows = math.ceil(len(strip) / _PER_ROW)
    sheet = np.full((rows * height, _PER_ROW * width, 3), 255, np.uint8)
    for index, still in enumerate(strip):
        picture = np.asarray(cv2.imdecode(np.frombuffer(still.kept.jpeg, np.uint8), cv2.IMREAD_COLOR))
        picture[-_BAND_PX:] //= 4
        text, colour = f"{still.t_s:+.2f} s: {still.kept.state}", _COLOURS[still.kept.state]
        cv2.putText(picture, text, (8, height - 6), cv2.FONT_HERSHEY_SIMPLEX, 0.5, colour, 1, cv2.LINE_AA)
        y, x = index // _PER_ROW * height, index % _PER_ROW * width
        sheet[y : y + height, x : x + width] = picture
    return sheet
