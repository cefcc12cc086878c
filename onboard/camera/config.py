"""Configuration of the camera node: `[video]`."""

from __future__ import annotations

from typing import Annotated

import msgspec

from common.config import Section


class VideoConfig(Section, frozen=True, kw_only=True):
    """Where the pictures come from, and what the ground gets of them."""

    source: str = "sim"
    """`sim` for the simulated camera, or the path of a video file or of a folder of images (sorted by name)."""
    loop: bool = True
    """Begin again when a file or folder ends; otherwise the node goes on without pictures and says so."""
    jpeg_quality: Annotated[int, msgspec.Meta(ge=10, le=100)] = 80
    """Quality of the pictures for the ground, 10 to 100."""
    jpeg_rate_hz: Annotated[float, msgspec.Meta(gt=0, le=120)] = 30.0
    """At most so many pictures a second go to the ground, Hz."""
