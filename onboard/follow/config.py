"""Settings of the flight after a target by what the vehicle itself sees (`[follow]` of the vehicle file)."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from common.config import NonNegative, Positive, Section


class FollowConfig(Section, frozen=True, kw_only=True):
    """Camera, poles, limits and times."""

    camera: Literal["down", "front"] = "down"
    """Whose pictures are followed. One that looks more down than ahead is kept above the target; another faces it and
    keeps its distance."""
    natural_rad_s: Positive = 1.3
    """Natural frequency of the wanted poles of the place over ground, rad/s: the vehicle's dead time, 0.25 s with the
    picture's, costs a third of a radian of phase there."""
    damping: Positive = 1.0
    """Their damping."""
    lag_s: Positive = 0.55
    """Lag between an asked and a flown velocity, s: of PX4's step to 2 m/s at low drag, less its dead time."""
    yaw_rad_s: Positive = 1.8
    """Natural frequency of the heading's poles, rad/s."""
    yaw_lag_s: Positive = 0.35
    """Lag between an asked and a flown heading rate, s."""
    speed_m_s: Positive = 3.0
    """Fastest flight that is asked for, m/s."""
    climb_m_s: Positive = 0.6
    """Fastest climb or sink that is asked for, m/s."""
    slew_m_s2: Positive = 3.0
    """Largest change of the asked velocity, m/s²; the first one begins at the vehicle's own."""
    yaw_rate_rad_s: Positive = 0.8
    """Fastest turn that is asked for, rad/s."""
    height: Literal["hold", "scale"] = "hold"
    """Height: the vehicle's own, held; or the one that keeps the target's size (above it), or its height in the picture
    (facing it)."""
    facing_rad: Annotated[float, msgspec.Meta(gt=0, le=1.5)] = 1.0
    """Facing it: with the nose further off the target than this the vehicle only turns, rad."""
    course_m_s: Positive = 0.5
    """Above it: from this speed of the target on the vehicle turns as the target's course does, m/s."""
    target_height_m: NonNegative = 0.3
    """Height of the target's visible top above the ground at home, m (above it)."""
    distance_m: NonNegative = 0.0
    """Facing it: distance at the start, m; 0: from the depth camera, or else from where the target's foot meets level
    ground at home's height."""
    keep: Literal["whole", "first"] = "whole"
    """Facing it: the distance at the start, but no less than that from which the target stays whole in the picture with
    the nose as far up or down as `slew_m_s2` tilts it (a target that the edge cuts is read as farther, and flown nearer
    to); or the first one in any case."""
    process_m_s2: Positive = 1.5
    """Target's acceleration that its filter reckons with (white, standard deviation), m/s²."""
    measurement_m: Positive = 0.06
    """Standard deviation of the target's measured place, m."""
    coast_s: NonNegative = 2.0
    """How long an unseen target is flown after on its last velocity, s; then the vehicle hovers: nothing is asked."""
    unseen_memory_s: Positive = 0.5
    """Facing it: time constant with which the velocity of an unseen target is believed less, s; it may have stopped,
    and the vehicle flies at it."""
    answer_within_s: Positive = 0.02
    """How long a picture waits for its trackers, s; what comes later counts with its own capture time."""
    frozen_after_s: Positive = 2.0
    """A tracker that has not answered for so long is ended and begun anew, s."""
    hand_over_gap: Positive = 0.7
    """Beside the pursuit: distance from its target, in target sizes, at which all trackers are begun anew on it …"""
    hand_over_after_s: NonNegative = 0.7
    """… once it has lasted so long, s."""
    seed: int = 1
    """Seed of the trackers' randomness."""
