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
    speed_m_s: Positive = 3.0
    """Velocity: largest speed that is asked for, m/s."""
    acceleration_m_s2: Positive = 3.0
    """Largest acceleration that is wanted of the vehicle, m/s²: 17 degrees of tilt; towards the target no more than the
    picture's edge allows. With 2 the error of a chase was a seventh larger: who may not brake hard flies past."""
    acceleration_min_m_s2: Positive = 0.9
    """Acceleration towards the target that is allowed even with it at the picture's edge, m/s²: 5 degrees of tilt.
    With 1.3 a car that came out from under a deck at the edge, 2 m below, was tilted out of the picture again."""
    slew_m_s2: Positive = 2.5
    """Velocity: largest change of the asked velocity, m/s²; helm allows as much."""
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
    effort: Positive = 0.0004
    """Orientation: weight of the square of the commanded acceleration's rate against that of the distance, s⁶; less is
    faster. Tuned, as is the next, on three roads and parked cars that the benchmarks' seeds do not draw."""
    velocity_effort: Positive = 0.001
    """Velocity: the same; more, since helm limits how fast a velocity request changes."""
    tilt_max_m_s2: Positive = 3.5
    """Orientation: largest acceleration that is asked for, what balances wind and drag included, m/s²: 20 degrees."""
    tilt_lag_s: Positive = 0.1
    """Time constant of each of the two lags between commanded and flown acceleration, s. Read off the simulated
    autopilot's step, which is held to PX4's; the same holds for the delay."""
    tilt_delay_s: NonNegative = 0.09
    """From the setpoint until it begins to act in the autopilot, s."""
    request_delay_s: NonNegative = 0.025
    """From a picture's capture to the setpoint that comes of it, s, until it has been measured."""
    autopilot_p_1_s: Positive = 1.8
    """Velocity: the autopilot's own loop, acceleration per velocity error, 1/s. This and the next two are those of the
    loop that fits PX4's steps at both drags; ArduPilot's defaults are near."""
    autopilot_i_1_s2: NonNegative = 0.4
    """Velocity: its integral, 1/s²."""
    autopilot_d: NonNegative = 0.2
    """Velocity: its damping by the acceleration."""
    picture_rad: Positive = 0.004
    """Standard deviation of the target's direction in a picture, rad: 1.8 pixels. A parked car scatters by 1.1, half of
    it shared by the next picture."""
    picture_m: NonNegative = 0.003
    """The part of it that does not grow with the height, m."""
    target_agility_m_s2: Positive = 1.5
    """Standard deviation of the target's acceleration, m/s² (Singer's model)."""
    target_agility_s: Positive = 1.0
    """How long such an acceleration lasts, s."""
    tilt_doubt_m_s2: Positive = 0.15
    """What commanded and flown tilt differ by, random walk over a second, m/s²."""
    offset_drift_m_s2: Positive = 0.1
    """Drift of what the autopilot adds to a request (its integral), random walk over a second, m/s²."""
    drag_1_s: NonNegative = 0.3
    """Drag by velocity and mass, 1/s: between a real quadrotor's, 0.1, and that of PX4's built-in one, 1. What it is
    wrong by is learned as wind."""
    wind_drift_m_s2: Positive = 0.15
    """Drift of what wind and drag do, random walk over a second, m/s²."""
    velocity_doubt_m_s: Positive = 0.03
    """Standard deviation of the velocity estimate's error, m/s …"""
    velocity_doubt_s: Positive = 1.0
    """… and how long one lasts, s."""
    attitude_doubt_rad: NonNegative = 0.009
    """Standard deviation of the attitude estimate's error that gyroscopes disprove, rad; 0 takes the estimate as it
    is."""
    attitude_doubt_s: Positive = 1.0
    """How long such an error lasts, s."""
    turn_memory_s: Positive = 1.5
    """Time constant with which the target's turn ends of itself while it is seen, s …"""
    turn_unseen_s: Positive = 0.5
    """… and while it is not: at an occluder's edge a turn may just have ended, or the edge have feigned it."""
    turn_agility_rad_s2: Positive = 2.0
    """Target's angular acceleration that its heading's filter reckons with (white, standard deviation), rad/s²."""
    turn_measurement_rad: Positive = 0.03
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
    process_m_s2: Positive = 0.6
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
