"""Pictures from files: a video, or a folder of images, one after another."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from common.config import ConfigError

Frame = NDArray[np.uint8]
log = logging.getLogger(__name__)

IMAGE_ENDINGS = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".webp")


class FileSource:
    """Reads frames one after another from a video file or an image folder.

    Args:
        path: the file, or the folder, whose images are read in natural order (2 before 10).
        loop: begin again at the end.
        option: what named the path, for the errors' texts.

    Raises:
        ConfigError: it does not exist, holds no picture, or cannot be decoded.
    """

    def __init__(self, path: str, loop: bool, option: str = "video.source"):
        self._path = Path(path)
        self._loop = loop
        self._video: cv2.VideoCapture | None = None
        self._files: list[Path] = []
        self._index = 0
        self.corrupt = 0
        """Pictures that could not be decoded and were skipped."""
        self.resized = 0
        """Pictures of another size than the first, brought to that."""
        self.missing = 0
        """Pictures that a video announces beyond the one after which decoding stopped; known at its end."""
        if self._path.is_dir():
            self._files = sorted(
                (p for p in self._path.iterdir() if p.suffix.lower() in IMAGE_ENDINGS), key=lambda p: _natural(p.name)
            )
            if not self._files:
                raise ConfigError(
                    f"{option}: folder {path!r} holds no image, expected files ending in {', '.join(IMAGE_ENDINGS)}"
                )
        elif self._path.is_file():
            self._video = cv2.VideoCapture(str(self._path))
        else:
            raise ConfigError(f"{option}: got {path!r}, which does not exist; expected a video file or an image folder")
        first = self._read()
        if first is None:
            raise ConfigError(f"{option}: {path!r} cannot be decoded; expected a video or images that OpenCV reads")
        self.height, self.width = first.shape[:2]
        rate = self._video.get(cv2.CAP_PROP_FPS) if self._video is not None else 0.0
        self.rate_hz: float | None = rate if 1.0 <= rate <= 240.0 else None
        """The file's own rate, Hz; None when it has none."""
        self._rewind()

    @property
    def count(self) -> int | None:
        """Number of pictures, as far as the file knows; None when it does not say."""
        if self._video is None:
            return len(self._files)
        count = int(self._video.get(cv2.CAP_PROP_FRAME_COUNT))
        return count if count > 0 else None

    def next(self) -> Frame | None:
        """Next frame (height, width, 3), BGR; None at the end, or for a picture that cannot be decoded."""
        frame = self._read()
        if frame is None and self._at_end() and self._loop:
            self._rewind()
            frame = self._read()
        return None if frame is None else self._sized(frame)

    def frames(self) -> Iterator[Frame | None]:
        """Every frame to the end, once; None for a picture that cannot be decoded."""
        while True:
            frame = self._read()
            if frame is None and (self._video is not None or self._index > len(self._files)):
                return
            yield None if frame is None else self._sized(frame)

    def close(self) -> None:
        """Release the file."""
        if self._video is not None:
            self._video.release()

    def _sized(self, frame: Frame) -> Frame:
        """Trackers and calibration hold for one size; what has another is brought to the first one's."""
        height, width = frame.shape[:2]
        if (height, width) != (self.height, self.width):
            if self.resized == 0:
                log.warning(
                    "%s: picture %d has %dx%d px, the first one %dx%d: this and others like it are scaled to fit",
                    self._path,
                    self._index - 1,
                    width,
                    height,
                    self.width,
                    self.height,
                )
            self.resized += 1
            frame = cv2.resize(frame, (self.width, self.height))  # type: ignore[assignment]
        return np.ascontiguousarray(frame, dtype=np.uint8)

    def _read(self) -> Frame | None:
        self._index += 1
        if self._video is not None:
            ok, frame = self._video.read()
            if not ok:
                self._judge_end(self._index - 1)
            return frame if ok else None  # type: ignore[return-value]
        if self._index > len(self._files):
            return None
        frame = cv2.imread(str(self._files[self._index - 1]), cv2.IMREAD_COLOR)
        self.corrupt += frame is None
        return frame  # type: ignore[return-value]

    def _judge_end(self, got: int) -> None:
        """Say once, in one line, that a video ends before it should."""
        expected = self.count
        # Some containers tell their length only by duration and rate, which may be off by one.
        if expected is not None and got < expected - 1 and got > 0 and self.missing == 0:
            self.missing = expected - got
            log.warning(
                "%s: got %d pictures, expected %d as the file announces: it is cut short or damaged there; "
                "record or copy it again",
                self._path,
                got,
                expected,
            )

    def _at_end(self) -> bool:
        return self._video is not None or self._index > len(self._files)

    def _rewind(self) -> None:
        self._index = 0
        if self._video is not None:
            self._video.release()
            # Seeking back is unreliable for some containers; opening anew is not.
            self._video = cv2.VideoCapture(str(self._path))


def _natural(name: str) -> list[tuple[int, int, str]]:
    """Sorting key that takes runs of digits as numbers."""
    return [(0, int(part), "") if part.isdigit() else (1, 0, part) for part in re.findall(r"\d+|\D+", name)]
