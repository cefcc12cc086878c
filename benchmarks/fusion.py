"""Success of each member of the fusion alone, and of the fusion, on rendered sequences and on real ones."""

from __future__ import annotations

import csv
import multiprocessing
import os
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from benchmarks.base import Benchmark, Outcome, Settings
from benchmarks.fusion_scene import RATE_HZ, Sequence, sequences
from benchmarks.sample_video import sample_frames
from common.config import ConfigError
from common.evaluation import Evaluation, evaluate
from common.ground_truth import read_ground_truth
from common.processes import load_config
from common.tracking.base import Box, upright_box
from common.tracking.registry import make_tracker
from onboard.fusion.config import HabDfConfig

_FRAMES, _QUICK_FRAMES = 240, 80
_TIE = 0.01
_VTEST = Path(__file__).parent / "vtest_person.csv"
_VTEST_QUICK = 80
_FUSION = "hab-df"
_VIDEOS = (".mpg", ".mpeg", ".avi", ".mp4", ".mkv")


@dataclass(frozen=True)
class _Real:
    """A real sequence: where its pictures and true boxes come from."""

    name: str
    folder: Path | None
    """Of the layout `gt.txt` (x1,y1,x2,y2), `init.txt`, one video; None for vtest.avi."""
    most: int
    """Pictures that are taken."""

    def load(self) -> tuple[Iterator[np.ndarray], dict[int, Box | None], Box]:
        """Its pictures, the true boxes by number from 0, and the first box."""
        if self.folder is None:
            truth = vtest_boxes()
            first = min(truth)
            last = min(max(truth), first + self.most)
            pictures = sample_frames(range(first, last + 1))
            shifted: dict[int, Box | None] = {n - first: box for n, box in truth.items() if n <= last}
            return iter(pictures[n] for n in range(first, last + 1)), shifted, truth[first]
        video = next(p for p in sorted(self.folder.iterdir()) if p.suffix.lower() in _VIDEOS)
        truth = {n: b for n, b in read_ground_truth(str(self.folder / "gt.txt"), "tld").items() if n < self.most}
        first_box = read_ground_truth(str(self.folder / "init.txt"), "tld")[0]
        if first_box is None:
            raise ConfigError(f"--sequences: {self.folder / 'init.txt'}: expected the first box, got none")
        return _video_frames(video, self.most), truth, first_box


