"""CLEAR MOT and IDF1 of tracks against the truth, by motmetrics, with people who are not to be counted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from simulation.world.people_truth import SeenPerson

LEAST_IOU = 0.5
Box = tuple[int, int, int, int]

_METRICS = ("num_objects", "num_misses", "num_false_positives", "num_switches", "mota", "idf1")


@dataclass(frozen=True)
class Claim:
    """What the search says about one picture: a person here."""

    number: int
    """Who."""
    box_px: Box
    """x, y, width, height."""


class Score:
    """Compares claims with the truth, picture by picture."""

    def __init__(self) -> None:
        import motmetrics  # brings pandas: a second that the other benchmarks need not wait

        self.accumulator: Any = motmetrics.MOTAccumulator(auto_id=True)
        self.false: list[Claim] = []
        """Every claim that was nobody."""

    def add(self, people: Sequence[SeenPerson], claims: Sequence[Claim]) -> tuple[list[int], list[Claim]]:
        """Note one picture; who was missed in it, and which claims were false.

        A claim that is nobody who counts but lies mostly on somebody seen too little to count is left out, as in the
        MOT challenges: neither right nor wrong.

        Args:
            people: everybody seen in it, truly.
            claims: what the search says.
        """
        counted, spared = [p for p in people if p.counts], [p for p in people if not p.counts]
        overlaps = np.array([[iou(p.box_px, c.box_px) for c in claims] for p in counted]).reshape(
            len(counted), len(claims)
        )
        matched = _matched(overlaps)
        kept = [
            k
            for k, claim in enumerate(claims)
            if k in matched or not any(_covered(claim.box_px, p.box_px) >= LEAST_IOU for p in spared)
        ]
        distances = np.where(overlaps >= LEAST_IOU, 1.0 - overlaps, np.nan)[:, kept]
        self.accumulator.update([p.number for p in counted], [claims[k].number for k in kept], distances)
        false = [claims[k] for k in kept if k not in matched]
        self.false += false
        found = set(matched.values())
        return [p.number for row, p in enumerate(counted) if row not in found], false


def _matched(overlaps: np.ndarray) -> dict[int, int]:
    """Row of each column in the assignment with the most overlap, pairs below the least one left out."""
    rows, columns = linear_sum_assignment(np.where(overlaps >= LEAST_IOU, -overlaps, 0.0))
    return {int(c): int(r) for r, c in zip(rows, columns, strict=True) if overlaps[r, c] >= LEAST_IOU}


def figures(scores: dict[str, Score]) -> dict[str, float]:
    """Rates of misses and false positives, switches, MOTA and IDF1 of each score, its name before them, and over all
    (without one), and the worst MOTA."""
    import motmetrics

    table = motmetrics.metrics.create().compute_many(
        [score.accumulator for score in scores.values()],
        metrics=list(_METRICS),
        names=list(scores),
        generate_overall=True,
    )
    results: dict[str, float] = {}
    for name in (*scores, "OVERALL"):
        row = {metric: float(table.loc[name, metric]) for metric in _METRICS}
        prefix = "" if name == "OVERALL" else f"{name}_"
        objects = max(row["num_objects"], 1.0)
        results |= {
            f"{prefix}fn_rate": row["num_misses"] / objects,
            f"{prefix}fp_rate": row["num_false_positives"] / objects,
            f"{prefix}id_switches": row["num_switches"],
            f"{prefix}mota": row["mota"],
            f"{prefix}idf1": row["idf1"],
            f"{prefix}people_boxes": row["num_objects"],
            f"{prefix}false_positives": row["num_false_positives"],
        }
    return results | {"worst_mota": min(results[f"{name}_mota"] for name in scores)}


def iou(a: Box, b: Box) -> float:
    """Share of two boxes' common area, 0 to 1."""
    common = _common(a, b)
    return common / (a[2] * a[3] + b[2] * b[3] - common)


def _covered(a: Box, b: Box) -> float:
    """Share of a that lies on b."""
    return _common(a, b) / (a[2] * a[3])


def _common(a: Box, b: Box) -> float:
    width = min(a[0] + a[2], b[0] + b[2]) - max(a[0], b[0])
    height = min(a[1] + a[3], b[1] + b[3]) - max(a[1], b[1])
    return float(max(width, 0) * max(height, 0))
