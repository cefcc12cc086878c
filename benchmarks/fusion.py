"""Success of each member of the fusion alone, and of the fusion, on rendered sequences and on real ones."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from benchmarks.base import Benchmark, Outcome, Settings
from benchmarks.beside import Part, results_of
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
"""Difference of two successes that counts as none."""
_VTEST = Path(__file__).parent / "vtest_person.csv"
_VTEST_QUICK, _ALL = 80, 10**6
_FUSION = "hab-df"
Compared = dict[str, Evaluation]
"""What each tracker was worth on one sequence, by name."""
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


def compare(job: Sequence | _Real, seed: int, options: tuple[str, ...] = ()) -> Compared:
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
    real: list[Sequence | _Real] = [_Real("vtest", None, _VTEST_QUICK if settings.quick else _ALL)]
    if settings.sequences is not None:
        real += _folders(settings.sequences)
    jobs = [*real, *made]
    compared = results_of(compare, [(job, settings.seed) for job in jobs], _done)
    by_name = {job.name: figures for job, figures in zip(jobs, compared, strict=True)}
    return _outcome(
        {job.name: by_name[job.name] for job in made}, {job.name: by_name[job.name] for job in real}, settings
    )


def _folders(root: Path) -> list[_Real]:
    found = sorted(p.parent for p in root.glob("*/gt.txt"))
    if not found:
        raise ConfigError(f"--sequences: no folder with a gt.txt in {str(root)!r}")
    return [_Real(folder.name, folder, _ALL) for folder in found]


def _done(part: Part, figures: Compared) -> str:
    return f"{part[0].name}: fusion {_success(figures[_FUSION]):.3f}"


def _success(one: Evaluation) -> float:
    return one.figures()["success_centre"]


def _lead(one: Compared) -> float:
    """Success of the fusion less that of the best member of the same sequence."""
    return _success(one[_FUSION]) - max(_success(figures) for name, figures in one.items() if name != _FUSION)


def _outcome(made: dict[str, Compared], real: dict[str, Compared], settings: Settings) -> Outcome:
    names = list(next(iter(made.values())))
    means = {name: float(np.mean([_success(one[name]) for one in made.values()])) for name in names}
    best = max((name for name in names if name != _FUSION), key=lambda name: means[name])
    leads = {sequence: _lead(one) for sequence, one in made.items()}
    summary = {
        "fraction_at_least_best_member": float(np.mean([lead >= -_TIE for lead in leads.values()])),
        "margin_over_best_member": means[_FUSION] - means[best],
    }
    results = {f"success_{_word(name)}": mean for name, mean in means.items()} | summary
    for sequence, one in real.items():
        results |= {f"success_{sequence}_{_word(name)}": _success(one[name]) for name in names}
    if settings.plots is not None:
        from benchmarks.fusion_plot import draw

        draw(made, leads, settings.plots / "fusion.png")
    baseline = {"name": f"best member alone, {best}", "success": means[best]}
    return Outcome(results, baseline, table=(*_table(made, real, means), *_summary_lines(summary)))


def _word(name: str) -> str:
    return name.replace("-", "_")


def _table(made: dict[str, Compared], real: dict[str, Compared], means: dict[str, float]) -> Iterator[str]:
    """A line a sequence with the success of each tracker, and one of their means over the rendered ones."""
    yield f"  {'success':26}" + "".join(f"{name:>10}" for name in means) + "    fusion less best"
    for sequence, one in (made | real).items():
        cells = "".join(f"{_success(one[name]):10.3f}" for name in means)
        yield f"  {sequence:26}{cells}{_lead(one):+12.3f}{'' if sequence in made else '   real'}"
    yield f"  {'mean of the rendered':26}" + "".join(f"{mean:10.3f}" for mean in means.values())


def _summary_lines(summary: dict[str, float]) -> Iterator[str]:
    for name, value in summary.items():
        yield f"  {name:34} {value:.3f}"


BENCHMARK = Benchmark("fusion", "each tracker alone and the fusion, on rendered and real sequences", run)
