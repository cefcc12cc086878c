"""What the fusion is told: its sources, and what they measured."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Source:
    """One source of measurements: a sensor, or a tracker."""

    name: str
    """Its name, of which there is one."""
    noise: tuple[float, ...]
    """Standard deviation of each component while nothing is wrong, units."""
    threshold: float = 0.0
    """Its own confidence below which it is unsure (a larger Δ in eq. 4.8)."""
    vouches: float = 1.0
    """How far its word alone shows that the target is seen, 0 to 1: less for one that cannot tell when it is lost."""
    delta: float | None = None
    """Δ of eq. 4.8 for it; None takes the common one."""
    omega: float | None = None
    """ω of eq. 4.7 for it; None takes the common one."""

    def __post_init__(self) -> None:
        if not self.noise or not all(math.isfinite(s) and s > 0 for s in self.noise):
            raise ValueError(f"source {self.name!r}: noise: got {self.noise}, expected positive standard deviations")


@dataclass(frozen=True)
class Measurement:
    """What one source says of one instant."""

    source: str
    """Name of the source."""
    t_ns: int
    """When it was captured, ns, however late it arrives."""
    value: np.ndarray | None
    """The vector, (N,), or None: the source says that it has lost the target."""
    confidence: float = 1.0
    """The source's own, 0 to 1."""


@dataclass(frozen=True)
class Judgement:
    """How one source was judged in a step."""

    reliability: float
    """Fault-free variance over that of eq. 4.8, mean over the components: 1 trusted, 0 ignored."""
    mahalanobis: float
    """M of eq. 4.3 against its own expert."""
    outlier: float
    """w_M of eq. 4.4."""
    distance: float
    """Distance to the nearest voter, units (eqs 4.5, 4.6); infinite without another."""
    vote: float
    """w_d of eq. 4.7."""
    variance: np.ndarray = field(repr=False)
    """Diagonal (N,) of R_vv, eq. 4.8, in measurement units squared; the source counts with it, less still while it
    hesitates."""
