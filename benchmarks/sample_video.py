"""Debian's sample video vtest.avi: people who walk across a road, seen from a mast."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray


def sample_video() -> Path:
    """Where the package or set-up has put vtest.avi.

    Raises:
        FileNotFoundError: nowhere; the text says how to get it.
    """
    places = (
        Path("/usr/share/doc/opencv-doc/examples/data/vtest.avi"),
        Path(sys.prefix) / "share" / "outrider" / "vtest.avi",
    )
    for place in places:
        if place.is_file():
            return place
    raise FileNotFoundError(f"vtest.avi: expected it at one of {[str(p) for p in places]}; run scripts/setup.sh test")


def sample_frames(numbers: Iterable[int]) -> dict[int, NDArray[np.uint8]]:
    """Pictures (576, 768, 3), BGR, of the given numbers, from 0."""
    wanted = set(numbers)
    video = cv2.VideoCapture(str(sample_video()))
    frames: dict[int, NDArray[np.uint8]] = {}
    for number in range(max(wanted) + 1):
        if not video.grab():
            break
        if number in wanted:
            frames[number] = np.asarray(video.retrieve()[1], np.uint8)
    video.release()
    if wanted - frames.keys():
        raise ValueError(f"{sample_video()}: no picture {min(wanted - frames.keys())}, expected the sample's 795")
    return frames