def vtest_boxes() -> dict[int, Box]:
    """A person of vtest.avi by picture number: boxes x, y, w, h, px, drawn by hand."""
    lines = [line for line in _VTEST.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    return {
        int(row["frame"]): (float(row["x"]), float(row["y"]), float(row["w"]), float(row["h"]))
        for row in csv.DictReader(lines)
    }


def _video_frames(path: Path, most: int) -> Iterator[np.ndarray]:
    video = cv2.VideoCapture(str(path))
    for _ in range(most):
        ok, frame = video.read()
        if not ok:
            return
        yield np.asarray(frame)


def compare(job: Sequence | _Real, seed: int, options: tuple[str, ...] = ()) -> dict[str, Evaluation]:
    """Each member alone and the fusion over the same pictures, in step; what each was worth against the truth."""
    cv2.setNumThreads(1)
    config = load_config(None, list(options))
    members = config.section(HabDfConfig).members
    # Alone, each has the randomness that it has within the fusion: what differs is the fusion.
    children = np.random.default_rng(seed).spawn(len(members))
    trackers = {name: make_tracker(name, config, child) for name, child in zip(members, children, strict=True)}
    trackers[_FUSION] = make_tracker(_FUSION, config, np.random.default_rng(seed))
    names = tuple(trackers)
    tracks: dict[str, dict[int, Box | None]] = {name: {} for name in names}
    truth: dict[int, Box | None] = {}
    first: Box | None = None
    if isinstance(job, _Real):
        pictures, truth, first = job.load()
        pairs = ((picture, truth.get(number)) for number, picture in enumerate(pictures))
    else:
        pairs = job.pictures()
    for number, (picture, box) in enumerate(pairs):
        t_ns = round(number * 1e9 / RATE_HZ)
        if not isinstance(job, _Real):
            truth[number] = box
        if number == 0:
            first = first or box
            if first is None:
                raise ValueError(f"{job.name}: the target is hidden in the first picture")
            for tracker in trackers.values():
                tracker.init(picture, first, 0.0, 0)
            continue
        for name, tracker in trackers.items():
            answer = tracker.update(picture, t_ns)
            tracks[name][number] = upright_box(answer) if answer.state == "tracking" else None
    scored = {number: box for number, box in truth.items() if number > 0}
    return {name: evaluate(track, scored) for name, track in tracks.items()}


def run(settings: Settings) -> Outcome:
    """Compare them on 14 rendered sequences, the person of vtest.avi, and the real sequences of a folder."""
    frames = _QUICK_FRAMES if settings.quick else _FRAMES
    made: list[Sequence | _Real] = [*sequences(settings.seed, frames)]
    real: list[Sequence | _Real] = [_Real("vtest", None, _VTEST_QUICK if settings.quick else 10**6)]
    if settings.sequences is not None:
        real += _folders(settings.sequences)
    compared = _all_of([*real, *made], settings.seed)
    return _outcome(
        {job.name: compared[job.name] for job in made}, {job.name: compared[job.name] for job in real}, settings
    )


def _folders(root: Path) -> list[_Real]:
    found = sorted(p.parent for p in root.glob("*/gt.txt"))
    if not found:
        raise ConfigError(f"--sequences: no folder with a gt.txt in {str(root)!r}")
    return [_Real(folder.name, folder, 10**6) for folder in found]


def _all_of(jobs: list[Sequence | _Real], seed: int) -> dict[str, dict[str, Evaluation]]:
    compared = {}
    with ProcessPoolExecutor(min(os.cpu_count() or 1, 8), multiprocessing.get_context("spawn")) as pool:
        waiting = {pool.submit(compare, job, seed): job for job in jobs}
        for done, future in enumerate(as_completed(waiting), 1):
            compared[waiting[future].name] = future.result()
            _show(done, len(jobs))
    return compared


def _show(done: int, total: int) -> None:
    """A bar on a terminal, a line a sequence elsewhere."""
    if sys.stderr.isatty():
        bar = "#" * (40 * done // total)
        print(f"\r  [{bar:40}] {done} sequences", end="\n" if done == total else "", file=sys.stderr, flush=True)
    else:
        print(f"  {done} of {total} sequences", file=sys.stderr, flush=True)


def _success(one: Evaluation) -> float:
    return one.figures()["success_centre"]


def _outcome(
    made: dict[str, dict[str, Evaluation]], real: dict[str, dict[str, Evaluation]], settings: Settings
) -> Outcome:
    names = list(next(iter(made.values())))
    members = [name for name in names if name != _FUSION]
    means = {name: float(np.mean([_success(one[name]) for one in made.values()])) for name in names}
    best = max(members, key=lambda name: means[name])
    margins = {
        sequence: _success(one[_FUSION]) - max(_success(one[m]) for m in members) for sequence, one in made.items()
    }
    results = {f"success_{name.replace('-', '_')}": mean for name, mean in means.items()}
    results["fraction_at_least_best_member"] = float(np.mean([m >= -_TIE for m in margins.values()]))
    results["margin_over_best_member"] = means[_FUSION] - means[best]
    for sequence, one in real.items():
        for name in names:
            results[f"success_{sequence}_{name.replace('-', '_')}"] = _success(one[name])
    table = [f"  {'success':26}" + "".join(f"{name:>10}" for name in names) + "    fusion less best"]
    for sequence, one in (made | real).items():
        cells = "".join(f"{_success(one[name]):10.3f}" for name in names)
        lead = _success(one[_FUSION]) - max(_success(one[m]) for m in members)
        kind = "" if sequence in made else "   real"
        table.append(f"  {sequence:26}{cells}{lead:+12.3f}{kind}")
    table.append(f"  {'mean of the rendered':26}" + "".join(f"{means[name]:10.3f}" for name in names))
    for name in ("fraction_at_least_best_member", "margin_over_best_member"):
        table.append(f"  {name:34} {results[name]:.3f}")
    if settings.plots is not None:
        from benchmarks.fusion_plot import draw

        draw(made, margins, settings.plots / "fusion.png")
    return Outcome(results, {"name": f"best member alone, {best}", "success": means[best]}, table=tuple(table))


BENCHMARK = Benchmark("fusion", "each tracker alone and the fusion, on rendered and real sequences", run)
