"""What `outrider people` does: recorded pictures in; the MOTChallenge's CSV, a video and figures out."""

from __future__ import annotations

import argparse
import contextlib
import csv
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import msgspec
import numpy as np

from common.config import Config, ConfigError
from common.geometry.camera import Camera
from common.geometry.rotation import as_vec3
from common.video import FileSource
from onboard.people.caviar import Box, Boxes, read
from onboard.people.detector import PersonDetector
from onboard.people.detector_file import HOW, fetched_detector
from onboard.people.drawing import draw
from onboard.people.findings import Findings, Found, Frame
from onboard.people.pipeline import PeoplePipeline
from onboard.people.pipeline_config import PeopleConfig
from onboard.people.pose import Picture
from onboard.people.pose_file import pose_network
from onboard.people.pose_network import PoseNetwork
from onboard.people.tally import Tally
from onboard.people.trajectory import ned_of
from onboard.people.tum import Recorded, TumSequence, is_tum
from onboard.people.watch import iou

_DEFAULT_RATE_HZ = 25.0
_LEAST_IOU = 0.5
_SAME_SHAPE = 0.02
"""By this share two pictures' ratios of width to height may differ: the smaller one is rounded to whole pixels."""
_UPRIGHT = (2**-0.5, 0.0, 0.0, 2**-0.5)
Intrinsics = tuple[float, float, float, float]


@dataclass(frozen=True)
class Row:
    """One line of the CSV."""

    frame: int
    """Number of the picture, from 0."""
    number: int
    """Who."""
    box: Box
    """Left, top, width, height, px."""
    confidence: float
    """Mean of the joints', 0 to 1."""
    p_m: tuple[float, float, float] | None
    """Place, m: in the recording's world where it says where the camera was, else in the camera's optical frame; None
    without depth, or where the camera's pose is missing."""

    def cells(self) -> list[str]:
        """Texts of the columns; pictures count from 1 in this format."""
        place = ["-1", "-1", "-1"] if self.p_m is None else [f"{c:.3f}" for c in self.p_m]
        return [
            str(self.frame + 1),
            str(self.number),
            *(f"{c:.1f}" for c in self.box),
            f"{self.confidence:.3f}",
            *place,
        ]


class _Video:
    """A video or image folder: pictures without depth."""

    with_depth = in_world = False
    depth_size = None

    def __init__(self, source: str, rate_hz: float | None):
        self._file = FileSource(source, loop=False, option="people")
        self.width, self.height, self.count = self._file.width, self._file.height, self._file.count
        self.rate_hz = rate_hz or self._file.rate_hz or _DEFAULT_RATE_HZ

    def frames(self) -> Iterator[Recorded]:
        """Every picture."""
        for number, picture in enumerate(self._file.frames()):
            yield Recorded(number, round(number * 1e9 / self.rate_hz), picture)
        self._file.close()


