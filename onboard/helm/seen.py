"""What one control cycle of helm looks at."""

from __future__ import annotations

from dataclasses import dataclass

from onboard.helm.actions import ActionResult
from onboard.helm.arbiter import Candidate
from onboard.helm.preflight import CameraView
from onboard.helm.telemetry import Telemetry
from onboard.limiter.map import NOTHING_KNOWN
from onboard.limiter.surroundings import Surroundings


@dataclass(frozen=True)
class TrackView:
    """What helm knows of the chased target."""

    tracking: bool
    """Whether the tracker has it."""
    age_s: float
    """Time since the last word of the tracker, s."""


@dataclass(frozen=True)
class Seen:
    """All that one control cycle looks at."""

    telemetry: Telemetry
    """The autopilot."""
    results: tuple[ActionResult, ...] = ()
    """Actions that ended since the last cycle."""
    operator: Candidate | None = None
    """Newest request of the operator."""
    pursuit: Candidate | None = None
    """Newest request of the chase."""
    follow: Candidate | None = None
    """Newest request of the vehicle's own follower."""
    approach: Candidate | None = None
    """Newest request of the approach."""
    search: Candidate | None = None
    """Newest request of the search."""
    around: Surroundings | None = NOTHING_KNOWN
    """Obstacles and sight; None where the vehicle must stand still."""
    track: TrackView | None = None
    """The tracker; None when it has never spoken."""
    camera: CameraView | None = None
    """The camera; None without calibration."""
