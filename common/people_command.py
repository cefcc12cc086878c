"""The command line of `outrider people`."""

from __future__ import annotations

import argparse
import math

from common.config import Config, ConfigError, load_object


def add(sub: argparse._SubParsersAction) -> argparse.ArgumentParser:
    """Add the command to the command line; returns its parser."""
    people = sub.add_parser(
        "people",
        help="Find people in recorded RGB-D pictures, or in a video",
        description="Find people in a folder of RGB-D pictures in TUM's layout (rgb.txt, depth.txt), or without depth "
        "in a video file or image folder, where a person detector says where to look: --set people.detector.file=F "
        "--set people.detector.decoder=yolo, or the one that `scripts/setup.sh detector` fetches. Writes the "
        "MOTChallenge's CSV: frame (from 1), number, left, top, width, height, confidence, and x, y, z, m (-1 without "
        "depth): in the camera's optical frame, or in the world of the folder's groundtruth.txt.",
    )
    people.add_argument("source", metavar="SOURCE", help="folder with rgb.txt, video file, or image folder")
    people.add_argument("--out", metavar="FILE.csv", help="where to write the CSV (default: standard output)")
    people.add_argument("--video", metavar="FILE.mp4", help="write the pictures with the people drawn on them")
    people.add_argument(
        "--intrinsics",
        metavar="FX,FY,CX,CY",
        help="of the pictures, to which depth is registered, px; needed for depth",
    )
    people.add_argument(
        "--depth-scale", type=float, default=5000.0, metavar="N", help="depth units in a metre (default: 5000, TUM's)"
    )
    people.add_argument("--rate", type=float, metavar="HZ", help="pictures a second of a video or image folder")
    people.add_argument(
        "--annotations", metavar="FILE.xml", help="CAVIAR's annotations of the same pictures: print how well they agree"
    )
    return people


def run(args: argparse.Namespace, config: Config) -> int:
    """Run it; returns the exit code.

    Raises:
        ConfigError: anything that cannot be used as given.
    """
    for name, value in (("--depth-scale", args.depth_scale), ("--rate", args.rate)):
        if value is not None and not 0.0 < value < math.inf:
            raise ConfigError(f"{name}: got {value:g}, expected a number above 0")
    intrinsics = None
    if args.intrinsics is not None:
        try:
            fx, fy, cx, cy = (float(part) for part in args.intrinsics.split(","))
        except ValueError:
            raise ConfigError(f"--intrinsics: got {args.intrinsics!r}, expected FX,FY,CX,CY in px") from None
        if not (0.0 < fx < math.inf and 0.0 < fy < math.inf and math.isfinite(cx) and math.isfinite(cy)):
            raise ConfigError(f"--intrinsics: got {args.intrinsics!r}, expected focal lengths above 0")
        intrinsics = (fx, fy, cx, cy)
    return load_object("onboard.people.recorded:run")(args, intrinsics, config)