def run(
    args: argparse.Namespace, intrinsics: Intrinsics | None, config: Config, network: PoseNetwork | None = None
) -> int:
    """Find people, write what was found, say what came of it; returns the exit code.

    Args:
        args: of the command line (`common.people_command`).
        intrinsics: fx, fy, cx, cy, px; None where they were not given.
        config: section `people`.
        network: finds joints; by default the configured one.

    Raises:
        ConfigError: anything that cannot be used as given.
    """
    cv2.setNumThreads(1)
    settings = config.section(PeopleConfig)
    # Every region in every picture: there is no hurry, and the same pictures give the same file.
    settings = msgspec.structs.replace(settings, watch=msgspec.structs.replace(settings.watch, budget_ms=0.0))
    source = TumSequence(args.source, args.depth_scale) if is_tum(args.source) else _Video(args.source, args.rate)
    annotations = None if args.annotations is None else read(args.annotations)
    pipeline = _pipeline(source, intrinsics, settings, network)
    sink = _opened(args.out)
    film = None if args.video is None else _film(args.video, source)
    rows: list[Row] = []
    tally = Tally()
    with contextlib.ExitStack() as stack:
        if film is not None:
            stack.callback(film.release)
        for recorded in source.frames():
            shown = _shown(recorded, pipeline, source, rows, tally)
            if film is not None:  # every picture, so that it keeps the recording's time
                film.write(cv2.resize(shown, (source.width, source.height)))
            _progress(tally.pictures, source.count)
    rows = _believed(rows, pipeline)
    if sink is None:
        _write(sys.stdout, rows)
    else:
        with sink:
            _write(sink, rows)
    if source.in_world:
        print("x, y, z: in the world of the recording's groundtruth.txt, m", file=sys.stderr)
    broken = f"; {tally.broken} not decodable" if tally.broken else ""
    people = len({row.number for row in rows})
    print(f"{tally.pictures} pictures: {people} people in {len(rows)} boxes{broken}", file=sys.stderr)
    if not source.with_depth:
        tally.instead("the source has no depth: places are not known")
    elif intrinsics is None:
        tally.instead("depth is not used: it needs --intrinsics FX,FY,CX,CY; places are not known")
    for line in tally.lines():
        print(line, file=sys.stderr)
    if annotations is not None:
        for name, value in scores(rows, annotations).items():
            print(f"{name:14} {value:.3f}", file=sys.stderr)
    return 0


def _shown(
    recorded: Recorded, pipeline: PeoplePipeline, source: TumSequence | _Video, rows: list[Row], tally: Tally
) -> Picture:
    """The picture with what was found in it, which is added to rows and tally."""
    tally.pictures += 1
    if recorded.colour is None:
        tally.broken += 1
        return draw(np.zeros((source.height, source.width, 3), np.uint8), (), "not decodable")
    findings = pipeline.look(_frame(recorded, recorded.colour))
    tally.note(findings, "its depth picture cannot be decoded" if recorded.depth_broken else findings.reason)
    rows += [_row(recorded.number, found, source.in_world) for found in findings.people]
    return draw(recorded.colour, findings.people, _note(findings))


def _camera(intrinsics: Intrinsics, source: TumSequence | _Video) -> Camera:
    """Calibration of the pictures.

    Raises:
        ConfigError: the principal point lies outside of them.
    """
    cx_px, cy_px = intrinsics[2:]
    if not (0.0 <= cx_px < source.width and 0.0 <= cy_px < source.height):
        raise ConfigError(
            f"--intrinsics: got a principal point of {cx_px:g},{cy_px:g}, expected one within the pictures, which are "
            f"{source.width}x{source.height} px; intrinsics of another size are scaled with it"
        )
    none = (0.0, 0.0, 0.0, 0.0, 0.0)
    return Camera(source.width, source.height, *intrinsics, none, _UPRIGHT, (0.0, 0.0, 0.0))


def _depth_camera(colour: Camera, source: TumSequence | _Video) -> Camera | None:
    """Calibration of the depth pictures, which are registered to the others.

    Raises:
        ConfigError: they cannot be, since they have another shape.
    """
    if not source.with_depth:
        return None
    width, height = source.depth_size or (colour.width, colour.height)
    if abs(width * colour.height / (height * colour.width) - 1.0) > _SAME_SHAPE:
        raise ConfigError(
            f"people: got depth of {width}x{height} px beside pictures of {colour.width}x{colour.height}, expected "
            "depth registered to the pictures, of their size or their shape; register it first"
        )
    return colour.resized(width, height)


def _pipeline(
    source: TumSequence | _Video, intrinsics: Intrinsics | None, config: PeopleConfig, network: PoseNetwork | None
) -> PeoplePipeline:
    camera = None if intrinsics is None else _camera(intrinsics, source)
    use_depth = source.with_depth and camera is not None and config.use_depth
    wanted = config.detector or (None if use_depth else fetched_detector())
    if not use_depth and wanted is None:
        why = "the source has no depth" if not source.with_depth else "depth needs --intrinsics FX,FY,CX,CY"
        raise ConfigError(
            f"people: {why if config.use_depth else 'depth is switched off'}, and without a person detector nobody can "
            f"be found; set people.detector.file and people.detector.decoder, or {HOW}"
        )
    detector = None if wanted is None else PersonDetector(wanted)
    network = network or pose_network(config.pose_model)
    depth = None if camera is None else _depth_camera(camera, source)
    return PeoplePipeline(config, camera, depth, network, detector)


