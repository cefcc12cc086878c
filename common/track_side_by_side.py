"""`outrider track --all`: every member of the fusion alone, and the fusion, over the same pictures."""

from __future__ import annotations

import csv
import sys
from contextlib import ExitStack
from dataclasses import replace

import cv2
import numpy as np

from common.config import Config
from common.track_tool import COLUMNS, NAMES, Film, Row, TrackJob, begun, opened, progress, rows
from common.tracking.registry import tracker_class
from common.video import FileSource

FUSION = "hab-df"
_COLOURS = ((60, 220, 60), (255, 160, 0), (200, 80, 255), (0, 220, 220), (160, 160, 255), (255, 255, 120))
_FUSED_COLOUR = (0, 140, 255)


def names(config: Config) -> list[str]:
    """Names of `--tracker` for the fusion's members, and last for the fusion itself."""
    by_tracker: dict[str, str] = {tracker: name for name, tracker in reversed(NAMES.items())}
    members: tuple[str, ...] = config.section(tracker_class(FUSION).config_type).members
    return [*(by_tracker.get(member, member) for member in members), FUSION]


def run(job: TrackJob, config: Config, out: str | None, video: str | None) -> int:
    """Track with each; the CSV has a first column `tracker`, the video all boxes; returns the exit code.

    Raises:
        ConfigError: anything that cannot be used as given.
    """
    cv2.setNumThreads(1)
    trackers = names(config)
    seen = dict.fromkeys(trackers, 0)
    with ExitStack() as stack:
        sources = {name: FileSource(job.source, loop=False, option="track") for name in trackers}
        for source in sources.values():
            stack.callback(source.close)
        first = sources[FUSION]
        runs = [rows(replace(job, tracker=name), config, source) for name, source in sources.items()]
        lines = begun(zip(*runs, strict=True))
        sink = stack.enter_context(opened(out)) if out else sys.stdout
        film = Film(video, first, job.rate_hz) if video else None
        if film is not None:
            stack.callback(film.close)
        writer = csv.writer(sink, lineterminator="\n")
        writer.writerow(("tracker", *COLUMNS))
        count = 0
        for answers in lines:
            count += 1
            for name, (row, _) in zip(trackers, answers, strict=True):
                writer.writerow((name, *row.cells()))
                seen[name] += row.state != "lost"
            frame = answers[-1][1]
            if film is not None and frame is not None:
                film.write(draw(frame, dict(zip(trackers, (row for row, _ in answers), strict=True))))
            progress(count, first.count)
    progress(None, None)
    print(f"{count} pictures: target seen in " + ", ".join(f"{n} ({k})" for k, n in seen.items()), file=sys.stderr)
    return 0


def draw(frame: np.ndarray, answers: dict[str, Row]) -> np.ndarray:
    """The picture (H, W, 3) with every box that is seen, in its tracker's colour, and the names; a copy."""
    shown = frame.copy()
    for index, (name, row) in enumerate(answers.items()):
        colour = _FUSED_COLOUR if name == FUSION else _COLOURS[index % len(_COLOURS)]
        text = name if row.box is not None else f"{name}: lost"
        cv2.putText(shown, text, (6, 16 + 16 * index), cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour, 1, cv2.LINE_AA)
        if row.box is not None:
            x, y, width, height = row.box
            corners = (round(x), round(y)), (round(x + width), round(y + height))
            cv2.rectangle(shown, *corners, colour, 3 if name == FUSION else 1, cv2.LINE_AA)
    return shown
