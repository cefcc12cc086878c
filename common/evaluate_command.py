"""`outrider evaluate`: a track against the truth, as figures and as a plot."""

from __future__ import annotations

import argparse
import json

from common.config import ConfigError
from common.ground_truth import FORMATS, read_ground_truth


def add(sub: argparse._SubParsersAction) -> None:
    """Add the command to the command line."""
    parser = sub.add_parser(
        "evaluate",
        help="Compare a track with the truth",
        description="Compare what `outrider track --out` wrote with boxes drawn by hand: mean overlap (Jaccard), mean "
        "distance over centre, height and width (d4_px) and of the centre alone (centre_px), the share of visible "
        "pictures with an overlap of 0.5 and a distance of at most 50 px (once with each), reports while absent.",
    )
    parser.add_argument("results", metavar="RESULTS.csv", help="what `outrider track` wrote")
    parser.add_argument("truth", metavar="GROUND_TRUTH", help="the true boxes")
    parser.add_argument("--format", choices=FORMATS, default="otb", help="of the true boxes (default: otb)")
    parser.add_argument("--target", type=int, metavar="ID", help="mot: which target, where there are several")
    parser.add_argument("--skip", type=int, default=0, metavar="N", help="leave out the first N pictures")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--plot", metavar="FILE.png", help="draw overlap, distance and success over the pictures")


def run(args: argparse.Namespace) -> int:
    """Run it; returns 0.

    Raises:
        ConfigError: a file that cannot be read or does not fit.
    """
    from common.evaluation import evaluate, read_track  # NumPy and OpenCV, which other commands do without

    if args.skip < 0:
        raise ConfigError(f"--skip: got {args.skip}, expected 0 or more pictures")
    truth = {n: box for n, box in read_ground_truth(args.truth, args.format, args.target).items() if n >= args.skip}
    compared = {name: evaluate(track, truth) for name, track in read_track(args.results).items()}
    figures = {name or "track": one.figures() for name, one in compared.items()}
    if args.json:
        print(json.dumps(figures, indent=2))
    else:
        _print(figures)
    if args.plot:
        from common.evaluation_plot import draw

        draw({name or "track": one for name, one in compared.items()}, args.plot)
    return 0


def _print(figures: dict[str, dict[str, float]]) -> None:
    names = next(iter(figures.values()))
    print(f"{'':22}" + "".join(f"{name:>16}" for name in figures))
    for name in names:
        print(f"{name:22}" + "".join(f"{one[name]:16.3f}" for one in figures.values()))
