"""Which region is which of the picture before, and which are worth the time that a pose takes.

A pose costs as much as everything else together, ten times over. So people not believed yet come first, then new
regions, then what has changed or waited longest; what was no person is looked at ever more rarely until it changes. A
person's region goes on being that person for a while without another pose.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from onboard.people.association import assign
from onboard.people.pipeline_config import WatchConfig
from onboard.people.pose import STANDING_M, Pose
from onboard.people.pose_filter import same_body
from onboard.people.regions import Region
from onboard.people.sights import Sight
from onboard.people.spot import Spot

_NEW, _DOUBTED, _RECOGNISED = 1e6, 1e9, 4.0
_DOUBTS = 2
"""So many looks in a row that find nobody end the hurry about somebody not believed yet."""
_STANDS = 3.0
"""Hardly anything but people stands on legs so narrow: they come before what lies, which planks do, too."""
_PARTLY = 0.25
"""What is new at the picture's edge can wait for what is new and whole."""
_LYING_M, _LONG_M, _WIDE_M, _HEAD_M2 = 0.6, (1.1, 2.6), 0.25, 0.08
"""Height, lengths and least width of somebody who lies, m; largest head from above, m²."""
_ONE = 0.5
"""Boxes that share more than this (IoU) are of one person."""
_LIES = 0.5
"""Who reaches to less than this share of a standing height does not stand."""
_LIKELY_WAIT = 0.4
"""Share of the wait until the next look that such a region waits."""
_LONGER = 1.5
"""Each look that finds nobody makes the wait for the next one so much longer."""


class Watch:
    """The regions of late.

    Args:
        config: what counts as the same, as changed, as due.
    """

    def __init__(self, config: WatchConfig):
        self.config = config
        self.spots: list[Spot] = []
        """Every region that is not forgotten."""

    def follow(self, sights: Sequence[Sight], t_ns: int) -> list[Spot]:
        """The spot of each sight of a picture, in their order; new ones for what was not there before. Without places,
        a second box of somebody who has one is left out."""
        limit_ns = round(self.config.forget_s * 1e9)
        self.spots = [spot for spot in self.spots if t_ns - spot.seen_ns <= limit_ns]
        costs = np.array([[self._distance(spot, sight, t_ns) for sight in sights] for spot in self.spots])
        found: dict[int, Spot] = {}
        for row, column in assign(costs, 1.0):
            found[column] = self.spots[row]
            found[column].there(sights[column], t_ns)
        people = [spot.sight for spot in found.values() if spot.number]
        for column, sight in enumerate(sights):
            if column not in found and not any(_same_box(sight, other) for other in people):
                found[column] = Spot(sight, t_ns)
                self.spots.append(found[column])
        return [found[column] for column in sorted(found)]

    def due(self, spots: Sequence[Spot], t_ns: int) -> Iterator[Spot]:
        """Those that are to be looked at now, the most urgent first."""
        rated = sorted(((self._urgency(spot, t_ns), -index) for index, spot in enumerate(spots)), reverse=True)
        return (spots[-index] for urgency, index in rated if urgency >= 1.0)

    def carries(self, spot: Spot, t_ns: int) -> bool:
        """Whether a region still counts as the person that was found in it."""
        return spot.pose is not None and t_ns - spot.posed_ns <= self.config.carry_s * 1e9

    def shown(self, spots: Sequence[Spot], t_ns: int) -> list[Spot]:
        """Spots of a picture that count as people, nobody twice: without depth a detector gives somebody two boxes now
        and then; the one that was there first stays."""
        followed = {id(spot) for spot in self.spots}
        carried = [spot for spot in spots if id(spot) in followed and self.carries(spot, t_ns)]
        placeless = [spot for spot in carried if spot.sight.ned_p_m is None]
        kept: list[tuple[Sight, Pose]] = []
        twice: set[int] = set()
        for spot in sorted(placeless, key=lambda s: (not s.confirmed, s.number or math.inf, -s.posed_ns)):
            pose = spot.pose_now(t_ns)
            if pose is None or any(same_body(pose, p) or _same_box(spot.sight, sight) for sight, p in kept):
                twice.add(id(spot))
            else:
                kept.append((spot.sight, pose))
        self.spots = [spot for spot in self.spots if id(spot) not in twice]
        return [spot for spot in carried if id(spot) not in twice]

    def joined(self, spot: Spot, parts: Sequence[Spot]) -> None:
        """Some regions turned out to be parts of another: theirs is the number, the one that was there first."""
        if not parts:
            return
        eldest = min((spot, *parts), key=lambda s: (not s.confirmed, s.number or math.inf))
        spot.number, spot.confirmed = eldest.number, eldest.confirmed
        gone = {id(part) for part in parts}
        self.spots = [s for s in self.spots if id(s) not in gone]

    def merged(self, number: int, into: int) -> None:
        """A person turned out to be another; of two regions the other's stays."""
        if any(spot.number == into for spot in self.spots):
            self.spots = [spot for spot in self.spots if spot.number != number]
        for spot in self.spots:
            if spot.number == number:
                spot.number = into

    def _distance(self, spot: Spot, b: Sight, t_ns: int) -> float:
        """0 for the same place, 1 where the same region cannot be."""
        a = spot.sight
        if b.body is not None and spot.number:
            return 0.0 if spot.number == b.body.number else 1.0
        if spot.number and spot.posed is not None and _other_height(spot.posed.region, b.region):
            return 1.0
        if a.ned_p_m is not None and b.ned_p_m is not None:
            return float(np.linalg.norm((a.ned_p_m - b.ned_p_m)[:2])) / self.config.same_m
        return (1.0 - iou(spot.box_at(t_ns), b.region.box_px)) / max(1.0 - self.config.same_iou, 1e-9)

    def _urgency(self, spot: Spot, t_ns: int) -> float:
        """1 and more: due."""
        stands = spot.sight.ned_trunk_m is not None
        likely = stands or _likely(spot.sight)
        if spot.looked is None and spot.pose is None:
            whole = stands or not spot.sight.region.at_edge
            return _NEW * (_STANDS if stands else 2.0 if likely else 1.0) * (1.0 if whole else _PARTLY)
        if spot.looked is None:
            return _RECOGNISED
        if spot.refusals and spot.looked.region.at_edge and not spot.sight.region.at_edge:
            return _NEW * (2.0 if likely else 1.0)
        age_s = (t_ns - spot.looked_ns) / 1e9
        if spot.number and not spot.confirmed and spot.refusals < _DOUBTS and not self._follows(spot):
            return _DOUBTED + age_s  # before what is new: one short look, and they are believed
        person = spot.confirmed and self.carries(spot, t_ns)
        changed = self._changed(spot.looked, spot.sight)
        if person and spot.sight.region.cut:
            return 2.0 + age_s  # what is missing of it changes from picture to picture
        if person:
            return 1.0 + age_s / self.config.refresh_s if changed else age_s / self.config.refresh_s
        wait_s = self.config.again_s * _LONGER ** (0 if changed else min(max(spot.refusals - 1, 0), 10))
        share = _LIKELY_WAIT / _STANDS if stands else _LIKELY_WAIT if likely else 1.0
        return age_s / min(wait_s * share, self.config.again_most_s)

    @staticmethod
    def _follows(spot: Spot) -> bool:
        """Whether the next picture alone will tell that somebody is to be believed."""
        return spot.evidence >= 2.0 and spot.sight.body is not None

    def _changed(self, before: Sight, now: Sight) -> bool:
        config, share = self.config, self.config.changed_share
        if before.ned_p_m is None or now.ned_p_m is None:
            return iou(before.region.box_px, now.region.box_px) < 1.0 - share
        moved = float(np.linalg.norm((now.ned_p_m - before.ned_p_m)[:2])) > config.changed_m
        sizes = [(r.length_m or 0.0, r.width_m or 0.0, r.height_m or 0.0) for r in (before.region, now.region)]
        return moved or any(abs(a - b) > share * max(a, b, 0.2) for a, b in zip(*sizes, strict=True))


