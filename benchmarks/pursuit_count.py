"""What counts in a chase with occlusions: which errors, which occlusions, and when the target is found again.

An occlusion begins with the first picture that hides half of the car's top or more, ends with the first one that hides
less than half, and is one only if the whole car is hidden in between. Errors count until it begins, and again from two
seconds after it ends. All of it is taken from the truth; the tracker's own word decides nothing by itself: it sees the
target when it says so *and* has it within half a car's length of where it is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Columns = Mapping[str, Array]
"""A flight's trace: name to one figure for each picture (`benchmarks.episode.Trace`)."""

SETTLE_S = 6.0
"""Not counted after the choice of the target: the vehicle comes out of its takeoff."""
GRACE_S = 2.0
"""Not counted after a reappearance."""
RIGHT_M = 0.5
"""Half the car's length: what the tracker has within that of the car is the car."""
TURNING_RAD_S = 0.2
"""From this heading rate of the car on it counts as turning."""
_HALF, _WHOLE = 0.5, 0.999


@dataclass(frozen=True)
class Occlusion:
    """Pictures `begin` to `end` - 1, which hide half of the car or more, and in between the whole."""

    begin: int
    end: int


def occlusions(covered: Array) -> list[Occlusion]:
    """All that ended within the flight, from the share of the car that is hidden, (N,)."""
    hidden = np.concatenate(([False], covered >= _HALF, [False]))
    edges = np.flatnonzero(np.diff(hidden.astype(int)))
    spans = [Occlusion(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    return [s for s in spans if s.end < len(covered) and covered[s.begin : s.end].max() >= _WHOLE]


def counted(t_s: Array, covered: Array) -> Mask:
    """Pictures (N,) whose errors count."""
    mask = t_s - t_s[0] >= SETTLE_S
    for span in occlusions(covered):
        mask &= ~((np.arange(len(t_s)) >= span.begin) & (t_s < t_s[span.end] + GRACE_S))
    if len(covered) and covered[-1] >= _HALF:  # one that the flight's end cuts off
        mask[int(np.flatnonzero(covered < _HALF)[-1]) + 1 if (covered < _HALF).any() else 0 :] = False
    return mask


def found(columns: Columns) -> Mask:
    """Pictures (N,) in which the tracker has the target, and where it is."""
    return (columns["seen"] > 0) & (np.nan_to_num(columns["off_m"], nan=math.inf) <= RIGHT_M)


def recoveries_s(columns: Columns) -> list[float]:
    """For each occlusion how long after the reappearance the tracker has the target, s.

    Infinite where it never has, before the next occlusion or the end.
    """
    t_s, has, spans = columns["t_s"], found(columns), occlusions(columns["covered"])
    ends = [*(s.begin for s in spans), len(t_s)][1:]
    waits = []
    for span, until in zip(spans, ends, strict=True):
        again = np.flatnonzero(has[span.end : until])
        waits.append(float(t_s[span.end + again[0]] - t_s[span.end]) if len(again) else math.inf)
    return waits


def lost_for_good(columns: Columns) -> int:
    """Pictures at the flight's end without the target, but for an occlusion and its two seconds.

    One that the flight's end cuts off is excused from the first picture on that hides anything of the car: whether the
    target would have been found again is not known.
    """
    t_s, has, covered = columns["t_s"], found(columns), columns["covered"]
    last = int(np.flatnonzero(has)[-1]) if has.any() else 0
    excused = (covered >= _HALF) | ~(counted(t_s, covered) | (t_s - t_s[0] < SETTLE_S))
    index = np.arange(len(t_s))
    if len(covered) and covered[-1] >= _HALF:
        excused |= index > np.flatnonzero(np.concatenate(([0.0], covered)) == 0.0)[-1] - 1
    return int(((index > last) & ~excused).sum())


def turning(t_s: Array, heading_rad: Array) -> Mask:
    """Pictures (N,) in which the car turns."""
    rate = np.gradient(np.unwrap(heading_rad), t_s)
    return np.abs(rate) >= TURNING_RAD_S


def still_figures(columns: Columns) -> dict[str, float]:
    """Of a flight over a parked car: the paper's figure 9."""
    mask = counted(columns["t_s"], columns["covered"])
    error_m, yaw_rad = columns["error_m"][mask], columns["yaw_error_rad"][mask]
    return {
        "stabilise_max_error_m": float(error_m.max()),
        "stabilise_rms_error_m": _rms(error_m),
        "stabilise_max_yaw_deg": math.degrees(float(np.abs(yaw_rad).max())),
        "stabilise_axis_max_error_m": float(columns["axis_error_m"][mask].max()),
    }


def chase_figures(columns: Columns) -> dict[str, float]:
    """Of a chase: the paper's figures 10 to 13."""
    t_s, covered = columns["t_s"], columns["covered"]
    mask = counted(t_s, covered)
    error_m, axis_m = columns["error_m"][mask], columns["axis_error_m"][mask]
    turns = mask & turning(t_s, columns["target_heading_rad"])
    waits_s = recoveries_s(columns)
    recovered = [w for w in waits_s if math.isfinite(w)]
    return {
        "chase_max_error_m": float(error_m.max()),
        "chase_rms_error_m": _rms(error_m),
        "chase_p95_error_m": float(np.percentile(error_m, 95)),
        "chase_axis_max_error_m": float(axis_m.max()),
        "chase_axis_rms_error_m": _rms(axis_m),
        "chase_yaw_rms_deg": math.degrees(_rms(columns["yaw_error_rad"][turns])),
        "occlusions": float(len(waits_s)),
        "recovered": float(len(recovered)),
        "worst_recovery_s": max(recovered, default=0.0),
        "reinitialisations": float(columns["reinitialisations"][-1]),
        "frames_lost_for_good": float(lost_for_good(columns)),
        "counted_share": float(mask.mean()),
    }


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
