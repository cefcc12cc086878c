"""A region over time: where it is, who was found in it, and what pose they have now."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from common.geometry.rotation import Array
from onboard.people.appearance import Look
from onboard.people.pose import Pose
from onboard.people.regions import Box
from onboard.people.sights import Sight

_NEWEST_WAY = 0.5
"""Share of the newest picture in how fast a box moves."""
_SAME_SHAPE, _CUT_SHAPE = 0.4, 0.1
"""How much either side of a box may differ from that with the last pose; and where the depth picture cuts it anew in
every picture."""
_FULL_EVERY = 3
"""Every so many looks both ends of the body are tried again."""
_LEAST_SCALE, _MOST_SCALE = 0.6, 1.6


@dataclass
class Spot:
    """A region over time."""

    sight: Sight
    """Where it is now."""
    seen_ns: int
    """When it was last there."""
    way_px_s: Array = field(default_factory=lambda: np.zeros(2))
    """(2,) how fast its box moves in the picture, where places are not known, px/s."""
    looked: Sight | None = None
    """Where it was when it was last looked at; None before that."""
    looked_ns: int = 0
    """When that was."""
    looks: int = 0
    """How often it was looked at."""
    refusals: int = 0
    """How often in a row it was no person."""
    refusal: str = ""
    """Why it was none, the last time."""
    pose: Pose | None = None
    """The last pose of a person in it."""
    look: Look | None = None
    """The colours with it."""
    evidence: float = 0.0
    """How much that says, in looks."""
    posed: Sight | None = None
    """Where it was then."""
    posed_ns: int = 0
    """When that was."""
    number: int = 0
    """Who it is; 0 for nobody."""
    confirmed: bool = False
    """Whether that person is believed."""

    def expected(self, t_ns: int) -> Pose | None:
        """The pose to look for, as far as it need not be looked for anew."""
        anew = self.refusals or self.looks % _FULL_EVERY == 0
        return None if anew else self.pose_now(t_ns)

    def there(self, sight: Sight, t_ns: int) -> None:
        """It is in a picture again."""
        if sight.ned_p_m is None and t_ns > self.seen_ns:
            moved = _middle(sight.region.box_px) - _middle(self.sight.region.box_px)
            self.way_px_s = self.way_px_s + _NEWEST_WAY * (moved / ((t_ns - self.seen_ns) / 1e9) - self.way_px_s)
        self.sight, self.seen_ns = sight, t_ns

    def box_at(self, t_ns: int) -> tuple[float, float, float, float]:
        """Where its box would be had it gone on as before."""
        x, y, width, height = self.sight.region.box_px
        dx, dy = self.way_px_s * ((t_ns - self.seen_ns) / 1e9)
        return x + dx, y + dy, width, height

    def found(self, pose: Pose, look: Look, evidence: float, t_ns: int) -> None:
        """A look found a person; how much it says, in looks."""
        self._looked(t_ns)
        self.evidence = evidence
        self.pose, self.look, self.posed, self.posed_ns = pose, look, self.sight, t_ns
        self.refusals, self.refusal = 0, ""

    def recognised(self, pose: Pose, look: Look, number: int, t_ns: int) -> None:
        """Somebody believed is where they were, with the colours that they had."""
        self.pose, self.look, self.posed, self.posed_ns = pose, look, self.sight, t_ns - 1
        self.number, self.confirmed = number, True

    def forget(self) -> None:
        """It is something else than it was: to be looked at anew."""
        self.pose = self.look = self.posed = self.looked = None
        self.number, self.confirmed, self.refusals, self.looks = 0, False, 0, 0

    def refused(self, reason: str, t_ns: int) -> None:
        """A look found none."""
        self._looked(t_ns)
        self.refusals += 1
        self.refusal = reason

    @property
    def keeps_shape(self) -> bool:
        """Whether the box has about the sides that it had with the last pose. Who stands moves arms and legs."""
        if self.posed is None:
            return False
        if self.sight.ned_trunk_m is not None and not self.sight.region.cut:
            return True
        before, now = self.posed.region.box_px, self.sight.region.box_px
        most = _CUT_SHAPE if self.sight.region.cut else _SAME_SHAPE
        return all(abs(now[k] - before[k]) <= most * before[k] for k in (2, 3))

    def pose_now(self, t_ns: int) -> Pose | None:
        """The pose in the present picture: found there, or seen there from where the body is in space, or, where that
        is not known, moved there with the box; None without any."""
        if self.pose is None or self.posed is None or self.posed_ns == t_ns:
            return self.pose
        if self.sight.pose is not None:
            return self.sight.pose
        before, now = self.posed.region.box_px, self.sight.region.box_px
        scale = math.sqrt(now[2] * now[3] / (before[2] * before[3]))
        scale = min(max(scale, _LEAST_SCALE), _MOST_SCALE)
        joints = (self.pose.joints_px - _middle(before)) * scale + _middle(now)
        return Pose(joints, self.pose.confidence, self.pose.presence)

    def _looked(self, t_ns: int) -> None:
        self.looked, self.looked_ns = self.sight, t_ns
        self.looks += 1


def _middle(box: Box) -> Array:
    return np.array([box[0] + 0.5 * box[2], box[1] + 0.5 * box[3]])
