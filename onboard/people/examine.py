"""Whose pose a region shows: found by the network, judged by the filter, and set beside what is known of those around.

The paper judges each region alone. A region may be more than a person, where they touch a thing, or less, where a
picture's edge cuts them; what tells is the pose itself, and the poses of people known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from common.geometry.camera import Camera
from onboard.people.config import PoseFilterConfig
from onboard.people.findings import Frame
from onboard.people.memory import CLEAR
from onboard.people.pose import STANDING_M, Pose
from onboard.people.pose_filter import evidence, foreshortened_refusal, pose_refusal, same_body
from onboard.people.pose_finder import PoseFinder
from onboard.people.sights import Sight
from onboard.people.spot import Spot
from onboard.people.trim import is_part, touches_more, trimmed


@dataclass(frozen=True)
class Verdict:
    """What a look at a region found."""

    sight: Sight
    """The region, or what of it is the person."""
    pose: Pose
    """The pose there."""
    refusal: str
    """Why it is not a person's; empty when it is."""
    evidence: float
    """How much it says, in looks."""


def examine(
    spot: Spot,
    others: Sequence[Pose],
    frame: Frame,
    finder: PoseFinder,
    config: PoseFilterConfig,
    colour: Camera | None = None,
) -> Verdict:
    """Look for a person in a region.

    Args:
        spot: the region, and what is known of it.
        others: poses of people known in other regions of the picture.
        frame: the picture.
        finder: finds poses.
        config: of the filter.
        colour: calibration of the colour camera; None where the regions are not from depth.
    """
    sight = spot.sight
    focal_px = None if colour is None else 0.5 * (colour.fx_px + colour.fy_px)

    def stands(pose: Pose) -> bool:
        """Whether a pose is that of somebody who stands: from above, another way round would say no more."""
        if focal_px is None or (sight.region.height_m or 0.0) <= STANDING_M:
            return False
        return not foreshortened_refusal(pose, sight.region, config, focal_px)

    pose = finder.find(frame.colour, sight.region, spot.expected(frame.capture_ns), stands)
    refusal = pose_refusal(pose, sight.region, config, focal_px)
    touches = refusal or (colour is not None and _touches_more(sight, pose, colour))
    if colour is not None and touches and pose.presence >= config.sure_presence:
        part = trimmed(sight, pose, colour, frame.vehicle)
        if part is not None:
            own = finder.again(frame.colour, pose) if refusal else pose
            if not pose_refusal(own, part.region, config, focal_px):
                sight, pose, refusal = part, own, ""
    says = evidence(pose, sight.region, config, focal_px)
    refusal = refusal or _somebody_else(spot, sight, pose, others, colour)
    known = sight.pose
    if not refusal and known is not None and _cut_off(sight, pose, known, says, colour):
        pose = known
    return Verdict(sight, pose, refusal, says)


def _touches_more(sight: Sight, pose: Pose, colour: Camera) -> bool:
    """Whether there is more in a region than a body; of those who stand `columns.py` knows better what is theirs."""
    return sight.ned_trunk_m is None and touches_more(sight, pose, colour)


def _cut_off(sight: Sight, pose: Pose, known: Pose, says: float, colour: Camera | None) -> bool:
    """Whether a doubtful pose of somebody known, of whom an edge cuts off a part, says no more than that they are still
    there: as they lie otherwise."""
    if colour is None or sight.ned_trunk_m is not None or says >= CLEAR or not sight.region.at_edge:
        return False
    return not (same_body(pose, known) and same_body(known, pose))


def _somebody_else(spot: Spot, sight: Sight, pose: Pose, others: Sequence[Pose], colour: Camera | None) -> str:
    """Why a pose that is a person's is not one of somebody new, or nothing when it is."""
    if any(same_body(pose, other) for other in others):
        return "the pose of somebody beside"
    if colour is None or sight.ned_trunk_m is not None:
        return ""  # who stands may well be before somebody else
    if not spot.confirmed and any(is_part(sight, other, colour) for other in others):
        return "a part of somebody beside"
    return ""
