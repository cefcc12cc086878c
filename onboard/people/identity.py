"""A person in one picture, and a person who was seen."""

from __future__ import annotations

from dataclasses import dataclass

from common.geometry.rotation import Array
from onboard.people.appearance import Look
from onboard.people.pose import Pose


@dataclass(frozen=True)
class Detection:
    """A person in one picture."""

    pose: Pose
    """Joints."""
    look: Look
    """Colours."""
    ned_p_m: Array | None = None
    """(3,) position; None without depth or vehicle pose."""
    ned_p_cov_m2: Array | None = None
    """(3, 3) its covariance."""
    known: int | None = None
    """Number that unbroken sight of the region suggests; None where it was not seen before."""
    fresh: bool = True
    """Whether pose and look come from this picture. What does not is taken for the person that `known` names."""
    evidence: float = 1.0
    """What the pose says, in looks (`pose_filter.evidence`)."""
    followed: bool = False
    """Whether what is not fresh was found where the body must be."""
    whole: bool = True
    """Whether the region keeps clear of the picture's edge: the middle of what is cut off lies elsewhere."""
    stands: bool = False
    """Whether they may be on their feet, and so elsewhere next time."""


@dataclass(frozen=True)
class Track:
    """A person who was seen."""

    number: int
    """Identity, from 1; never given twice."""
    confirmed: bool
    """Whether it was seen in enough pictures to be believed."""
    hits: int
    """Pictures in which it was seen."""
    looks: tuple[Look, ...]
    """Gallery: looks that differ."""
    pose: Pose
    """The last one."""
    seen_ns: int
    """When that was."""
    first_ns: int
    """When it was first seen."""
    ned_p_m: Array | None
    """(3,) where; stays when the person is out of sight; None where it was never known."""
    ned_p_cov_m2: Array | None
    """(3, 3) covariance at `seen_ns`."""
    dismissed: bool = False
    """Whether it is nobody: it keeps its looks, so that it is not taken for somebody new."""
    merged: tuple[int, ...] = ()
    """Numbers that turned out to be this person."""
    evidence: float = 0.0
    """What the looks said together."""
    stands: bool = False
    """Whether they were ever on their feet, as far as it was seen."""
