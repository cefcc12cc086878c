"""Which nodes are alive, asked about once a second in a thread of its own, and only while somebody looks."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Mapping

log = logging.getLogger(__name__)

_PERIOD_S = 1.0


class LifeWatch:
    """Asks the bus which nodes live.

    Args:
        ask: gives node name to its processes; blocks for up to a second.
        wanted: whether anyone is interested.
    """

    def __init__(self, ask: Callable[[], Mapping[str, list[int]]], wanted: Callable[[], bool]):
        self._ask = ask
        self._wanted = wanted
        self._stop = threading.Event()
        self._alive: Mapping[str, int] | None = None
        self._thread = threading.Thread(target=self._run, name="life watch", daemon=True)

    @property
    def alive(self) -> Mapping[str, int] | None:
        """Number of processes of each live node; None before the first answer."""
        return self._alive

    def start(self) -> None:
        """Begin to ask."""
        self._thread.start()

    def close(self) -> None:
        """End the thread."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(timeout=2.0)

    def _run(self) -> None:
        while not self._stop.wait(_PERIOD_S if self._alive is not None or not self._wanted() else 0.05):
            if not self._wanted():
                self._alive = None  # what was true when the last browser left says nothing when the next one comes
                continue
            try:
                self._alive = {name: len(boots) for name, boots in self._ask().items()}
            except Exception:  # a bus that is going away must not end the watch
                log.debug("cannot ask for live nodes", exc_info=True)
                self._alive = None
