"""Settings of the velocity limiter (`[limiter]` of the vehicle file)."""

from __future__ import annotations

import itertools
from typing import Literal

from common.config import ConfigError, NonNegative, Positive, Section


class DpfConfig(Section, frozen=True, kw_only=True):
    """The Dynamic Parametric Field (Brandt & Colton 2010): piecewise linear over its zones, whatever the speed."""

    h_min_m: Positive = 0.6
    """Where its repulsion reaches its maximum, m."""
    h_mid_m: Positive = 1.75
    """Where its slow rise ends and the steep one begins, m."""
    h_max_m: Positive = 3.0
    """Where it begins, m."""
    v_mid_m_s: Positive = 0.35
    """Repulsion at `h_mid_m`, m/s."""
    v_max_m_s: Positive = 1.96
    """Repulsion at `h_min_m`, m/s. The defaults stop a vehicle that is asked for 0.7 m/s at 1.5 m."""

    def check(self) -> None:
        """Raise ConfigError when fields contradict each other."""
        _check_rising(self, ("h_min_m", "h_mid_m", "h_max_m"))
        _check_rising(self, ("v_mid_m_s", "v_max_m_s"))


class LimiterConfig(Section, frozen=True, kw_only=True):
    """The repulsive law, what the vehicle can stop in, where it may fly, and what it does without sight.

    Distances are from the vehicle's centre.
    """

    strategy: Literal["proposed", "tti", "dpf"] = "proposed"
    """Comfortable curve: Al-Kaff's (`proposed`), the time-to-impact hyperbola, or the Dynamic Parametric Field."""
    h_min_m: Positive = 0.8
    """Collision zone below this distance, m: the repulsion is at its maximum, and the braking bound ends here."""
    h_desired_m: Positive = 1.5
    """Where the vehicle comes to a stop in front of an obstacle, m (Al-Kaff 2019, figure 9)."""
    h_mid_m: Positive = 2.5
    """Transition zone below this distance, warning zone above, m."""
    h_max_m: Positive = 6.0
    """Safe zone above this distance, m: the curve takes nothing away."""
    band_m: Positive = 1.0
    """Below `h_max_m` the repulsion grows from nothing to the printed law within this distance, m."""
    v_max_m_s: Positive = 4.0
    """Repulsion at `h_min_m`, m/s; the larger, the flatter the approach far off and the steeper near."""
    curve_lead_s: NonNegative = 0.4
    """How far ahead of the vehicle the curve is read, s: the time by which its speed lags behind a falling setpoint,
    measured in flight before a barrel at 2.1 m/s."""
    dpf: DpfConfig = DpfConfig()
    """Parameters of the strategy `dpf`."""

    stop_delay_s: NonNegative = 0.5
    """Time before the vehicle begins to slow down, s. Tuned with `stop_deceleration_m_s2` on PX4's step from 2 m/s to
    rest, which covered 2.29 m: 2 · 0.5 + 2²/(2 · 1.6) = 2.25 m."""
    stop_deceleration_m_s2: Positive = 1.6
    """Deceleration that it then reaches on average, m/s²."""
    brake_lead: NonNegative = 1.0
    """A vehicle that is faster than its bound is asked for so much less than the bound, per m/s of excess: it brakes,
    and does not back away, for the setpoint comes back with the excess."""
    brake_integral_1_s: NonNegative = 4.0
    """The same for the excess summed over time, 1/s. PX4's velocity loop holds on to the drag that it has learnt to
    overcome; without this, with the drag of its built-in quadrotor, a stop from 2 m/s would run on by another metre."""
    brake_m_s: NonNegative = 2.5
    """Most that is asked for below the bound, m/s."""
    margin_m: NonNegative = 0.2
    """What measured distances may be too long by, and a stop longer than the formula, m; the braking bound keeps it
    beside `h_min_m`."""
    foresight_s: NonNegative = 4.0
    """How far ahead the path of a moving obstacle is kept free, s: what it takes to give way across it by h_min at
    `push_back_m_s`, and the vehicle's response. With less the vehicle, seeing only the near part of a slanting path,
    gives way along it."""
    push_back_m_s: NonNegative = 0.5
    """Fastest retreat from what is nearer than `h_desired_m`, m/s; 0 for none."""
    push_back_gain_1_s: NonNegative = 1.0
    """Retreat per metre below `h_desired_m`, 1/s, beside what the curve gives."""

    floor_m: NonNegative | None = None
    """Least height above home, m; None for none."""
    ceiling_m: Positive | None = None
    """Greatest height above home, m; None for none."""
    fence: tuple[tuple[float, float], ...] = ()
    """Corners (north, east) of the polygon that the vehicle stays in, m from home, in order, at least three; inward
    corners are allowed; empty for none."""

    required: bool = False
    """Whether a vehicle without fresh obstacle data must stand still from the start. A source that has spoken once is
    required in any case: a sensor that died is no free view."""
    late_s: Positive = 0.3
    """A source that sees speaks again within so much of its last picture, its period and its delay, s; from then on the
    speed falls, and reaches `unseen_speed_m_s` at `stale_s`."""
    stale_s: Positive = 0.5
    """A source that is silent for longer, or sees nothing, is blind, s."""
    memory_s: Positive = 3.0
    """How long a place that was looked at counts as known, s."""
    remember_s: Positive = 20.0
    """How long a standing obstacle that went out of view is remembered, s."""
    unseen_speed_m_s: NonNegative = 0.7
    """Fastest speed towards directions that no source looks at, m/s."""
    unseen_stop_s: Positive = 1.0
    """A blind source leaves `unseen_speed_m_s` for so long, s; within another second it falls to zero."""
    keep_s: Positive = 6.0
    """How long a walking obstacle that went out of view, or whose source is silent, is kept, moving on, s; within
    `h_max_m` of the vehicle `remember_s`: what should be here by now is not forgotten."""
    spread_m_s: NonNegative = 0.2
    """How fast the place of a kept obstacle becomes uncertain, whatever was seen of it: people turn, m/s."""
    velocity_error_m_s: NonNegative = 0.35
    """How wrong the velocity of a walking obstacle may be that was seen once, m/s; seen more often, as much less as the
    mean over its last second in view is better."""

    def check(self) -> None:
        """Raise ConfigError when fields contradict each other."""
        _check_rising(self, ("h_min_m", "h_desired_m", "h_mid_m", "h_max_m"))
        if self.h_max_m - self.band_m < self.h_desired_m:
            raise ConfigError(
                f"band_m: got {self.band_m}, expected at most h_max_m - h_desired_m = "
                f"{self.h_max_m - self.h_desired_m:g}, or the vehicle would not stop at h_desired_m"
            )
        if self.h_min_m + self.margin_m > self.h_desired_m:
            raise ConfigError(
                f"margin_m: got {self.margin_m}, expected at most h_desired_m - h_min_m = "
                f"{self.h_desired_m - self.h_min_m:g}, or the braking bound would not reach h_desired_m"
            )
        _check_rising(self, ("late_s", "stale_s"))
        if self.floor_m is not None and self.ceiling_m is not None and self.floor_m >= self.ceiling_m:
            raise ConfigError(f"floor_m: got {self.floor_m}, expected less than ceiling_m = {self.ceiling_m}")
        if 0 < len(self.fence) < 3:
            raise ConfigError(f"fence: got {len(self.fence)} corners, expected at least three, or none")


def _check_rising(section: Section, names: tuple[str, ...]) -> None:
    values = [getattr(section, name) for name in names]
    if any(a >= b for a, b in itertools.pairwise(values)):
        raise ConfigError(f"{' < '.join(names)}: got {', '.join(map(str, values))}; expected rising values")
