"""Settings of OpenCV's MIL tracker (`[mil]`)."""

from __future__ import annotations

from typing import Annotated

import msgspec

from common.config import Positive, Section


class MilConfig(Section, frozen=True, kw_only=True):
    """The parameters of OpenCV's `TrackerMIL`, which has its own defaults for the others."""

    search_radius_px: Positive = 25.0
    """How far the target may move between two pictures, px."""
    features: Annotated[int, msgspec.Meta(ge=10, le=1000)] = 250
    """Haar features of the classifier."""
