"""Configuration of the recorder: `[recorder]`."""

from __future__ import annotations

from typing import Annotated

import msgspec

from common.config import ConfigError, Section


class RecorderConfig(Section, frozen=True, kw_only=True):
    """Where recordings go, and how large they get."""

    enabled: bool = True
    """Whether anything is recorded."""
    folder: str = "recordings"
    """Folder of the recordings, made when missing; relative to the folder that the ground side was started in."""
    segment_mb: Annotated[int, msgspec.Meta(ge=1, le=100_000)] = 1000
    """Size above which a new file begins, 10^6 bytes, 1 to 100,000. 640×480 at 20 Hz makes about 4,000 an hour."""

    def check(self) -> None:
        """Refuse an empty folder name."""
        if not self.folder.strip():
            raise ConfigError("folder: got an empty text, expected the name of a folder")
