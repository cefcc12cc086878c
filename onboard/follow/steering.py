"""From a box to a request: where the target is, how it moves, and the law. The same in flight and in a simulation."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from common.geometry.camera import Camera
from common.messages import Request
from common.tracking.base import Box, center_of
from onboard.follow.config import FollowConfig
from onboard.follow.law import FollowLaw, Vehicle
from onboard.follow.others import Others
from onboard.follow.sight import Sight, TargetPlace, in_camera, in_ned, looks_ahead, whole_from_m
from onboard.follow.solid import Solid
from onboard.follow.things import DepthView, Mask
from onboard.fusion.config import DepthConfig
from onboard.fusion.foreseen import Foreseen, core_of
from onboard.fusion.lasting import Lasting
from onboard.proximity.pose import Pose

Array = NDArray[np.float64]
_NEAREST_M = 0.3
"""Least distance along the optical axis at which a target is expected in the picture, m."""
_ASIDE_M, _ASIDE_M_S2 = 0.5, 1.5
"""How far beside where he is foreseen he may be, m, and half of the acceleration with which he gets further, m/s²: who
walks beside him is further off."""
_INSISTED_S, _BREAK_S = 0.4, 0.2
"""How long several trackers must have agreed where he cannot be, or one have seen him while his place is empty, for his
foreseen place to be given up, s, and the longest break in that."""
_UNSEEN_S, _FOUND_S, _FOUND_BREAK_S = 0.3, 0.2, 0.1
"""After how long unseen one tracker alone must have him, and for how long, to be flown after, s, and the longest break
in that: what it takes for him beside the edge of a screen passes in a picture or two."""
_COVERED = 0.2
"""Share of the middle of his place from which somebody else covers him."""
_WITH_DEPTH_NS = 1_000_000_000
"""For how long a target whose distance the depth camera has measured counts as one that it can measure, ns: what begins
to cover him leaves little of him to measure."""
_SIZE_MEMORY_S = 3.0
"""Time constant with which the size over ground follows the box, s: what slides before a target makes it smaller, and a
tracker alone keeps its own size while the target's changes in the picture."""
_MOST_GROWN = 1.25
"""How many times as large, or as small, as at the first the size over ground may become."""


