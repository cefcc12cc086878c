"""Which sources have drifted from the fused answer for so long that they should be started anew; with hysteresis."""

from __future__ import annotations

from onboard.fusion.config import FusionConfig


class DriftWatch:
    """Watches one source's distance from the fused answer. Beyond the thesis, which only trusts such a source less.

    Args:
        config: distances and times.
    """

    def __init__(self, config: FusionConfig):
        self._config = config
        self._drifted_ns: int | None = None
        self._restarted_ns: int | None = None

    @property
    def drifted(self) -> bool:
        """Whether it counts as drifted now."""
        return self._drifted_ns is not None

    def look(self, distance: float, others_support: float, t_ns: int) -> bool:
        """Take in a distance; True when the source is to be started anew on the fused answer now.

        Args:
            distance: from the fused answer, units; infinite while the source says that it is lost.
            others_support: sum of the other sources' reliabilities in the fused answer.
            t_ns: now, ns, not before the time before.
        """
        config = self._config
        if self._drifted_ns is None:
            if distance > config.drift_enter:
                self._drifted_ns = t_ns
        elif distance < config.drift_leave:
            self._drifted_ns = None
        if self._drifted_ns is None or t_ns - self._drifted_ns < config.drift_after_s * 1e9:
            return False
        if self._restarted_ns is not None and t_ns - self._restarted_ns < config.restart_every_s * 1e9:
            return False
        if others_support < config.restart_support:
            return False
        self._restarted_ns = t_ns
        return True
