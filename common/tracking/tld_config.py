"""Settings of the TLD tracker (`[tld]`)."""

from __future__ import annotations

from typing import Annotated

import msgspec

from common.config import Fraction, NonNegative, Positive, Section


class TldConfig(Section, frozen=True, kw_only=True):
    """Tracking, learning, detection."""

    side_px: Annotated[float, msgspec.Meta(ge=16, le=100)] = 30.0
    """Square root of the target's area in the picture that is scanned, px; a larger target is scanned in a smaller
    picture."""
    ferns: Annotated[int, msgspec.Meta(ge=1, le=50)] = 10
    """Ferns of the ensemble (the paper: 10)."""
    bits: Annotated[int, msgspec.Meta(ge=4, le=16)] = 13
    """Comparisons of a fern (the paper: 13)."""
    scale_step: Annotated[float, msgspec.Meta(gt=1.05, lt=2)] = 1.2
    """Factor between two sizes of windows (the paper: 1.2)."""
    scales: Annotated[int, msgspec.Meta(ge=1, le=21)] = 13
    """Sizes of windows, around the first one (the paper: 21)."""
    shift: Annotated[float, msgspec.Meta(gt=0.02, le=0.5)] = 0.1
    """Distance of neighbouring windows, of their shorter side (the paper: 0.1)."""
    found_similarity: Fraction = 0.65
    """Relative similarity above which the detector says that a window is the target (the paper: 0.65)."""
    found_correlation: Fraction = 0.6
    """Least correlation with a known patch of what the detector finds, and of what is learned: while little of the
    background is known, anything is more like the target than like that."""
    valid_similarity: Fraction = 0.55
    """Conservative similarity up from which the tracker's trajectory is valid, and learned from (the paper: 0.65)."""
    seen_similarity: Fraction = 0.45
    """Relative similarity below which the tracker's box counts as not the target."""
    seen_correlation: Fraction = 0.4
    """The same of its correlation with a known patch."""
    valid_correlation: Fraction = 0.75
    """Correlation with a known patch from which a valid trajectory's box is the target, whatever else is like it."""
    flow_error: Positive = 0.2
    """Median forward-backward error above which the flow has failed, target sizes (the paper: 10 px)."""
    max_scale: Annotated[float, msgspec.Meta(gt=1)] = 4.0
    """Bound of the size against the first one, either way."""
    lost_after_s: NonNegative = 1.0
    """Time without the target after which it is called lost, s."""
