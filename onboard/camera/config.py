"""Configuration of the camera node: `[video]`."""

from __future__ import annotations

from typing import Annotated

import msgspec

from common.config import Section


class VideoConfig(Section, frozen=True, kw_only=True):
    """Where the pictures come from, and what the ground gets of them."""

    source: str = "sim"
    """`sim` for the simulated camera; `/dev/video0` or `v4l2:0` for a V4L2 device; `rtsp://…` for a stream; or the path
    of a video file or of a folder of images (in natural order)."""
    latency_ms: Annotated[float, msgspec.Meta(ge=0, le=2000)] = 0.0
    """Time from a live camera's exposure to the arrival of its decoded picture, ms: stamps are moved back by it."""
    loop: bool = True
    """Begin again when a file or folder ends; otherwise the node goes on without pictures and says so."""
    jpeg_quality: Annotated[int, msgspec.Meta(ge=10, le=100)] = 80
    """Quality of the pictures for the ground, 10 to 100."""
    jpeg_rate_hz: Annotated[float, msgspec.Meta(gt=0, le=120)] = 30.0
    """At most so many pictures a second go to the ground, Hz."""
