"""What goes into the search for people and what comes out of it, a picture at a time."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from onboard.people.bodies import VehiclePose
from onboard.people.pose import STANDING_M, Picture, Pose
from onboard.people.regions import Box
from onboard.people.sights import Sight

_SEEN = 0.6
"""Joints of this confidence are in the picture."""


@dataclass(frozen=True)
class Frame:
    """What the sensors gave at one time."""

    colour: Picture
    """(H, W, 3) BGR."""
    capture_ns: int
    """When the picture was taken, vehicle clock."""
    depth: NDArray | None = None
    """(H, W); uint16 in mm, or float in m; None without."""
    depth_ns: int | None = None
    """When that was taken."""
    vehicle: VehiclePose | None = None
    """Where the vehicle was at `capture_ns`; None where it is not known."""


@dataclass(frozen=True)
class Found:
    """A person in the picture."""

    number: int
    """Who it is."""
    sight: Sight
    """Region and place."""
    pose: Pose
    """Joints in this picture."""
    fresh: bool
    """Whether they were found in it, rather than moved along from an earlier one."""
    picture_px: tuple[int, int] | None = None
    """Width and height of the picture, where the box ends."""

    @property
    def box_px(self) -> Box:
        """x, y, width, height in the picture, of the region and of the joints that are seen: to the region, an arm on
        the ground is floor, and the depth picture may end before the person does."""
        x, y, w, h = self.sight.region.box_px
        seen = self.pose.joints_px[self.pose.confidence > _SEEN]
        if self.picture_px is not None:
            seen = seen[((seen >= 0) & (seen < self.picture_px)).all(axis=1)]
        stands = (self.sight.region.height_m or 0.0) > STANDING_M
        moves = stands and not self.fresh and not self.sight.region.cut
        if not len(seen) or moves:  # whose limbs may be elsewhere by now, and would be seen there
            return x, y, w, h
        low = np.minimum(np.floor(seen.min(axis=0)).astype(int), (x, y))
        high = np.maximum(np.ceil(seen.max(axis=0)).astype(int), (x + w, y + h))
        return int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1])


@dataclass(frozen=True)
class Findings:
    """What one picture showed."""

    people: tuple[Found, ...]
    """People in it who were not dismissed."""
    with_depth: bool
    """Whether depth was used."""
    reason: str
    """Why nothing can be found, or only with less than usual; empty when all is well."""
    sights: tuple[Sight, ...] = ()
    """Every region that might have been a person."""
    looks: int = 0
    """Regions that were looked at for a pose."""
    floor_m: float | None = None
    """Distance of the camera from the floor, m; None without depth."""
    stage_ms: dict[str, float] = field(default_factory=dict)
    """How long `regions`, `poses` and `tracks` took, ms."""
