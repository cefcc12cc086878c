"""What a fused answer over pictures says: where the target is, and whether several trackers speak for that."""

from __future__ import annotations

import numpy as np

from common.tracking.base import Box
from onboard.fusion.center import Fused

RELIABLE = 0.5
"""Least reliability of a tracker that speaks for the fused box."""
_AGREED = 1.2
"""Least sum of the reliabilities of two trackers or more that speak for the fused box."""


def box_of(fused: Fused, t_ns: int | None = None) -> Box:
    """The answer's box, px, where it was, or where it is to be expected in a later picture."""
    value = fused.value
    if t_ns is not None:
        value = value + np.array([1.0, 1.0, 0.0, 0.0]) * fused.rate * ((t_ns - fused.t_ns) * 1e-9)
    u, v, height, width = value.tolist()
    return u - width / 2, v - height / 2, width, height


def agreed(fused: Fused) -> bool:
    """Whether two trackers or more speak for the fused answer."""
    agreeing = [j.reliability for j in fused.sources.values() if j.reliability > RELIABLE]
    return len(agreeing) >= 2 and sum(agreeing) >= _AGREED
