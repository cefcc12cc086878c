"""The chase error over the last seconds, as a plot."""

from __future__ import annotations

from collections import deque

import numpy as np
import viser
from numpy.typing import NDArray
from viser import uplot

from ground.console.snapshot import TRACK, Snapshot
from ground.console.style import BLUE, ORANGE

_PERIOD_NS = 500_000_000


class ErrorHistory:
    """Where the target was, metres ahead and to the right of the vehicle, over the last seconds.

    Args:
        span_s: how far back, s.
    """

    def __init__(self, span_s: float):
        self._span_ns = round(span_s * 1e9)
        self._points: deque[tuple[int, float, float]] = deque()
        self._capture_ns = 0

    @property
    def newest(self) -> tuple[float, float] | None:
        """Newest (ahead, right), m; None without any in the span."""
        return self._points[-1][1:] if self._points else None

    def add(self, view: Snapshot) -> None:
        """Note the target of a snapshot, once for each estimate; only a tracked target counts."""
        while self._points and self._points[0][0] < view.t_ns - self._span_ns:
            self._points.popleft()
        track, height_m = view.track, view.height_m
        if (
            track is None
            or track.state != "tracking"
            or not view.fresh(TRACK)
            or height_m is None
            or view.track_capture_ns == self._capture_ns
        ):
            return
        self._capture_ns = view.track_capture_ns
        # The error is given as tangents of the ray to the target: times the height it is metres on the ground.
        self._points.append((view.t_ns, track.error[0] * height_m, track.error[1] * height_m))

    def series(self, t_ns: int) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Seconds before now (negative, rising), metres ahead, metres right; each (N,)."""
        table = np.array(self._points, dtype=float).reshape(-1, 3)
        return (table[:, 0] - t_ns) / 1e9, table[:, 1], table[:, 2]


class ErrorPlot:
    """The plot in the panel.

    Args:
        gui: where it is added.
        span_s: width of its time axis, s.
    """

    def __init__(self, gui: viser.GuiApi, span_s: float):
        empty = np.array([-span_s, 0.0])
        nothing = np.array([np.nan, np.nan])
        grid = uplot.Axis_Grid(stroke="rgba(255,255,255,0.08)", width=1)
        self._handle = gui.add_uplot(
            (empty, nothing, nothing),
            (uplot.Series(label="s"), _dots("ahead m", BLUE), _dots("right m", ORANGE)),
            title=f"Target from the vehicle, last {span_s:.0f} s",
            scales={"x": uplot.Scale(time=False, range=(-span_s, 0.0)), "y": uplot.Scale(auto=True)},
            axes=(uplot.Axis(grid=grid), uplot.Axis(grid=grid, size=34)),
            legend=uplot.Legend(live=False, markers=uplot.Legend_Markers(width=2)),
            height=150,
        )
        self._drawn_ns = 0

    def update(self, history: ErrorHistory, t_ns: int) -> None:
        """Draw the history, twice a second."""
        if t_ns - self._drawn_ns < _PERIOD_NS:
            return
        self._drawn_ns = t_ns
        x, forward, right = history.series(t_ns)
        if len(x) >= 2:
            self._handle.data = (x, forward, right)


def _dots(label: str, colour: str) -> uplot.Series:
    # Dots, no line: a line would run straight through the time in which no target was seen.
    return uplot.Series(
        label=label,
        stroke=colour,
        width=0,
        points=uplot.Series_Points(show=True, size=3, fill=colour, stroke=colour, width=0.5),
    )
