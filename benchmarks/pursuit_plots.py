"""Plots of the benchmark `pursuit`, like the paper's figures 9 to 12 and 14."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.pursuit_count import Columns, Mask, counted, found, occlusions, turning

_PAPER_STILL_M, _PAPER_CHASE_M, _PAPER_YAW_DEG = 0.10, 0.30, 3.0
_AROUND_S = 3.0


def draw(flown: Sequence[tuple[str, str, Columns]], folder: Path) -> None:
    """Write `pursuit-still.png` and `pursuit-chase.png`: a row for each output form.

    Args:
        flown: scene, output form and trace of each flight.
        folder: where to.
    """
    from matplotlib.figure import Figure

    for scene, row in (("still", _still_row), ("chase", _chase_row)):
        flights = [(form, columns) for name, form, columns in flown if name == scene]
        width = 3 if scene == "still" else 5
        figure = Figure(figsize=(4.2 * width, 3.6 * len(flights)), layout="constrained")
        axes = figure.subplots(len(flights), width, squeeze=False)
        for line, (form, columns) in zip(axes, flights, strict=True):
            row(line, columns)
            line[0].set_title(f"{form} form\n{line[0].get_title()}")
        figure.savefig(folder / f"pursuit-{scene}.png", dpi=70)


def _still_row(axes: Sequence[Any], columns: Columns) -> None:
    """Figure 9: the car in the level frame, errors over time."""
    mask = counted(columns["t_s"], columns["covered"])
    _plane(axes[0], columns, mask, _PAPER_STILL_M)
    _over_time(axes[1], columns, mask, "error_m", "distance, m", _PAPER_STILL_M)
    t_s = columns["t_s"] - columns["t_s"][0]
    axes[2].plot(t_s[mask], np.degrees(columns["yaw_error_rad"][mask]), lw=0.8)
    for side in (-1, 1):
        axes[2].axhline(side * _PAPER_YAW_DEG, color="black", ls="--", lw=0.8)
    axes[2].set(xlabel="s", ylabel="heading error, degrees", title="heading (paper: dashed)")


def _chase_row(axes: Sequence[Any], columns: Columns) -> None:
    """Figures 10, 11, 12 and 14: the car in the level frame, error, a turn, an occlusion, altitude and size."""
    mask = counted(columns["t_s"], columns["covered"])
    _plane(axes[0], columns, mask, _PAPER_CHASE_M)
    _over_time(axes[1], columns, mask, "error_m", "distance, m", _PAPER_CHASE_M)
    _turn(axes[2], columns, mask)
    _occlusion(axes[3], columns)
    _altitude(axes[4], columns, mask)


def _plane(axis: Any, columns: Columns, mask: Mask, paper_m: float) -> None:
    """Where the car is, seen from the vehicle, ahead and to the right."""
    north, east = columns["target_north_m"] - columns["north_m"], columns["target_east_m"] - columns["east_m"]
    c, s = np.cos(columns["yaw_rad"]), np.sin(columns["yaw_rad"])
    axis.plot((c * east - s * north)[mask], (c * north + s * east)[mask], ".", ms=1.5)
    turn = np.linspace(0, 2 * math.pi, 100)
    axis.plot(paper_m * np.cos(turn), paper_m * np.sin(turn), "--", color="black", lw=0.8)
    axis.set_aspect("equal", "datalim")
    axis.set(xlabel="right, m", ylabel="ahead, m", title="car below the vehicle (paper's largest: dashed)")


def _over_time(axis: Any, columns: Columns, mask: Mask, name: str, label: str, paper: float) -> None:
    t_s = columns["t_s"] - columns["t_s"][0]
    axis.plot(t_s, np.where(mask, columns[name], np.nan), lw=0.8, label="counted")
    axis.plot(t_s, np.where(mask, np.nan, columns[name]), lw=0.6, color="0.7", label="not counted")
    axis.axhline(paper, color="black", ls="--", lw=0.8, label="paper's largest")
    axis.set(xlabel="s", ylabel=label, title="distance between camera axis and car", ylim=(0, None))
    axis.legend(fontsize=7)


def _turn(axis: Any, columns: Columns, mask: Mask) -> None:
    """The longest turn in full view."""
    t_s, heading = columns["t_s"], np.unwrap(columns["target_heading_rad"])
    turns = np.concatenate(([False], turning(t_s, heading) & mask, [False])).astype(int)
    edges = np.flatnonzero(np.diff(turns))
    axis.set(xlabel="s", ylabel="heading, degrees", title="a turn")
    if not len(edges):
        return
    begin, end = max(zip(edges[::2], edges[1::2], strict=True), key=lambda span: span[1] - span[0])
    near = (t_s > t_s[begin] - _AROUND_S) & (t_s < t_s[end - 1] + _AROUND_S)
    error = columns["yaw_error_rad"]
    axis.plot(t_s[near] - t_s[begin], np.degrees(heading[near] - heading[begin]), label="car")
    axis.plot(t_s[near] - t_s[begin], np.degrees((heading - error)[near] - heading[begin]), label="vehicle")
    axis.legend(fontsize=7)


def _occlusion(axis: Any, columns: Columns) -> None:
    """Error around the first occlusion, and whether the tracker has the car."""
    t_s, spans, has = columns["t_s"], occlusions(columns["covered"]), found(columns)
    axis.set(xlabel="s", ylabel="distance, m", title="an occlusion (grey: half or more hidden)")
    if not spans:
        return
    span = spans[0]
    near = (t_s > t_s[span.begin] - _AROUND_S) & (t_s < t_s[span.end] + _AROUND_S)
    t = t_s - t_s[span.begin]
    axis.axvspan(0.0, t[span.end], color="0.9")
    axis.plot(t[near], np.where(has, columns["error_m"], np.nan)[near], color="C2", label="seen")
    axis.plot(t[near], np.where(has, np.nan, columns["error_m"])[near], color="C1", label="predicted")
    axis.legend(fontsize=7)


def _altitude(axis: Any, columns: Columns, mask: Mask) -> None:
    """Height, and the size of the tracked rectangle."""
    t_s = columns["t_s"] - columns["t_s"][0]
    axis.plot(t_s, columns["height_m"], label="height, m")
    has = mask & found(columns)
    size = np.where(has, columns["track_size_px"], np.nan)
    twin = axis.twinx()
    twin.plot(t_s, size, color="C1", lw=0.8)
    twin.set_ylabel("tracked size, px", color="C1")
    axis.set(xlabel="s", ylabel="height, m", title="changes of altitude")
