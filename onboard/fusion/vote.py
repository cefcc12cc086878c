"""The majority vote over the sources, beside which the past votes too (Echeverri 2016, section 4.2.2)."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np

from onboard.fusion.config import FusionConfig
from onboard.fusion.weights import separations

_HANDICAP = 1.5
"""Distance that a voter without any standing is put further away, in switching distances of eq. 4.7."""
ALIKE = 0.7
"""Distance of two that agree, in the same: healthy ones of trackers lie as far apart."""


class Vote:
    """Distances to the nearest voter, and who has what standing to be one.

    Args:
        vouches: how far the word of each source alone shows that there is something, by name (`Source.vouches`).
        config: parameters.
    """

    def __init__(self, vouches: Mapping[str, float], config: FusionConfig):
        self._vouches = dict(vouches)
        self._standing = dict.fromkeys(self._vouches, 1.0)
        self._switch = config.vote_lambda / config.vote_slope
        self._config = config

    def restore(self, name: str) -> None:
        """Give a source its full standing: it begins anew, or its past is no longer held against it."""
        self._standing[name] = 1.0

    def distances(
        self,
        heard: Mapping[str, np.ndarray],
        past: np.ndarray | None,
        unit: np.ndarray,
        supported: bool,
        elapsed_s: float,
    ) -> dict[str, float]:
        """Distance of each source to the nearest voter that it agrees with, units; infinite without any.

        Voters are the sources and, beyond the thesis, the centre's own prediction: with two sources that disagree, or
        with all scattered, nothing but the past can tell which is right. While the answer rests on no source, the past
        is worth less than one that vouches for itself: then such sources alone vote, if there are any, and do not all
        contradict one another.

        Args:
            heard: where each source that has a vote is now, (N,), by name.
            past: the centre's prediction, (N,); None while there is none, or it is lost.
            unit: size of one unit in each component, (N,).
            supported: whether the answer rests on sources that are trusted.
            elapsed_s: time since the last vote, s.
        """
        distances = dict.fromkeys(self._vouches, math.inf)
        if len(heard) < 2:
            return distances
        strong = [name for name in heard if self._vouches[name] >= self._config.support]
        chosen = bool(strong) and not supported and not self._contradict([heard[name] / unit for name in strong])
        voting = strong if chosen else list(heard)
        voters, with_past = [heard[name] for name in voting], not chosen and past is not None
        if past is not None and with_past:
            voters.append(past)
        names = list(heard)
        apart = separations(np.array(list(heard.values())) / unit, np.array(voters) / unit)
        for row, name in enumerate(names):
            if name in voting:
                apart[row, voting.index(name)] = math.inf  # nobody votes for itself
        self._stand(names, apart.min(axis=1), elapsed_s)
        votes = (apart + self._handicaps(names, voting, with_past, supported)).min(axis=1)
        return distances | dict(zip(names, votes.tolist(), strict=True))

    def _contradict(self, points: Sequence[np.ndarray]) -> bool:
        """Whether there are several (N,), and no two of them agree."""
        apart = [float(np.linalg.norm(one - other)) for one, other in itertools.combinations(points, 2)]
        return bool(apart) and min(apart) > ALIKE * self._switch

    def _handicaps(self, names: Sequence[str], voting: Sequence[str], with_past: bool, supported: bool) -> np.ndarray:
        """How much further away each voter is put for each source, (n, m), units.

        The lower standing of the two counts, and, while the answer rests on better ones, how little the voter vouches.
        """
        own = np.array([self._standing[name] for name in names])
        others = np.array([self._standing[name] for name in voting] + [1.0] * with_past)
        vouches = np.array([self._vouches[name] for name in voting] + [1.0] * with_past)
        lower = np.minimum(own[:, None], others)
        return _HANDICAP * self._switch * ((1.0 - lower) + (1.0 - vouches) * supported)

    def _stand(self, names: Sequence[str], distances: np.ndarray, elapsed_s: float) -> None:
        """Let the standing of each source follow whether it agrees with anyone at all."""
        config = self._config
        for name, distance in zip(names, distances.tolist(), strict=True):
            if not math.isfinite(distance):
                self._standing[name] = 1.0  # it alone vouches for the answer: it begins a new past
                continue
            agreement = 0.5 * (1.0 - math.tanh(config.vote_slope * distance - config.vote_lambda))
            rises = agreement > self._standing[name]
            share = -math.expm1(-elapsed_s / (config.standing_rise_s if rises else config.standing_fall_s))
            self._standing[name] += share * (agreement - self._standing[name])
