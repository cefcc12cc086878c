"""Plots of a track against the truth, like figure 4.8 of Echeverri 2016."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from common.config import ConfigError
from common.evaluation import LARGEST_DISTANCE_PX, LEAST_OVERLAP, Evaluation


def draw(compared: Mapping[str, Evaluation], path: str) -> None:
    """Write overlap and distance over the pictures, and a bar of the successes, of each track.

    Raises:
        ConfigError: matplotlib is not installed, or the file cannot be written.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise ConfigError("--plot: needs matplotlib, which the extra `bench` brings") from None
    figure = Figure(figsize=(12, 3.8), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    for name, one in compared.items():
        left.plot(one.frames, one.overlap, lw=0.8, label=name)
        middle.plot(one.frames, np.where(np.isfinite(one.d4_px), one.d4_px, np.nan), lw=0.8, label=name)
    left.axhline(LEAST_OVERLAP, color="0.5", ls="--", lw=0.8)
    middle.axhline(LARGEST_DISTANCE_PX, color="0.5", ls="--", lw=0.8)
    left.set(title="overlap (4.8a)", xlabel="picture", ylabel="Jaccard index", ylim=(0, 1))
    middle.set(title="distance (4.8b)", xlabel="picture", ylabel="d over u, v, h, w, px", ylim=(0, None))
    bars = right.bar(list(compared), [one.figures()["success_d4"] for one in compared.values()])
    for bar, index in zip(bars, range(len(compared)), strict=True):
        bar.set_color(f"C{index}")
    right.set(title="success (4.8c)", ylabel="share of the visible pictures", ylim=(0, 1))
    right.tick_params(axis="x", rotation=20)
    left.legend(fontsize=8)
    try:
        figure.savefig(path, dpi=80)
    except (OSError, ValueError) as error:
        raise ConfigError(f"--plot: cannot write {path!r}: {error}") from None
