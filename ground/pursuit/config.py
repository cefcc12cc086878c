"""Settings of the pursuit (`[pursuit]`)."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from common.config import ConfigError, NonNegative, Positive, Section


class PursuitConfig(Section, frozen=True, kw_only=True):
    """The chase law (Teulière 2011, section III), in its velocity form and in its orientation form."""

    output: Literal["velocity", "orientation"] = "velocity"
    """What is asked of helm: a velocity, or as in the paper an orientation, which goes out as the horizontal
    acceleration that it causes."""
    position_gain_1_s: Positive = 0.9
    """Outer loop: asked closing speed per metre of error, 1/s (Kp of eq. 9)."""
    velocity_gain: NonNegative = 0.45
    """Inner loop: share of the relative velocity's error that is added to the command (its P part)."""
    integral_gain_1_s: NonNegative = 0.15
    """Inner loop: its I part, 1/s."""
    integral_limit_m_s: NonNegative = 0.4
    """Most that the I part may add, m/s."""
    lead_s: NonNegative = 0.15
    """How far ahead of the picture the target is aimed at, s: the loop's own delay."""
    speed_m_s: Positive = 2.5
    """Largest speed that is asked for, m/s."""
    acceleration_m_s2: Positive = 2.0
    """Largest change of the asked velocity, m/s²."""
    acceleration_min_m_s2: Positive = 1.3
    """Change of the asked velocity towards the target that is allowed even with it at the picture's edge, m/s²."""
    view_margin_rad: NonNegative = 0.14
    """Distance from the edge of the picture at which the target's centre is kept, rad: half a target and some."""
    coast_s: Annotated[float, msgspec.Meta(ge=0, le=3)] = 3.0
    """How long an unseen target is flown after on its last velocity, s; then the vehicle stands."""
    climb_m: NonNegative = 3.0
    """How much higher than at the chase's beginning the vehicle may fly, to keep a target at the picture's edge in view
    and to find a lost one, m; 0 leaves the height alone."""
    climb_after_s: NonNegative = 0.7
    """How long a target is unseen before the vehicle climbs, s: an occlusion is shorter."""
    climb_m_s: Positive = 0.8
    """Fastest climb for it, m/s."""
    sink_m_s: Positive = 0.4
    """Fastest descent after it, m/s."""
    tilt_effort: Positive = 0.01
    """Orientation: weight of the squared acceleration against the squared position error, s⁴; less is faster."""
    tilt_max_m_s2: Positive = 3.5
    """Orientation: largest acceleration that is asked for, what balances wind and drag included, m/s²: 20 degrees."""
    tilt_lag_s: Positive = 0.1
    """Orientation: time constant of each of the two lags between commanded and flown acceleration, s. Read off the
    simulated autopilot's step, which is held to PX4's; the same holds for the delay."""
    tilt_delay_s: NonNegative = 0.115
    """Orientation: from capture until the command begins to act, s: 25 ms to the setpoint, 90 ms in the autopilot."""
    tilt_measurement_m: Positive = 0.02
    """Orientation: standard deviation of the relative position in a picture, m."""
    target_agility_m_s2: Positive = 0.5
    """Orientation: standard deviation of the target's acceleration, m/s² (Singer's model)."""
    target_agility_s: Positive = 1.5
    """Orientation: how long such an acceleration lasts, s."""
    disturbance_s: Positive = 0.7
    """Orientation: time constant with which wind, drag and a slant of the attitude estimate are learned, s."""
    turn_memory_s: Positive = 1.5
    """How long the target's turn goes on unseen, s."""
    turn_agility_rad_s2: Positive = 2.0
    """Target's angular acceleration that its heading's filter reckons with (white, standard deviation), rad/s²."""
    turn_measurement_rad: Positive = 0.08
    """Standard deviation of the target's heading in a picture, rad."""
    yaw_gain_1_s: NonNegative = 1.2
    """Heading rate per radian between target and vehicle, 1/s (eq. 10); 0 leaves the heading alone."""
    yaw_rate_rad_s: Positive = 0.8
    """Largest heading rate that is asked for, rad/s."""
    yaw_doubt_rad: Positive = 0.5
    """With a larger standard deviation of the target's orientation the heading is left alone, rad."""
    altitude: Literal["hold", "scale"] = "hold"
    """Height: the vehicle's own, held (with `climb_m` above it, to keep or to find a target), or from the target's size
    in the picture."""
    altitude_m: NonNegative = 0.0
    """Scale: wanted height over the target, m; 0 keeps the size that the target has at the start."""
    target_size_m: NonNegative = 0.0
    """Scale: square root of the target's area as seen from above, m; 0: unknown, and its size at the start is kept."""
    altitude_gain_1_s: NonNegative = 0.4
    """Scale: vertical speed per metre of error, 1/s, within `climb_m_s` and `sink_m_s`."""
    altitude_memory_s: Positive = 0.6
    """Scale: time over which the size is averaged, s."""
    target_height_m: NonNegative = 0.3
    """Height of the target's visible top above the ground at home, m."""
    process_m_s2: Positive = 1.5
    """Target's acceleration that its velocity filter reckons with (white, standard deviation), m/s²."""
    measurement_m: Positive = 0.06
    """Standard deviation of the target's measured position, m."""
    tracker: str = "particle_filter"
    """Name of the tracker."""
    model: str = ""
    """Picture of the target, for `outrider do find`: an image file that the target fills, with its front at the top;
    empty: there is none, and the target is chosen by a box."""
    seed: int = 1
    """Seed of the tracker's randomness."""
    history_s: Positive = 1.5
    """How long vehicle states and pictures are kept for looking up a capture time, s."""

    def check(self) -> None:
        """Raise ConfigError when a height is wanted over a target of unknown size, or the other way round."""
        if (self.altitude_m > 0.0) != (self.target_size_m > 0.0):
            raise ConfigError(
                f"altitude_m: got {self.altitude_m} with target_size_m {self.target_size_m}; expected both, for that "
                "height over a target of that size, or neither, to keep the size that it has at the start"
            )
