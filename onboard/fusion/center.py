"""Hierarchical adaptive Bayesian data fusion of any vector from any number of sources (Echeverri 2016, chapter 4).

Below, one expert a source judges each measurement by itself; above, the fusion centre weighs it by that judgement and
by the vote of all sources. The thesis hands the experts' estimates to the centre; here the centre takes the
measurements themselves, with the variance of eq. 4.8: filtering twice would count each expert's memory twice, and lag.
A measurement that arrives late entered its expert at its own capture time and is carried to the present by that expert.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from onboard.fusion.config import FusionConfig
from onboard.fusion.drift import DriftWatch
from onboard.fusion.expert import Expert, Opinion
from onboard.fusion.motion import MotionFilter
from onboard.fusion.source import Judgement, Measurement, Source, check_measurements, check_vector
from onboard.fusion.vote import ALIKE, Vote
from onboard.fusion.weights import combine, severity, vote_weight

FusionState = Literal["waiting", "tracking", "predicted", "lost"]
_ONE_SOURCE = 0.7
"""Confidence that one fully reliable source alone gives; two give 0.91."""
SEVERAL = 0.8
"""Confidence above which several spoke for the answer a moment ago."""
_SUSPECT = 0.05
"""w_M from which a measurement counts as an outlier to its own past: well below one half it already weighs less."""
_TYPICAL, _MOST_AGILE = 0.8, 10.0
"""Mean of eq. 4.3 over the number of components while nothing is wrong; and largest factor on the acceleration."""


@dataclass(frozen=True)
class Fused:
    """The fused answer."""

    t_ns: int
    """The instant that it is for, ns."""
    state: FusionState
    """`waiting`: nothing measured yet. `tracking`: some source is trusted. `predicted`: none, for a short time. `lost`:
    none for long; the value is predicted on."""
    value: np.ndarray
    """Fused vector, (N,); NaN while waiting."""
    rate: np.ndarray
    """Its rates, (N,), units/s."""
    covariance: np.ndarray
    """Covariance of value and rate, (2N, 2N)."""
    confidence: float
    """The fusion's own, 0 to 1: that not every source that speaks for it is wrong."""
    sources: Mapping[str, Judgement]
    """How each source with a new measurement was judged."""
    restart: tuple[str, ...]
    """Sources that have drifted, or are lost, and should be started anew on the fused answer now."""