def _frame(recorded: Recorded, colour: Picture) -> Frame:
    vehicle = None if recorded.camera is None else recorded.camera.vehicle(_UPRIGHT)
    return Frame(colour, recorded.t_ns, recorded.depth_m, recorded.depth_ns, vehicle)


def _row(number: int, found: Found, in_world: bool) -> Row:
    sight = found.sight
    x, y, width, height = found.box_px
    place = sight.region.camera_p_m
    if in_world:
        place = None if sight.ned_p_m is None else as_vec3(ned_of(sight.ned_p_m))
    box = (float(x), float(y), float(width), float(height))
    return Row(number, found.number, box, float(found.pose.confidence.mean()), place)


def _believed(rows: Sequence[Row], pipeline: PeoplePipeline) -> list[Row]:
    """Rows of people who were believed in the end, the ones before that included."""
    believed = {track.number for track in pipeline.tracks if track.confirmed}
    return [row for row in rows if row.number in believed]


def _note(findings: Findings) -> str:
    if findings.with_depth:
        return f"{len(findings.people)} people"
    return f"{len(findings.people)} people, without depth"


def _opened(out: str | None):  # type: ignore[no-untyped-def]
    """The file to write to; None for standard output. Opened before the work, so that a typo costs none of it."""
    if out is None:
        return None
    try:
        return Path(out).open("w", encoding="utf-8", newline="")
    except OSError as error:
        raise ConfigError(f"--out: cannot write {out!r}: {error.strerror}") from None


def _write(sink, rows: Sequence[Row]) -> None:  # type: ignore[no-untyped-def]
    csv.writer(sink, lineterminator="\n").writerows(row.cells() for row in rows)


def _film(path: str, source: TumSequence | _Video) -> cv2.VideoWriter:
    code = cv2.VideoWriter.fourcc(*("MJPG" if path.lower().endswith(".avi") else "mp4v"))
    writer = cv2.VideoWriter(path, code, source.rate_hz or _DEFAULT_RATE_HZ, (source.width, source.height))
    if not writer.isOpened():
        raise ConfigError(f"--video: cannot write {path!r}; expected a path ending in .mp4 or .avi in a folder")
    return writer


def _progress(done: int, total: int | None) -> None:
    if sys.stderr.isatty() and done % 10 == 0:
        print(f"\r{done} of {total or '?'} pictures", end="", file=sys.stderr, flush=True)


def scores(rows: Sequence[Row], truth: Boxes) -> dict[str, float]:
    """CLEAR MOT and IDF1 of rows against annotated boxes that overlap by half (IoU), by motmetrics.

    Raises:
        ConfigError: motmetrics is not installed.
    """
    try:
        import motmetrics
    except ImportError:
        raise ConfigError("--annotations needs motmetrics: pip install 'outrider[test]'") from None
    accumulator = motmetrics.MOTAccumulator(auto_id=True)
    by_frame: dict[int, list[Row]] = {}
    for row in rows:
        by_frame.setdefault(row.frame, []).append(row)
    for frame in sorted(set(truth) | set(by_frame)):
        there, found = truth.get(frame, {}), by_frame.get(frame, [])
        common = np.array([[iou(box, row.box) for row in found] for box in there.values()])
        distances = np.where(common >= _LEAST_IOU, 1.0 - common, np.nan).reshape(len(there), len(found))
        accumulator.update(list(there), [row.number for row in found], distances)
    names = ["mota", "idf1", "num_misses", "num_false_positives", "num_switches", "num_objects"]
    table = motmetrics.metrics.create().compute(accumulator, metrics=names)
    return {name.removeprefix("num_"): float(table[name].iloc[0]) for name in names}
