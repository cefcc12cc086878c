"""What the fusion is told: its sources, and what they measured."""

from __future__ import annotations

import math
from collections.abc import Sequence
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


def check_measurements(measurements: Sequence[Measurement], sources: Sequence[str], size: int, t_ns: int) -> None:
    """Raise ValueError unless each is of a known source, of which there is one, of this size, finite, and of the past.

    Args:
        measurements: of one step.
        sources: names that are known.
        size: number of components.
        t_ns: the present, ns.
    """
    names = [m.source for m in measurements]
    if len(set(names)) != len(names) or not set(names) <= set(sources):
        raise ValueError(f"measurements: got sources {names}, expected each at most once, of {list(sources)}")
    for m in measurements:
        if m.t_ns > t_ns:
            raise ValueError(f"measurement of {m.source!r}: got stamp {m.t_ns}, expected at most {t_ns}, the present")
        if not math.isfinite(m.confidence):
            raise ValueError(f"measurement of {m.source!r}: got confidence {m.confidence}, expected 0 to 1")
        check_vector(f"measurement of {m.source!r}", m.value, size)


def check_vector(what: str, vector: np.ndarray | None, size: int) -> None:
    """Raise ValueError unless a vector, where there is one, has so many finite components."""
    if vector is not None and (np.shape(vector) != (size,) or not all(map(math.isfinite, np.asarray(vector).tolist()))):
        raise ValueError(f"{what}: got {vector}, expected {size} finite numbers")