class Fusion:
    """Experts, vote and fusion centre.

    Args:
        sources: at least one, all of the same number of components; their order changes nothing.
        config: parameters.

    Raises:
        ValueError: no source, two of one name, or different numbers of components.
    """

    def __init__(self, sources: Sequence[Source], config: FusionConfig):
        names = [source.name for source in sources]
        sizes = {len(source.noise) for source in sources}
        if not sources or len(set(names)) != len(names) or len(sizes) != 1:
            raise ValueError(
                f"fusion: got sources {names} with {sorted(sizes)} components, expected one or more of different names "
                "and one number of components"
            )
        # In the order of the names, so that even rounding does not depend on the order in which they are given.
        self._experts = {name: Expert(source, config) for name, source in sorted(zip(names, sources, strict=True))}
        self._drift = {name: DriftWatch(config) for name in self._experts}
        self._lost = dict.fromkeys(self._experts, False)
        self._vouches = {name: expert.source.vouches for name, expert in self._experts.items()}
        self._vote = Vote(self._vouches, config)
        self._followed: set[str] = set()
        self._agility = 1.0
        self._density = np.zeros(0)
        self._switch = config.vote_lambda / config.vote_slope
        self._config = config
        self._size = sizes.pop()
        self._center: MotionFilter | None = None
        self._seen_ns = 0
        self._supported = False
        self._t_ns: int | None = None
        self._elapsed_s = 0.0
        self._confidence = 0.0
        self.unit = np.ones(self._size)
        """Size of one unit in the measurement's components, (N,): 1, or the target's size in px."""
        self.outdated = 0
        """Measurements that were older than their source's newest one, and ignored."""

    def forget(self, name: str, *, follow: bool = False) -> None:
        """The source of this name was started anew: what its expert knew of it no longer holds.

        Args:
            name: of the source.
            follow: whether the answer is to go where it says next, however far that is: somebody vouches for it.
        """
        self._experts[name].forget()
        if follow:
            self._followed.add(name)
        self._lost[name] = False
        self._vote.restore(name)

    def vouch(self, name: str) -> None:
        """Somebody knows that the source of this name is right: that it agreed with nobody is not held against it."""
        self._vote.restore(name)

    def step(self, measurements: Sequence[Measurement], t_ns: int, control: np.ndarray | None = None) -> Fused:
        """Fused answer for an instant from what has arrived since the last one.

        Args:
            measurements: any number, in any order; at most one a source.
            t_ns: the instant, ns, not before the last one nor before a measurement.
            control: known acceleration of the measured vector by the platform's own commands (B·u), (N,), units/s².

        Raises:
            ValueError: unknown source, two measurements of one, wrong shape, no finite number, or a stamp from the
                future or the past; nothing is changed then.
        """
        if self._t_ns is not None and t_ns < self._t_ns:
            raise ValueError(f"t_ns: got {t_ns}, expected at least the last instant, {self._t_ns}")
        check_measurements(measurements, list(self._experts), self._size, t_ns)
        check_vector("control", control, self._size)
        self._elapsed_s = 0.0 if self._t_ns is None else (t_ns - self._t_ns) * 1e-9
        self._t_ns = t_ns
        self._agility = 1.0 + (self._agility - 1.0) * math.exp(-self._elapsed_s / self._config.agility_memory_s)
        self._density = (self._config.acceleration * self._agility * self.unit) ** 2
        self._confidence *= math.exp(-self._elapsed_s / self._config.confidence_memory_s)
        opinions = self._hear(measurements, control)
        if self._center is not None:
            self._center.predict(t_ns, self._density, control)
        judgements = self._judge(opinions, t_ns)
        self._fuse(opinions, judgements, t_ns)
        if measurements:
            self._support(judgements, t_ns)
        return self._report(judgements, t_ns)

    def _hear(self, measurements: Sequence[Measurement], control: np.ndarray | None) -> dict[str, Opinion]:
        opinions = {}
        for m in sorted(measurements, key=lambda m: m.source):
            expert = self._experts[m.source]
            if expert.t_ns is not None and m.t_ns < expert.t_ns:
                self.outdated += 1
                continue
            self._lost[m.source] = m.value is None
            if m.value is not None:
                value = np.asarray(m.value, float)
                opinions[m.source] = expert.hear(value, m.t_ns, m.confidence, self.unit, self._density, control)
        return opinions

    def _judge(self, opinions: Mapping[str, Opinion], t_ns: int) -> dict[str, Judgement]:
        """Vote and variance (eq. 4.8) of each source that has something new to say."""
        config = self._config
        jumped = self._jumped_together(opinions)
        distances = self._distances(t_ns)
        judgements = {}
        for name, opinion in opinions.items():
            expert = self._experts[name]
            omega = config.omega if expert.source.omega is None else expert.source.omega
            vote, penalty = config.omega_0, 0.0
            if math.isfinite(distances[name]):
                vote = vote_weight(distances[name], config.omega_0, omega, config.vote_slope, config.vote_lambda)
                far = severity(distances[name] / self._switch)
                penalty = (vote - config.omega_0) / config.omega_0 * far
            hesitant = 1.0 + config.delta_hesitant / config.omega_0 * opinion.hesitation**2
            factor = 1.0 + penalty + (0.0 if name in jumped else opinion.penalty)
            judgements[name] = Judgement(
                1.0 / factor,
                opinion.mahalanobis,
                opinion.weight,
                distances[name],
                vote,
                opinion.base * (factor * hesitant),
            )
        return judgements

    def _jumped_together(self, opinions: Mapping[str, Opinion]) -> set[str]:
        """Sources whose measurements are outliers to their own pasts, or have none, and agree with one another.

        Beyond the thesis: what two or more see alike, each sure of itself, is a jump of the target or of the camera,
        not a fault. Their experts and the centre go on from there, and from a source that is to be followed.
        """
        if not self._config.common_jumps:
            return set()
        outliers = [n for n, o in opinions.items() if o.weight > _SUSPECT and o.sure]
        witnesses = [n for n, o in opinions.items() if (o.weight > _SUSPECT or o.begins) and o.sure]
        alike = [
            {name, other}
            for name in outliers
            for other in witnesses
            if name != other
            and np.linalg.norm((opinions[name].value - opinions[other].value) / self.unit) < ALIKE * self._switch
        ]
        # What several saw jump will jump again: a shaken camera, a target that turns on its heel.
        jumps = [min(opinions[name].mahalanobis for name in pair) / (_TYPICAL * self._size) for pair in alike]
        self._agility = min(max([self._agility, *jumps]), _MOST_AGILE)
        jumped = set().union(*alike) | (self._followed & opinions.keys())
        self._followed -= jumped
        for name in jumped:
            self._experts[name].jump(opinions[name].value)
            self._vote.restore(name)
        if jumped and self._center is not None:
            self._center.move(np.mean([opinions[name].value for name in sorted(jumped)], axis=0))
        return jumped

    def _distances(self, t_ns: int) -> dict[str, float]:
        """Distance of each source to the nearest voter, units (`Vote.distances`)."""
        heard = {
            name: expert.filter.value_at(t_ns)
            for name, expert in self._experts.items()
            if expert.filter is not None
            and not self._lost[name]
            and t_ns - expert.filter.t_ns <= self._config.stale_after_s * 1e9
        }
        past = None if self._center is None or self._is_lost(t_ns) else self._center.value
        return self._vote.distances(heard, past, self.unit, self._supported, self._elapsed_s)

    def _fuse(self, opinions: Mapping[str, Opinion], judgements: Mapping[str, Judgement], t_ns: int) -> None:
        if not opinions:
            return
        values, variances = [], []
        for name, opinion in opinions.items():
            expert = self._experts[name].filter
            value, variance = opinion.value, judgements[name].variance
            if expert is not None and opinion.t_ns < t_ns:
                ahead, grown = expert.ahead(t_ns, self._density)
                value, variance = value + (ahead - expert.value), variance + grown
            values.append(value)
            variances.append(variance)
        value, variance = combine(np.array(values), np.array(variances), self._config.correlation)
        if self._center is None:
            start_rate = self._config.start_rate * self.unit
            self._center = MotionFilter(value, t_ns, np.sqrt(variance), start_rate)
        else:
            self._center.update(value, variance)

    def _support(self, judgements: Mapping[str, Judgement], t_ns: int) -> None:
        """Note whether anything that was said in this step can be relied on."""
        reliabilities = [self._vouches[n] * j.reliability for n, j in judgements.items()]
        self._supported = sum(reliabilities) >= self._config.support
        if self._supported:
            self._seen_ns = t_ns
        wrong = math.prod(1.0 - _ONE_SOURCE * reliability for reliability in reliabilities)
        self._confidence = max(self._confidence, 1.0 - wrong)

    def _is_lost(self, t_ns: int) -> bool:
        return t_ns - self._seen_ns > self._config.predict_for_s * 1e9

    def _report(self, judgements: Mapping[str, Judgement], t_ns: int) -> Fused:
        center = self._center
        if center is None:
            nothing = np.full(self._size, np.nan)
            return Fused(t_ns, "waiting", nothing, nothing, np.full((2 * self._size,) * 2, np.nan), 0.0, {}, ())
        fresh = self._supported and t_ns - self._seen_ns <= self._config.stale_after_s * 1e9
        state: FusionState = "tracking" if fresh else "lost" if self._is_lost(t_ns) else "predicted"
        return Fused(
            t_ns,
            state,
            center.value.copy(),
            center.rate.copy(),
            center.covariance.copy(),
            self._confidence,
            judgements,
            self._restarts(judgements, t_ns) if fresh else (),
        )

    def _restarts(self, judgements: Mapping[str, Judgement], t_ns: int) -> tuple[str, ...]:
        words = {n: self._vouches[n] * j.reliability for n, j in judgements.items()}
        names = []
        for name, watch in self._drift.items():
            others = sum(words.values()) - words.get(name, 0.0)
            if watch.look(self._distance_from_fused(name, t_ns), others, t_ns):
                names.append(name)
        return tuple(names)

    def _distance_from_fused(self, name: str, t_ns: int) -> float:
        expert = self._experts[name].filter
        if expert is None or self._center is None or self._lost[name]:
            return math.inf
        offset = (expert.value_at(t_ns) - self._center.value) / self.unit
        return math.sqrt(float(offset @ offset))
