"""`outrider bench`: runs one benchmark, or all of them, and writes what it measured."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from benchmarks import (
    autopilot,
    chase,
    follow,
    fusion,
    fusion_depth,
    fusion_signal,
    fusion_speed,
    latency,
    limiter,
    limiter_encounters,
    limiter_speed,
    people,
    people_association,
    people_boxes,
    people_pose,
    people_speed,
    people_video,
    pursuit,
    pursuit_speed,
)
from benchmarks.base import Benchmark, Outcome, Settings, as_json
from common.arguments import seed
from common.config import ConfigError, unknown_key_text

BENCHMARKS: dict[str, Benchmark] = {
    b.name: b
    for b in (
        latency.BENCHMARK,
        chase.BENCHMARK,
        pursuit.BENCHMARK,
        pursuit_speed.BENCHMARK,
        people.BENCHMARK,
        people_speed.BENCHMARK,
        people_video.BENCHMARK,
        people_pose.BENCHMARK,
        people_association.BENCHMARK,
        people_boxes.BENCHMARK,
        fusion.BENCHMARK,
        fusion_signal.BENCHMARK,
        fusion_depth.BENCHMARK,
        fusion_speed.BENCHMARK,
        follow.BENCHMARK,
        autopilot.BENCHMARK,
        limiter.BENCHMARK,
        limiter_encounters.BENCHMARK,
        limiter_speed.BENCHMARK,
    )
}
_RESULTS = Path("benchmarks/results")


def main(arguments: Sequence[str]) -> int:
    """Run as the arguments say; returns 0 when the run is complete, whatever the figures.

    Raises:
        ConfigError: unknown benchmark.
    """
    parser = argparse.ArgumentParser(prog="outrider bench", description="Run a benchmark and print its figures.")
    parser.add_argument("name", nargs="?", help="benchmark; none runs all and writes benchmarks/results")
    parser.add_argument("--list", action="store_true", help="name the benchmarks")
    parser.add_argument("--seed", type=seed, default=0)
    parser.add_argument("--quick", action="store_true", help="within 60 s: shorter, never easier")
    parser.add_argument("--platform", metavar="NAME", help="follow: uav, pan-tilt or ground; all without it")
    parser.add_argument("--json", type=Path, metavar="FILE")
    parser.add_argument("--plots", type=Path, metavar="DIR")
    parser.add_argument(
        "--sequences",
        type=Path,
        metavar="DIR",
        help="fusion: real sequences too, a folder each: gt.txt, init.txt, video",
    )
    args = parser.parse_args(arguments)
    if args.list:
        for benchmark in BENCHMARKS.values():
            print(f"{benchmark.name:{max(map(len, BENCHMARKS))}}  {benchmark.doc}")
        return 0
    if args.name is not None and args.name not in BENCHMARKS:
        raise ConfigError(f"bench: {unknown_key_text(args.name, BENCHMARKS)}")
    if args.sequences is not None and args.name != "fusion":
        raise ConfigError("--sequences: only `outrider bench fusion` reads real sequences")
    if args.plots is not None:
        args.plots.mkdir(parents=True, exist_ok=True)
    if args.name is None:
        return _run_all(Settings(args.seed, args.quick, _RESULTS))
    settings = Settings(args.seed, args.quick, args.plots, args.sequences, args.platform)
    benchmark = BENCHMARKS[args.name]
    outcome = benchmark.run(settings)
    _print(benchmark, outcome)
    if args.json is not None:
        args.json.write_text(as_json(benchmark, settings, outcome), encoding="utf-8")
    return 0


def _run_all(settings: Settings) -> int:
    _RESULTS.mkdir(parents=True, exist_ok=True)
    for benchmark in BENCHMARKS.values():
        outcome = benchmark.run(settings)
        (_RESULTS / f"{benchmark.name}.json").write_text(as_json(benchmark, settings, outcome), encoding="utf-8")
        _print(benchmark, outcome)
    return 0


def _print(benchmark: Benchmark, outcome: Outcome) -> None:
    print(f"\n{benchmark.name}: {benchmark.doc}")
    for line in outcome.table:
        print(line)
    for name, value in () if outcome.table else outcome.results.items():
        paper = f"   paper {outcome.paper[name]:g}" if name in outcome.paper else ""
        print(f"  {name:32} {value:10.3f}{paper}")
    print(
        "  baseline "
        + ", ".join(f"{k} {v:.3f}" if isinstance(v, float) else f"{k} {v}" for k, v in outcome.baseline.items())
    )
