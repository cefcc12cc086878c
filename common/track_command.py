"""The command line of `outrider track`."""

from __future__ import annotations

import argparse

from common.arguments import seed
from common.config import Config


def add(sub: argparse._SubParsersAction) -> argparse.ArgumentParser:
    """Add the command to the command line; returns its parser."""
    track = sub.add_parser(
        "track",
        help="Run a tracker alone over a video or a folder of images",
        description="Track one target through a video file or a folder of images (in natural order) and write where "
        "it is as CSV: frame (from 0), x, y, w, h (upright box of the target, px; empty when lost), angle_deg, score "
        "(0 to 1), state (tracking, lost, reacquired).",
    )
    track.add_argument("source", metavar="SOURCE", help="video file or image folder")
    which = track.add_mutually_exclusive_group()
    which.add_argument(
        "--tracker",
        metavar="NAME",
        default="pursuit",
        help="pursuit, dsst, cmt, struck, tld, mil, nano and vit (networks, with your model files), or hab-df, which "
        "fuses several (default: pursuit)",
    )
    which.add_argument(
        "--all", action="store_true", dest="side_by_side", help="each member of hab-df alone, and hab-df, side by side"
    )
    begin = track.add_mutually_exclusive_group(required=True)
    begin.add_argument("--init", metavar="X,Y,W,H", help="the target's box in the first picture, px")
    begin.add_argument("--model", metavar="IMAGE", help="a picture of the target, which it fills; it is searched for")
    track.add_argument("--init-frame", type=int, default=0, metavar="N", help="picture that the box is in, from 0")
    track.add_argument("--out", metavar="FILE.csv", help="where to write the CSV (default: standard output)")
    track.add_argument("--video", metavar="FILE.mp4", help="write the pictures with the target drawn on them")
    track.add_argument("--rate", type=float, metavar="HZ", help="pictures a second (default: the video's, or 25)")
    track.add_argument("--seed", type=seed, default=1, help="seed of the tracker's randomness")
    return track


def run(args: argparse.Namespace, config: Config) -> int:
    """Run it; returns the exit code."""
    from common import track_tool  # with its compiled code it costs every other command half a second

    job = track_tool.TrackJob(
        source=args.source,
        tracker=args.tracker,
        init=None if args.init is None else track_tool.parse_box(args.init),
        init_frame=args.init_frame,
        model=args.model,
        rate_hz=args.rate,
        seed=args.seed,
    )
    if args.side_by_side:
        from common import track_side_by_side

        return track_side_by_side.run(job, config, args.out, args.video)
    return track_tool.run(job, config, args.out, args.video)
