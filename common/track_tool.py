"""What `outrider track` does: one tracker alone over a video or a folder of images; its answers as CSV and video."""

from __future__ import annotations

import csv
import math
import sys
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path
from typing import Literal, TextIO, TypeVar

import cv2
import numpy as np

from common.config import Config, ConfigError
from common.tracking.base import Box, SearchingTracker, Tracker, TrackResult, upright_box
from common.tracking.model_picture import read_model
from common.tracking.registry import TRACKERS, make_tracker
from common.video import FileSource

Line = TypeVar("Line")
State = Literal["tracking", "lost", "reacquired"]
COLUMNS = ("frame", "x", "y", "w", "h", "angle_deg", "score", "state")
NAMES = {"pursuit": "particle_filter", **{name: name for name in TRACKERS if name != "particle_filter"}}
"""Names of `--tracker`: the node that a tracker serves, or its own."""
_DEFAULT_RATE_HZ = 25.0
_LIVE = ("rtsp://", "rtsps://", "v4l2:", "/dev/")
"""How the sources begin that the camera node reads, and no file does."""
_COLOURS: dict[State, tuple[int, int, int]] = {
    "tracking": (60, 220, 60),
    "reacquired": (255, 200, 0),
    "lost": (0, 140, 255),
}


@dataclass(frozen=True)
class TrackJob:
    """What `outrider track` was asked for."""

    source: str
    """Video file or image folder."""
    tracker: str = "pursuit"
    """One of `NAMES`."""
    init: Box | None = None
    """The target's box, px, in picture `init_frame`."""
    init_frame: int = 0
    """Number of that picture, from 0."""
    model: str | None = None
    """Or a picture of the target, which is then searched for."""
    rate_hz: float | None = None
    """Pictures a second; None takes the file's own rate, or 25."""
    seed: int = 1
    """Seed of the tracker's randomness."""


@dataclass(frozen=True)
class Row:
    """One line of the CSV."""

    frame: int
    """Number of the picture, from 0."""
    state: State
    """`reacquired`: seen again after pictures without it. `lost` also before it was first seen."""
    result: TrackResult | None = None
    """The tracker's answer; None before the target was chosen or found."""

    @property
    def box(self) -> Box | None:
        """Upright box of the target, px; None when it is not seen."""
        return None if self.result is None or self.state == "lost" else upright_box(self.result)

    def cells(self) -> list[str]:
        """Texts of the columns."""
        place = ["", "", "", "", ""]
        if self.result is not None and self.box is not None:
            place = [f"{value:.2f}" for value in (*self.box, math.degrees(self.result.angle_rad))]
        score = 0.0 if self.result is None else self.result.score
        return [str(self.frame), *place, f"{score:.4f}", self.state]


def parse_box(text: str) -> Box:
    """Box of the text `x,y,w,h`.

    Raises:
        ConfigError: something else.
    """
    try:
        x, y, width, height = (float(part) for part in text.split(","))
    except ValueError:
        raise ConfigError(f"--init: got {text!r}, expected x,y,w,h in px") from None
    return x, y, width, height


def rows(job: TrackJob, config: Config, source: FileSource) -> Iterator[tuple[Row, np.ndarray | None]]:
    """Line and picture of every frame of the source; None for a picture that cannot be decoded.

    Raises:
        ConfigError: neither or both of box and model, a bad one, or no picture of that number.
    """
    if (job.init is None) == (job.model is None):
        raise ConfigError("track: expected either --init x,y,w,h or --model IMAGE; give one of them")
    if job.init_frame < 0:
        raise ConfigError(f"--init-frame: got {job.init_frame}, expected the number of a picture, from 0")
    if job.tracker not in NAMES:
        raise ConfigError(f"--tracker: got {job.tracker!r}, expected one of: {', '.join(NAMES)}")
    tracker = make_tracker(NAMES[job.tracker], config, np.random.default_rng(job.seed))
    model = None if job.model is None else read_model(job.model, "--model")
    period_ns = 1e9 / (job.rate_hz or source.rate_hz or _DEFAULT_RATE_HZ)
    run = _Run(job, tracker, model)
    number = -1
    for number, frame in enumerate(source.frames()):
        yield run.step(number, frame, round(number * period_ns)), frame
    if job.init is not None and number < job.init_frame:
        raise ConfigError(f"--init-frame: got {job.init_frame}, expected at most {number}, the last picture")


def begun(lines: Iterable[Line]) -> Iterator[Line]:
    """The same lines, the first of them made: what it refuses is refused before a file is begun."""
    lines = iter(lines)
    return chain(list(islice(lines, 1)), lines)


