"""Another device's clock, mapped to this machine's monotonic time by the messages that arrive from it."""

from __future__ import annotations

import statistics
from collections import deque

_BUCKETS = 8
_MAX_DRIFT = 0.05
_MIN_SLOPE_SPAN = 0.2


class ClockMap:
    """Maps the stamps of a remote clock to local monotonic nanoseconds.

    A message never arrives before it was stamped, so the smallest `arrival - stamp` of a recent window is the offset
    with the least delay in it. The remote clock may run at another rate (PX4 in the loop: 98.4 %, 16 ms a second), so a
    single offset goes stale within the window itself: the window is cut into eight parts, the slope between their
    minima (Theil-Sen: the median of the pairwise slopes, which a burst of late messages does not bend) carries each
    minimum to the stamp that is mapped, and the smallest wins. A stamp that jumps back or far ahead is a restarted
    device: the map begins anew.

    Args:
        window_ns: how far back arrivals count, ns of the remote clock; above 2 s the map trails a drifting clock.

    Raises:
        ValueError: a window that is not within 0.1 to 2 s.
    """

    def __init__(self, window_ns: int = 2_000_000_000):
        if not 100_000_000 <= window_ns <= 2_000_000_000:
            raise ValueError(f"window_ns: got {window_ns}, expected 0.1 to 2 s (1e8 to 2e9)")
        self._window_ns = window_ns
        self._width_ns = window_ns // _BUCKETS
        self._minima: deque[tuple[int, int]] = deque()  # (stamp, arrival - stamp), the least of each bucket
        self._bucket = 0
        self._newest_ns: int | None = None
        self._drift = 0.0
        self.restarts = 0
        """How often the remote clock jumped."""

    def update(self, remote_ns: int, arrival_ns: int) -> int:
        """Note an arrival; returns the stamp in local time, ns, never later than the arrival."""
        if self._newest_ns is not None and not -self._window_ns < remote_ns - self._newest_ns < 15 * self._window_ns:
            self._minima.clear()
            self._drift = 0.0
            self._newest_ns = None
            self.restarts += 1
        if self._newest_ns is None or remote_ns > self._newest_ns:
            self._newest_ns = remote_ns
        self._add(remote_ns, arrival_ns - remote_ns)
        local_ns = self.to_local(remote_ns)
        return arrival_ns if local_ns is None else min(local_ns, arrival_ns)

    def to_local(self, remote_ns: int) -> int | None:
        """The local time of a remote stamp, ns; None before the first arrival."""
        if not self._minima:
            return None
        return remote_ns + min(offset + round(self._drift * (remote_ns - at)) for at, offset in self._minima)

    @property
    def drift(self) -> float:
        """Local seconds gained per remote second (0.016 for a remote clock at 98.4 %)."""
        return self._drift

    def _add(self, remote_ns: int, offset_ns: int) -> None:
        bucket = remote_ns // self._width_ns
        if not self._minima or bucket > self._bucket:
            self._minima.append((remote_ns, offset_ns))
            self._bucket = bucket
            while len(self._minima) > 2 and remote_ns - self._minima[0][0] > self._window_ns:
                self._minima.popleft()
            self._fit()
            return
        at, least = self._minima[-1]
        if offset_ns + round(self._drift * (at - remote_ns)) < least:
            self._minima[-1] = (remote_ns, offset_ns)

    def _fit(self) -> None:
        closed = list(self._minima)[:-1]  # the newest bucket has seen one message only
        least_span_ns = _MIN_SLOPE_SPAN * self._window_ns
        slopes = [
            (y1 - y0) / (x1 - x0)
            for i, (x0, y0) in enumerate(closed)
            for x1, y1 in closed[i + 1 :]
            if x1 - x0 >= least_span_ns
        ]
        if len(closed) >= _BUCKETS // 2 and slopes:
            self._drift = min(max(statistics.median(slopes), -_MAX_DRIFT), _MAX_DRIFT)
