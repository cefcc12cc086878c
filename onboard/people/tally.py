"""What the pictures of a recording were like: what was missing in how many of them, and how far the floor was."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from onboard.people.findings import Findings

_NEAREST_M, _FARTHEST_M = 2.0, 12.0
"""Distances of the floor, m, from which people are found (`test_people_clusters.py`)."""


@dataclass
class Tally:
    """Counts for the summary that `outrider people` ends with."""

    pictures: int = 0
    """All of them."""
    broken: int = 0
    """Those that cannot be decoded."""
    reasons: dict[str, list[str]] = field(default_factory=dict)
    """Why something was missing, picture by picture, by the reason without its numbers."""
    floors_m: list[float] = field(default_factory=list)
    """Distances of the floor."""

    def note(self, findings: Findings, reason: str) -> None:
        """Count what a picture showed, and why it showed less than usual; empty when all was well."""
        if findings.floor_m is not None:
            self.floors_m.append(findings.floor_m)
        if reason:
            self.reasons.setdefault(re.sub(r"[0-9.]+", "#", reason), []).append(reason)

    def instead(self, reason: str) -> None:
        """State one reason for all pictures, instead of each one's."""
        self.reasons = {reason: [reason] * (self.pictures - self.broken)}

    def lines(self) -> Iterator[str]:
        """What to say: each reason once, with the numbers of its first picture."""
        for texts in self.reasons.values():
            yield f"in {len(texts)} pictures: {texts[0]}" + (", and the like" if len(set(texts)) > 1 else "")
        if self.floors_m:
            middle_m = float(np.median(self.floors_m))
            good = _NEAREST_M <= middle_m <= _FARTHEST_M
            doubt = (
                f", expected {_NEAREST_M:g} to {_FARTHEST_M:g} m: is --depth-scale right? 5000 is TUM's, 1000 for mm"
            )
            yield f"floor {middle_m:.2f} m from the camera{'' if good else doubt}"
