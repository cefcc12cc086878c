"""Overlap over the pictures for each tracker, as in Echeverri 2016, figures 4.8 and 4.10."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from common.evaluation import LEAST_OVERLAP, Evaluation

_SHOWN = 2
"""Sequences with the largest gain and with the largest loss that are drawn, each."""


def draw(compared: Mapping[str, Mapping[str, Evaluation]], margins: Mapping[str, float], path: Path) -> None:
    """Jaccard index over the picture's number where the fusion gains most over its best member, and loses most.

    Args:
        compared: sequence to tracker to its agreement with the truth.
        margins: sequence to the fusion's success less that of its best member.
        path: PNG file.
    """
    from matplotlib.figure import Figure

    order = sorted(margins, key=lambda name: margins[name])
    chosen = [*order[: -_SHOWN - 1 : -1], *order[:_SHOWN]]
    figure = Figure(figsize=(9, 2.2 * len(chosen)), layout="constrained")
    for axes, name in zip(np.atleast_1d(figure.subplots(len(chosen), 1)), chosen, strict=True):
        for tracker, one in compared[name].items():
            fused = tracker == "hab-df"
            axes.plot(
                one.frames, one.overlap, lw=2.0 if fused else 0.9, color="black" if fused else None, label=tracker
            )
        axes.axhline(LEAST_OVERLAP, color="grey", ls=":", lw=0.8)
        axes.set(ylabel="Jaccard index", ylim=(0, 1), title=f"{name}: {margins[name]:+.3f} against the best member")
    axes.set_xlabel("picture")
    figure.axes[0].legend(ncols=4, fontsize="small", loc="lower left")
    figure.savefig(path, dpi=90)