class Steering:
    """Flies after one target.

    Args:
        config: poles, limits and times.
        depth: of the distance.
        camera: calibration of the pictures that the boxes are of.
    """

    def __init__(self, config: FollowConfig, depth: DepthConfig, camera: Camera):
        self._config, self._depth, self._camera = config, depth, camera
        self._law = FollowLaw(config, looks_ahead(camera))
        self._place = TargetPlace(config, looks_ahead(camera))
        self.reset()

    def calibrate(self, camera: Camera) -> None:
        """Take another calibration, which says anew how far the target is; what is kept is kept."""
        if camera != self._camera:
            self._camera = camera
            self._stand()
            self._sight = Sight(camera, self._config, self._depth)

    def reset(self) -> None:
        """Forget the target."""
        self._law.reset()
        self._place.reset()
        self._sight = Sight(self._camera, self._config, self._depth)
        self._stand()
        self._measured_ns = 0
        self._cover: Array | None = None
        self._insisted, self._found = Lasting(_BREAK_S), Lasting(_FOUND_BREAK_S)
        self._size_m: Array | None = None
        self._first_size_m = np.ones(2)
        self._with_depth_ns = -_WITH_DEPTH_NS
        self.why_not = ""
        """Why nothing is asked; empty while something is."""

    def _stand(self) -> None:
        """Begin anew with what stands there."""
        self._view = DepthView(self._camera)
        self._solid, self._others = Solid(self._view), Others(self._view)
        self._there: tuple[int, Mask, Foreseen] | None = None

    def restart(self, ned_v_m_s: Array | None = None, t_ns: int = 0) -> None:
        """The last request was not flown, but maybe another velocity. See `FollowLaw.restart`."""
        self._law.restart(ned_v_m_s, t_ns)

    def expected(self, t_ns: int, pose: Pose | None, depth_m: Array | None = None) -> Foreseen | None:
        """Where a picture should show the target by its own motion over ground and the vehicle's, and what is there.

        With what stands there, where a depth camera shows it. None without a target or a pose, behind the camera, or
        once it has been away for too long.

        Args:
            t_ns: capture stamp of the picture, ns.
            pose: the vehicle then.
            depth_m: depth picture that belongs to it, (h, w), m, 0 for none, at any size; None without a depth camera.
        """
        foreseen = self._foreseen(t_ns, pose, depth_m)
        state = self._place.at(t_ns)
        if foreseen is None or state is None or pose is None or depth_m is None:
            return foreseen
        free, reach_m = self._view.free(pose, depth_m), self._reach_m(t_ns)
        others, walls = self._others.look(t_ns, pose, depth_m, free, state.ned_p_m, reach_m)
        foreseen = replace(foreseen, others=others)
        # Who is seen may lean on a wall, or walk down a slope; who is unseen, or being covered, has not got there.
        away = t_ns - self._measured_ns > _UNSEEN_S * 1e9 or foreseen.covered_by_others > _COVERED
        if away and self._solid.stands_free(t_ns):
            foreseen = replace(foreseen, around=walls | ~free & (depth_m > 0.0))
        foreseen = replace(foreseen, solid=self._solid.find(free, foreseen, reach_m))
        self._there = t_ns, free, foreseen
        return foreseen

    def _foreseen(self, t_ns: int, pose: Pose | None, depth_m: Array | None) -> Foreseen | None:
        state = self._place.at(t_ns)
        if state is None or pose is None or self._size_m is None:
            return None
        if t_ns - self._measured_ns > self._config.coast_s * 1e9:
            return None
        seen = in_camera(self._camera, pose, state.ned_p_m)
        if seen[2] < _NEAREST_M:
            return None
        (u, v), (width, height) = self._camera.project(seen[None])[0], self._size_m / seen[2]
        box = float(u - width / 2), float(v - height / 2), float(width), float(height)
        shape = (self._camera.height, self._camera.width)
        with_depth = self._measured_ns - self._with_depth_ns < _WITH_DEPTH_NS
        covered_m = math.nan if self._cover is None else float(in_camera(self._camera, pose, self._cover)[2])
        return Foreseen(box, float(seen[2]), self._gone_m(t_ns), depth_m, shape, with_depth, covered_m)

    def step(
        self,
        t_ns: int,
        box: Box | None,
        pose: Pose | None,
        vehicle: Vehicle | None,
        depth_m: Array | None = None,
        *,
        sure: bool = False,
    ) -> Request | None:
        """What to ask of helm; None, and `why_not`, without a target, a pose, or once it has been away for too long.

        Args:
            t_ns: capture stamp of the picture, ns.
            box: x, y, width, height of the target in it, px; None while it is not seen.
            pose: the vehicle then; None while unknown.
            vehicle: the vehicle then, with its rates.
            depth_m: depth picture that belongs to it, (h, w), m, 0 for none, at any size; None without a depth camera.
            sure: whether several trackers agree on the box.
        """
        self.why_not = "" if pose is not None and vehicle is not None else "no vehicle state for this picture"
        if box is not None and pose is not None:
            self._look(t_ns, box, pose, depth_m, sure)
        if pose is not None:
            self._watch_cover(t_ns, pose, depth_m)
        state = self._place.at(t_ns)
        away_s = (t_ns - self._measured_ns) / 1e9
        if state is not None and vehicle is not None and away_s <= self._config.coast_s:
            self.why_not = ""
            return self._law.ask(state, vehicle, t_ns)
        self.why_not = self.why_not or f"target not seen for {min(away_s, 999.0):.1f} s"
        return None

    def _watch_cover(self, t_ns: int, pose: Pose, depth_m: Array | None) -> None:
        """Note where what covers the target is: while it goes on unseen, he may come to be as near as that."""
        if self._measured_ns == t_ns:
            self._cover = None
        foreseen = self._foreseen(t_ns, pose, depth_m)
        if foreseen is None or not math.isfinite(foreseen.before_m):
            return
        x, y, width, height = foreseen.box
        ray = self._camera.rays([(x + width / 2, y + height / 2)])[0]
        self._cover = in_ned(self._camera, pose, ray * foreseen.before_m)

    def _beside_m(self, box: Box, pose: Pose, t_ns: int) -> float:
        """How far the target is foreseen beside the line of sight to a box's middle, m; 0 of a first one."""
        state = self._place.at(t_ns)
        if state is None or not looks_ahead(self._camera):
            return 0.0
        ray = self._camera.rays([center_of(box)])[0]
        across = np.cross(in_camera(self._camera, pose, state.ned_p_m), ray)
        return float(np.linalg.norm(across) / np.linalg.norm(ray))

    def _reach_m(self, t_ns: int) -> float:
        """How far aside of where he is foreseen somebody can be, m."""
        return _ASIDE_M + self._gone_m(t_ns)

    def _gone_m(self, t_ns: int) -> float:
        """How far from where he is foreseen somebody can have got since he was last seen, m."""
        away_s = (t_ns - self._measured_ns) * 1e-9
        return _ASIDE_M_S2 * away_s**2

    def _core(self, t_ns: int, box: Box, pose: Pose, depth_m: Array | None) -> Array | None:
        """Depth of the target in the middle of a box, (h, w), m, 0 where something else is there; None without any."""
        if depth_m is None:
            return None
        state, about_m = self._place.at(t_ns), math.nan
        if state is not None and t_ns - self._measured_ns <= self._config.coast_s * 1e9:
            about_m = float(in_camera(self._camera, pose, state.ned_p_m)[2])
        return core_of(depth_m, box, (self._camera.height, self._camera.width), about_m, self._gone_m(t_ns))

    def _waits(self, t_ns: int, sure: bool) -> bool:
        """Whether one tracker alone has only just found him again."""
        had_s = self._found.note(True, t_ns)
        return not sure and self._size_m is not None and t_ns - self._measured_ns > _UNSEEN_S * 1e9 and had_s < _FOUND_S

    def _place_is_empty(self, t_ns: int, pose: Pose, depth_m: Array | None) -> bool:
        """Whether the depth camera shows that he is not where he is foreseen."""
        there = self._there
        foreseen = there[2] if there is not None and there[0] == t_ns else self.expected(t_ns, pose, depth_m)
        return foreseen is not None and foreseen.empty

    def _look(self, t_ns: int, box: Box, pose: Pose, depth_m: Array | None, sure: bool) -> None:
        there = None if self._there is None or self._there[0] != t_ns else self._there
        foreseen = self._foreseen(t_ns, pose, depth_m) if there is None else there[2]
        # What is there is nearer or farther than he can be, or beside: nobody steps aside so quickly.
        refused = foreseen is not None and bool(foreseen.excluded({"it": box}))
        refused |= self._beside_m(box, pose, t_ns) > self._reach_m(t_ns)
        waits = self._waits(t_ns, sure)
        insists = refused and (sure or self._place_is_empty(t_ns, pose, depth_m))
        if self._insisted.note(insists, t_ns) >= _INSISTED_S:
            self._place.reset()
            self._others.forget()
            foreseen = there = self._cover = None
        elif refused or waits:
            return
        core = self._core(t_ns, box, pose, depth_m)
        found = self._sight.place(t_ns, box, pose, core)
        if found is None:
            self.why_not = self._sight.why_not
            return
        if self._measured_ns == 0 and self._config.keep == "whole" and looks_ahead(self._camera):
            level_m = float(np.hypot(*(found - pose.ned_p_m)[:2]))
            self._law.least_m = whole_from_m(self._camera, box, pose, level_m, self._config.slew_m_s2)
        self._place.measure(found, t_ns)
        if there is not None:
            self._solid.learn(t_ns, box, there[1], there[2])
            if sure:
                self._others.learn(t_ns, box, found)
        size_m = np.array(box[2:]) * in_camera(self._camera, pose, found)[2]
        share = -math.expm1(-(t_ns - self._measured_ns) * 1e-9 / _SIZE_MEMORY_S)
        if self._size_m is None:
            self._size_m = self._first_size_m = size_m
        size_m = self._size_m + share * (size_m - self._size_m)
        self._size_m = np.clip(size_m, self._first_size_m / _MOST_GROWN, self._first_size_m * _MOST_GROWN)
        self._measured_ns = t_ns
        if core is not None and int(np.count_nonzero(core)) > core.size / 2:
            self._with_depth_ns = t_ns
