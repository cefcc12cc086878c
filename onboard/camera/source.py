"""Pictures from files: a video, or a folder of images, at their own rate."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from common.config import ConfigError

Frame = NDArray[np.uint8]

IMAGE_ENDINGS = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".webp")


class FileSource:
    """Reads frames one after another from a video file or an image folder.

    Args:
        path: the file or folder.
        loop: begin again at the end.

    Raises:
        ConfigError: it does not exist, holds no picture, or cannot be decoded.
    """

    def __init__(self, path: str, loop: bool):
        self._path = Path(path)
        self._loop = loop
        self._video: cv2.VideoCapture | None = None
        self._files: list[Path] = []
        self._index = 0
        self.corrupt = 0
        """Pictures that could not be decoded and were skipped."""
        if self._path.is_dir():
            self._files = sorted(p for p in self._path.iterdir() if p.suffix.lower() in IMAGE_ENDINGS)
            if not self._files:
                raise ConfigError(
                    f"video.source: folder {path!r} holds no image, expected files ending in {', '.join(IMAGE_ENDINGS)}"
                )
        elif self._path.is_file():
            self._video = cv2.VideoCapture(str(self._path))
        else:
            raise ConfigError(
                f"video.source: got {path!r}, which does not exist; expected 'sim', a video file or an image folder"
            )
        first = self._read()
        if first is None:
            raise ConfigError(f"video.source: {path!r} cannot be decoded; expected a video or images that OpenCV reads")
        self.height, self.width = first.shape[:2]
        rate = self._video.get(cv2.CAP_PROP_FPS) if self._video is not None else 0.0
        self.rate_hz: float | None = rate if 1.0 <= rate <= 240.0 else None
        """The file's own rate, Hz; None when it has none."""
        self._rewind()

    def next(self) -> Frame | None:
        """Next frame (height, width, 3), BGR; None at the end, or for a picture that cannot be decoded."""
        frame = self._read()
        if frame is None and self._at_end() and self._loop:
            self._rewind()
            frame = self._read()
        if frame is None:
            return None
        if frame.shape[:2] != (self.height, self.width):
            # Trackers and calibration hold for one size; a folder of mixed sizes is brought to the first one's.
            frame = cv2.resize(frame, (self.width, self.height))
        return np.ascontiguousarray(frame, dtype=np.uint8)

    def close(self) -> None:
        """Release the file."""
        if self._video is not None:
            self._video.release()

    def _read(self) -> Frame | None:
        if self._video is not None:
            ok, frame = self._video.read()
            self._index += 1 if ok else 0
            return frame if ok else None  # type: ignore[return-value]
        if self._index >= len(self._files):
            return None
        frame = cv2.imread(str(self._files[self._index]), cv2.IMREAD_COLOR)
        self._index += 1
        self.corrupt += frame is None
        return frame  # type: ignore[return-value]

    def _at_end(self) -> bool:
        return self._video is not None or self._index >= len(self._files)

    def _rewind(self) -> None:
        self._index = 0
        if self._video is not None:
            self._video.release()
            # Seeking back is unreliable for some containers; opening anew is not.
            self._video = cv2.VideoCapture(str(self._path))
