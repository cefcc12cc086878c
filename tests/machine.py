"""What the tests use of the machine: found where set-up (`make test`) looks for it and puts it."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path


def sample_video() -> Path:
    """OpenCV's `vtest.avi` (people on a square, 768×576, 10 Hz): Debian's own, or the copy that set-up made.

    Raises:
        FileNotFoundError: set-up has not run.
    """
    places = (Path("/usr/share/doc/opencv-doc/examples/data/vtest.avi"), Path(sys.prefix) / "share/outrider/vtest.avi")
    for place in places:
        if place.is_file():
            return place
    raise FileNotFoundError(f"no sample video: expected one of {[str(p) for p in places]}; run `make test`")


def chromium() -> str:
    """Path of the Chromium or Chrome that browser tests drive.

    Raises:
        FileNotFoundError: there is none on the path.
    """
    names = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
    for name in names:
        if (path := shutil.which(name)) is not None:
            return path
    raise FileNotFoundError(f"no browser: expected one of {', '.join(names)} on the path; run `make test`")
