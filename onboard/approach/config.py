"""Settings of the approach to a person or an obstacle (`[approach]` of the vehicle file)."""

from __future__ import annotations

from typing import Annotated

import msgspec

from common.config import ConfigError, NonNegative, Positive, Section


class ApproachConfig(Section, frozen=True, kw_only=True):
    """How fast, how near, and what counts as the same thing in the next measurement."""

    distance_m: NonNegative = 0.0
    """Where the vehicle stops and holds, m from its centre; 0: `limiter.h_desired_m`. Never nearer than that."""
    speed_m_s: Positive = 1.0
    """Greatest speed towards it, m/s."""
    gain_1_s: Positive = 2.0
    """Speed asked per metre to go, 1/s. Steep: the limiter's curve does the gentle part."""
    hold_band_m: NonNegative = 0.1
    """Within this of the distance nothing is asked, m."""
    sink_m_s: NonNegative = 0.0
    """Greatest speed down towards what lies below, m/s; 0: the vehicle keeps its height. It sinks only above the thing,
    in a cone of 45 degrees, where a camera that looks down still sees it, and never climbs."""
    yaw_gain_1_s: Positive = 1.2
    """Heading rate per radian between nose and thing, 1/s."""
    yaw_rate_rad_s: Positive = 0.6
    """Greatest heading rate, rad/s."""
    facing_rad: Annotated[float, msgspec.Meta(gt=0, le=1.5)] = 1.0
    """The nose has to be nearer to it than this before the vehicle moves, rad: it flies where its camera looks."""
    ahead_rad: Annotated[float, msgspec.Meta(gt=0, le=3.2)] = 0.6
    """What lies within this of the nose counts as ahead, rad."""
    level_rad: Annotated[float, msgspec.Meta(gt=0, le=1.5)] = 0.5
    """What lies further above or below the horizon is not chosen by itself, rad: the ground is not."""
    gate_m: Positive = 0.8
    """A point this near to where the thing should be now is the thing, m."""
    gate_growth_m_s: NonNegative = 1.0
    """By how much the gate grows while it is not seen, m/s, up to twice its size."""
    spread_m: NonNegative = 0.5
    """Points within this of that one belong to the same thing, m; the vehicle closes in to the nearest of them."""
    seek_m: Positive = 1.5
    """A person who is out of sight is flown to where they were last seen, to within this beside it or the distance to
    hold, m; whoever is not seen from there is lost."""
    lost_after_s: Positive = 0.5
    """Not seen for so long it counts as lost, s: no request, so that the vehicle hovers."""
    forget_after_s: Positive = 3.0
    """Not seen for so long, a thing without a name is not recognised any more, s."""

    def check(self) -> None:
        """Raise ConfigError when fields contradict each other."""
        if self.lost_after_s >= self.forget_after_s:
            raise ConfigError(
                f"lost_after_s: got {self.lost_after_s}, expected less than forget_after_s = {self.forget_after_s}"
            )
