"""Which depth belongs to which picture: both come by themselves, and one may be late or missing."""

from __future__ import annotations

from collections import deque

from common.header import Received
from common.messages import Image

_KEPT = 8


class Pairing:
    """The newest pictures and depths that were not used yet.

    Args:
        pair_ms: largest difference of capture times within a pair, ms.
        wait_ms: how long a picture waits for its depth after it was received, ms.
        with_depth: whether there is depth to wait for.
    """

    def __init__(self, pair_ms: float, wait_ms: float, with_depth: bool):
        self._pair_ns, self._wait_ns, self._with_depth = pair_ms * 1e6, wait_ms * 1e6, with_depth
        self._colours: deque[Received[Image]] = deque(maxlen=_KEPT)
        self._depths: deque[Received[Image]] = deque(maxlen=_KEPT)
        self._taken_ns = -1

    def add_colour(self, received: Received[Image]) -> None:
        """A picture came."""
        self._colours.append(received)

    def add_depth(self, received: Received[Image]) -> None:
        """A depth picture came."""
        self._depths.append(received)

    def take(self, t_ns: int) -> tuple[Received[Image], Received[Image] | None] | None:
        """The newest picture not taken yet and the depth nearest to it in time; None when there is none, or while its
        depth may still come.

        The depth may belong to another time when the picture waited in vain; None when there is no depth at all.
        """
        for colour in reversed(self._colours):
            if colour.header.capture_ns <= self._taken_ns:
                break
            depth = self._nearest(colour.header.capture_ns)
            paired = depth is not None and self._apart_ns(colour, depth) <= self._pair_ns
            if paired or not self._with_depth or t_ns - colour.received_ns > self._wait_ns:
                self._taken_ns = colour.header.capture_ns
                return colour, depth
        return None

    def _nearest(self, capture_ns: int) -> Received[Image] | None:
        return min(self._depths, key=lambda depth: abs(depth.header.capture_ns - capture_ns), default=None)

    @staticmethod
    def _apart_ns(colour: Received[Image], depth: Received[Image]) -> int:
        return abs(colour.header.capture_ns - depth.header.capture_ns)
