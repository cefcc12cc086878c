"""Settings of the structured-output tracker (`[struck]`)."""

from __future__ import annotations

from typing import Annotated

import msgspec

from common.config import Fraction, NonNegative, Positive, Section


class StruckConfig(Section, frozen=True, kw_only=True):
    """Structured-output support vector machine with a budget."""

    reach: Annotated[float, msgspec.Meta(gt=0.1, le=2)] = 0.8
    """How far the target may move between two pictures, target sizes."""
    budget: Annotated[int, msgspec.Meta(ge=10, le=500)] = 80
    """Most support vectors (the paper: 100)."""
    cost: Positive = 100.0
    """C (the paper: 100)."""
    kernel: Positive = 1.5
    """γ of the kernel exp(-γ |x - x'|²) of features of unit length."""
    reprocessed: Annotated[int, msgspec.Meta(ge=0, le=20)] = 4
    """Steps over old patterns after each new one (the paper: 10)."""
    optimised: Annotated[int, msgspec.Meta(ge=0, le=20)] = 10
    """Steps over known support vectors after each of them (the paper: 10)."""
    scale_step: Annotated[float, msgspec.Meta(gt=1, lt=1.2)] = 1.04
    """Factor between two of the sizes that are compared."""
    scale_damping: Fraction = 0.5
    """Share of a change of size that is taken at once."""
    max_scale: Annotated[float, msgspec.Meta(gt=1)] = 4.0
    """Bound of the size against the first one, either way."""
    seen_share: Fraction = 0.5
    """Discriminant over its usual value below which the target counts as not seen."""
    learn_share: Fraction = 0.65
    """That ratio up from which a picture is learned."""
    found_share: Fraction = 0.7
    """That ratio up from which a search has found it."""
    patience: Annotated[int, msgspec.Meta(ge=0)] = 3
    """Pictures without the target after which it is searched in the whole picture."""
    lost_after_s: NonNegative = 1.0
    """Time without the target after which it is called lost, s."""
