"""How long a request is under way: from a picture's capture to the setpoint that came of it, by the vehicle's clock."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from statistics import median

from common.header import Received
from common.messages import Setpoint

_REQUESTS = "helm/request/pursuit"
_KEPT = 21
_LONGEST_S = 0.3


class RequestDelay:
    """Median over the last setpoints; both stamps are helm's clock, so the machines' clocks need not agree.

    Args:
        assumed_s: what is taken until a setpoint has come of a request, s.
    """

    def __init__(self, assumed_s: float):
        self._assumed_s = assumed_s
        self._delays_s: deque[float] = deque(maxlen=_KEPT)
        self._newest_ns = -1

    @property
    def seconds(self) -> float:
        """The delay, at most 0.3 s."""
        return min(median(self._delays_s), _LONGEST_S) if self._delays_s else self._assumed_s

    def extend(self, setpoints: Iterable[Received[Setpoint]]) -> None:
        """Take the setpoints that name a request of the pursuit in their header, each request once."""
        for setpoint in setpoints:
            if setpoint.message.source != "pursuit":
                continue
            for used in setpoint.header.inputs:
                if used.topic == _REQUESTS and used.capture_ns > self._newest_ns:
                    self._newest_ns = used.capture_ns
                    self._delays_s.append(max(0.0, (setpoint.header.capture_ns - used.capture_ns) / 1e9))
