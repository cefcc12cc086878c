"""Settings of the correlation-filter tracker (`[dsst]`)."""

from __future__ import annotations

from typing import Annotated

import msgspec

from common.config import Fraction, NonNegative, Positive, Section


class DsstConfig(Section, frozen=True, kw_only=True):
    """DSST with a failure measure and re-detection. Tuned on a face, a pedestrian and a car of 20 to 60 px."""

    padding: Annotated[float, msgspec.Meta(gt=1, le=4)] = 2.5
    """Side of the searched window over the target's."""
    window_cells: Annotated[int, msgspec.Meta(ge=12, le=64)] = 26
    """Side of a square window of the filter's size, cells of 4 px."""
    spread: Positive = 0.08
    """Width of the wanted peak, target sizes."""
    learning_rate: Fraction = 0.02
    """Share of a new picture in the place filter."""
    scale_learning_rate: Fraction = 0.02
    """The same of the size filter."""
    regularisation: Positive = 0.01
    """λ of both filters."""
    scales: Annotated[int, msgspec.Meta(ge=3, le=65)] = 17
    """Sizes that are compared (the paper: 33)."""
    scale_step: Annotated[float, msgspec.Meta(gt=1, lt=1.2)] = 1.03
    """Factor between two neighbours (the paper: 1.02)."""
    max_scale: Annotated[float, msgspec.Meta(gt=1)] = 4.0
    """Bound of the size against the first one, either way."""
    psr_limit: Positive = 18.0
    """Peak-to-sidelobe ratio below which the target counts as not seen."""
    similarity_limit: Fraction = 0.42
    """Relative similarity below which it counts as not seen."""
    found_similarity: Fraction = 0.62
    """Relative similarity above which a search has found it (TLD: 0.65)."""
    found_correlation: Fraction = 0.6
    """Least correlation with a known patch of what a search finds."""
    patience: Annotated[int, msgspec.Meta(ge=0)] = 3
    """Pictures without the target after which it is searched in the whole picture."""
    lost_after_s: NonNegative = 1.0
    """Time without the target after which it is called lost, s."""
