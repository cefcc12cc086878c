"""Settings of the velocity limiter (`[limiter]` of the vehicle file)."""

from __future__ import annotations

import itertools

from common.config import ConfigError, NonNegative, Positive, Section


class LimiterConfig(Section, frozen=True, kw_only=True):
    """Distances and speeds of the repulsive law, and what the vehicle can stop in. Distances are from its centre."""

    h_min_m: Positive = 0.8
    """Collision zone below this distance, m: the repulsion is at its maximum."""
    h_desired_m: Positive = 1.5
    """Where the vehicle comes to a stop in front of an obstacle, m (Al-Kaff 2019, figure 9)."""
    h_mid_m: Positive = 2.5
    """Transition zone below this distance, warning zone above, m."""
    h_max_m: Positive = 6.0
    """Safe zone above this distance, m: nothing is taken away."""
    band_m: Positive = 1.0
    """Below `h_max_m` the repulsion grows from nothing to the printed law within this distance, m."""
    v_max_m_s: Positive = 4.0
    """Repulsion at `h_min_m`, m/s; the larger, the flatter the approach far off and the steeper near."""
    stop_delay_s: NonNegative = 0.5
    """Time before the vehicle begins to slow down, s. Tuned with `stop_deceleration_m_s2` on PX4's step from 2 m/s to
    rest, which covered 2.29 m: 2 · 0.5 + 2²/(2 · 1.6) = 2.25 m."""
    stop_deceleration_m_s2: Positive = 1.6
    """Deceleration that it then reaches on average, m/s²."""
    required: bool = False
    """Whether a vehicle without fresh obstacle data must stand still. Once data has come, it is required for the rest
    of the run: a sensor that died is no free view."""

    def check(self) -> None:
        """Raise ConfigError when fields contradict each other."""
        names = ("h_min_m", "h_desired_m", "h_mid_m", "h_max_m")
        values = [getattr(self, name) for name in names]
        if any(a >= b for a, b in itertools.pairwise(values)):
            raise ConfigError(f"{' < '.join(names)}: got {', '.join(map(str, values))}; expected rising distances")
        if self.h_max_m - self.band_m < self.h_desired_m:
            raise ConfigError(
                f"band_m: got {self.band_m}, expected at most h_max_m - h_desired_m = "
                f"{self.h_max_m - self.h_desired_m:g}, or the vehicle would not stop at h_desired_m"
            )
