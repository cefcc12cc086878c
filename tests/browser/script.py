"""What a scripted vehicle says, for a test to decide; and what a barrel looks like to its limiter."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from threading import Event
from typing import Literal

from common.messages import (
    SECTORS,
    ApproachTarget,
    LimiterStatus,
    MemberBox,
    Obstacle,
    Person,
    PersonDetection,
    PreflightItem,
    Reply,
    SearchStatus,
    Vec3,
)

CHECKS = (
    PreflightItem(name="position", ok=True, detail="fused, 0.3 m"),
    PreflightItem(name="camera", ok=True, detail="20.0 Hz, 45 ms old"),
)
RANGE_M = 8.0


def barrel(distance_m: float, zone: str, allowed_m_s: float, why: str) -> LimiterStatus:
    """A barrel ahead of a vehicle that looks about north-east (0.5 rad), 79 degrees of view; the rest is unseen."""
    sectors = []
    for k in range(SECTORS):
        off = math.remainder((k + 0.5) * math.radians(5.0) - 0.5, math.tau)
        near = distance_m / math.cos(off) if abs(off) < math.atan(0.4 / distance_m) else RANGE_M
        sectors.append(near if abs(off) < math.radians(39.0) else -1.0)
    return LimiterStatus(
        zone=zone,  # type: ignore[arg-type]
        distance_m=distance_m,
        ned_direction=(math.cos(0.5), math.sin(0.5), 0.0),
        asked_m_s=2.1,
        allowed_m_s=allowed_m_s,
        why=why,  # type: ignore[arg-type]
        source="obstacles/depth",
        h_min_m=0.8,
        h_desired_m=1.5,
        h_mid_m=2.5,
        h_max_m=6.0,
        sectors_m=tuple(sectors),
        seen=tuple(distance >= 0.0 for distance in sectors),
    )


@dataclass
class Script:
    """What the vehicle says; a test changes it while it runs."""

    pictures: bool = True
    """Whether pictures go out."""
    status: bool = True
    """Whether helm speaks."""
    state: str = "hold"
    reason: str = "hovering at the anchor"
    source: str = "helm"
    mode: str = "OFFBOARD"
    armed: bool = True
    in_air: bool = True
    battery: float = 0.87
    zone: str = "safe"
    distance_m: float = 8.4
    track_state: Literal["idle", "tracking", "lost", ""] = "tracking"
    """Empty: no track goes out."""
    preflight: tuple[PreflightItem, ...] = CHECKS
    position_m: Vec3 = (2.0, 1.0, -5.0)
    moving: bool = True
    """Whether the car drives; else it stands in the middle."""
    obstacles: tuple[Obstacle, ...] = ()
    limiter: LimiterStatus | None = None
    approach: ApproachTarget | None = None
    members: tuple[MemberBox, ...] = ()
    """Where each of the follower's trackers sees the car; its fused box is the first one's."""
    search: SearchStatus | None = None
    people: tuple[Person, ...] = ()
    detections: tuple[PersonDetection, ...] = ()
    """Who is in each picture."""
    faces: dict[int, bytes] = field(default_factory=dict)
    """Picture of each person, JPEG."""
    replies: dict[str, Reply] = field(default_factory=dict)
    """Answer to each command; `done` where there is none."""
    held: dict[str, Event] = field(default_factory=dict)
    """Commands that take until the test says so."""