def _likely(sight: Sight) -> bool:
    """Whether a region has the size of somebody who lies, or the top of somebody upright: worth an earlier look."""
    region = sight.region
    if region.length_m is None or region.width_m is None or region.height_m is None or region.crown is None:
        return False
    crown = region.crown
    lies = region.height_m < _LYING_M and _LONG_M[0] < region.length_m < _LONG_M[1] and region.width_m > _WIDE_M
    upright = region.height_m >= _LYING_M and crown.area_m2 < _HEAD_M2 and crown.below_m2 > crown.area_m2
    return lies or upright


def _other_height(a: Region, b: Region) -> bool:
    """Whether one of two whole regions stands and the other lies: what is left where somebody stood is not them."""
    if a.height_m is None or b.height_m is None or a.at_edge or b.at_edge:
        return False
    low, high = sorted((a.height_m, b.height_m))
    return high > STANDING_M and low < _LIES * high


def iou(a: Sequence[float], b: Sequence[float]) -> float:
    """Share of the area of two boxes (x, y, width, height) that both have, 0 to 1."""
    width = min(a[0] + a[2], b[0] + b[2]) - max(a[0], b[0])
    height = min(a[1] + a[3], b[1] + b[3]) - max(a[1], b[1])
    common = max(width, 0) * max(height, 0)
    return common / (a[2] * a[3] + b[2] * b[3] - common)


def _same_box(a: Sight, b: Sight) -> bool:
    """Whether two regions without places are boxes of one person."""
    return a.ned_p_m is None and b.ned_p_m is None and iou(a.region.box_px, b.region.box_px) > _ONE
