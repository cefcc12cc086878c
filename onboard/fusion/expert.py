"""One source's own filter, which tells an outlier from a measurement (Echeverri 2016, section 4.2.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from onboard.fusion.config import FusionConfig
from onboard.fusion.motion import MotionFilter
from onboard.fusion.source import Source
from onboard.fusion.weights import mahalanobis, outlier_switch, outlier_weight, severity


@dataclass(frozen=True)
class Opinion:
    """What an expert thinks of its source's newest measurement."""

    value: np.ndarray
    """The measurement, (N,)."""
    t_ns: int
    """Its stamp, ns."""
    mahalanobis: float
    """M of eq. 4.3."""
    weight: float
    """w_M of eq. 4.4."""
    penalty: float
    """Δ w_M over ω₀, times its severity: variance that it adds, in fault-free variances."""
    sure: bool
    """Whether the source's own confidence was at its threshold or above."""
    base: np.ndarray
    """Fault-free variance of its source, (N,), measurement units squared."""
    begins: bool
    """Whether its source has no past that could foresee it."""
    hesitation: float
    """How near to its threshold it was, 0 to 1: 1 at it or below, 0 clearly above."""


class Expert:
    """Kalman filter of one source, robust against its outliers.

    Args:
        source: whose.
        config: parameters.
    """

    def __init__(self, source: Source, config: FusionConfig):
        self.source = source
        self.filter: MotionFilter | None = None
        """None until the first measurement, and after a long silence."""
        self._config = config
        self._noise = np.array(source.noise)
        self._switch = outlier_switch(len(source.noise), config.outlier_confidence)

    @property
    def t_ns(self) -> int | None:
        """Stamp of its newest measurement, ns."""
        return None if self.filter is None else self.filter.t_ns

    def forget(self) -> None:
        """Begin anew with the next measurement: the source was started again, or elsewhere."""
        self.filter = None

    def jump(self, value: np.ndarray) -> None:
        """Go on from a measurement (N,) that was an outlier to its past and is none: others saw the same."""
        if self.filter is not None:
            self.filter.move(value)

    def hear(
        self,
        value: np.ndarray,
        t_ns: int,
        confidence: float,
        unit: np.ndarray,
        density: np.ndarray,
        control: np.ndarray | None = None,
    ) -> Opinion:
        """Judge a measurement against the prediction, and take it in with the weight that it deserves.

        It does not reject an outlier for good, since the target may really have jumped: its covariance grows with time,
        M falls, and it then accepts.

        Args:
            value: measurement, (N,).
            t_ns: its stamp, ns, not before the one before.
            confidence: the source's own, 0 to 1.
            unit: size of one unit in the measurement's components, (N,).
            density: spectral density of the model's acceleration, (N,), measurement units²/s³.
            control: known acceleration, (N,), measurement units/s².
        """
        config, base = self._config, (self._noise * unit) ** 2
        begins = self.filter is None or t_ns - self.filter.t_ns > config.forget_after_s * 1e9
        if self.filter is None or begins:
            self.filter = MotionFilter(value, t_ns, np.sqrt(base), config.start_rate * unit)
        self.filter.predict(t_ns, density, control)
        distance = mahalanobis(*self.filter.innovation(value, base))
        weight = outlier_weight(distance, config.outlier_zeta / self._switch, config.outlier_zeta)
        penalty = self._delta(confidence) / config.omega_0 * weight
        if confidence < self.source.threshold:
            # The filter of a lost tracker has followed it: M is small, and Δ alone would change nothing.
            penalty = max(penalty, 0.5 * self._delta(confidence) / config.omega_0)
        penalty *= severity(distance / self._switch)
        if not begins:
            self.filter.update(value, base * (1.0 + penalty))
        return Opinion(
            value, t_ns, distance, weight, penalty, confidence >= self.source.threshold, base, begins,
            self._hesitation(confidence),
        )  # fmt: skip

    def _hesitation(self, confidence: float) -> float:
        above = (confidence - self.source.threshold) / self._config.clearly_above
        return 0.0 if self.source.threshold == 0.0 else min(1.0, max(0.0, 1.0 - above))

    def _delta(self, confidence: float) -> float:
        if confidence < self.source.threshold:
            return self._config.delta_unsure
        return self._config.delta if self.source.delta is None else self.source.delta