class _Run:
    """The tracker over one film."""

    def __init__(self, job: TrackJob, tracker: Tracker, model: np.ndarray | None):
        self._job = job
        self._tracker = tracker
        self._started = False
        self._seen_before = True
        if model is not None:
            if not isinstance(tracker, SearchingTracker):
                raise ConfigError(f"--model: tracker {job.tracker!r} cannot search a picture; give --init x,y,w,h")
            tracker.learn(model)

    def step(self, number: int, frame: np.ndarray | None, t_ns: int) -> Row:
        if frame is None:
            self._seen_before = not self._started
            return Row(number, "lost")
        result = self._result(number, frame, t_ns)
        if result is None:
            return Row(number, "lost")
        seen = result.state == "tracking"
        state: State = "lost" if not seen else "tracking" if self._seen_before else "reacquired"
        self._seen_before = seen
        return Row(number, state, result)

    def _result(self, number: int, frame: np.ndarray, t_ns: int) -> TrackResult | None:
        if self._started:
            return self._tracker.update(frame, t_ns)
        if self._job.init is not None:
            if number < self._job.init_frame:
                return None
            if number > self._job.init_frame:
                raise ConfigError(f"--init-frame: picture {self._job.init_frame} cannot be decoded; take another")
            try:
                self._tracker.init(frame, self._job.init, 0.0, t_ns)
            except ValueError as error:
                raise ConfigError(f"--init: {error}") from None
        elif not (isinstance(self._tracker, SearchingTracker) and self._tracker.find(frame, t_ns)):
            return None
        self._started = True
        return self._tracker.update(frame, t_ns)


def draw(frame: np.ndarray, row: Row) -> np.ndarray:
    """The picture with the target's rectangle and front on it, orange where it is only predicted; a copy."""
    shown = frame.copy()
    if row.result is not None:
        corners = row.result.corners_px().round().astype(np.int32)
        cv2.polylines(shown, [corners], True, _COLOURS[row.state], 2, cv2.LINE_AA)
        middle, front = corners.mean(axis=0), corners[:2].mean(axis=0)
        cv2.line(shown, middle.astype(int).tolist(), front.astype(int).tolist(), (255, 255, 255), 1, cv2.LINE_AA)
    text = f"{row.frame} {row.state}"
    for colour, width in (((0, 0, 0), 3), (_COLOURS[row.state], 1)):
        cv2.putText(shown, text, (6, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour, width, cv2.LINE_AA)
    return shown


def run(job: TrackJob, config: Config, out: str | None, video: str | None) -> int:
    """Track, write CSV (to standard output without a file) and video, and say what came of it; returns the exit code.

    Raises:
        ConfigError: anything that cannot be used as given; no file is left half written then but the ones begun.
    """
    cv2.setNumThreads(1)
    if job.rate_hz is not None and not 0.0 < job.rate_hz < math.inf:
        raise ConfigError(f"--rate: got {job.rate_hz:g}, expected pictures a second, above 0")
    if job.source.startswith(_LIVE):
        raise ConfigError(
            f"track: got {job.source!r}, a live camera, expected a video file or an image folder; record it first"
        )
    source = FileSource(job.source, loop=False, option="track")
    counts: dict[str, int] = dict.fromkeys(_COLOURS, 0)
    with ExitStack() as stack:
        stack.callback(source.close)
        lines = begun(rows(job, config, source))
        sink = stack.enter_context(opened(out)) if out else sys.stdout
        film = Film(video, source, job.rate_hz) if video else None
        if film is not None:
            stack.callback(film.close)
        writer = csv.writer(sink, lineterminator="\n")
        writer.writerow(COLUMNS)
        for row, frame in lines:
            writer.writerow(row.cells())
            counts[row.state] += 1
            if film is not None and frame is not None:
                film.write(draw(frame, row))
            progress(row.frame + 1, source.count)
    progress(None, None)
    total = sum(counts.values())
    print(
        f"{total} pictures: target seen in {total - counts['lost']}, lost in {counts['lost']}, "
        f"reacquired {counts['reacquired']} times"
        + (f"; {source.corrupt} not decodable" if source.corrupt else "")
        + (f"; the last {source.missing} of {total + source.missing} announced are missing" if source.missing else ""),
        file=sys.stderr,
    )
    return 0


def opened(out: str) -> TextIO:
    """The file to write the CSV to.

    Raises:
        ConfigError: it cannot be written.
    """
    try:
        return Path(out).open("w", encoding="utf-8", newline="")
    except OSError as error:
        raise ConfigError(f"--out: cannot write {out!r}: {error.strerror}") from None


class Film:
    """The drawn pictures as a video file.

    Args:
        path: of the file.
        source: of the pictures.
        rate_hz: pictures a second; None takes the source's own.

    Raises:
        ConfigError: it cannot be written.
    """

    def __init__(self, path: str, source: FileSource, rate_hz: float | None):
        code = cv2.VideoWriter.fourcc(*("MJPG" if path.lower().endswith(".avi") else "mp4v"))
        rate_hz = rate_hz or source.rate_hz or _DEFAULT_RATE_HZ
        self._writer = cv2.VideoWriter(path, code, rate_hz, (source.width, source.height))
        if not self._writer.isOpened():
            raise ConfigError(f"--video: cannot write {path!r}; expected a path ending in .mp4 or .avi in a folder")

    def write(self, frame: np.ndarray) -> None:
        """Append a picture, (H, W, 3)."""
        self._writer.write(frame)

    def close(self) -> None:
        """End the file."""
        self._writer.release()


def progress(done: int | None, total: int | None) -> None:
    """One line on a terminal, rewritten; nothing into a file."""
    if not sys.stderr.isatty():
        return
    if done is None:
        print("\r\033[K", end="", file=sys.stderr)
    elif done % 10 == 0:
        share = f"[{'#' * (30 * done // total):30}] {done} of {total}" if total and done <= total else str(done)
        print(f"\r{share} pictures", end="", file=sys.stderr, flush=True)
