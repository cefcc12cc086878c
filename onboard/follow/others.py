"""Who and what else stands near the target, followed over ground, so that it is not taken for it later.

Whoever stands beside the target is somebody else, also once she has gone behind it or before it, whatever she wears.
The trackers know looks, and what is foreseen knows one place; each thing that the depth camera shows apart from the
target is followed here as it is, and while it is seen without a break nobody there is the target.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from common.tracking.base import Box, center_of
from onboard.follow.sight import in_camera, in_ned
from onboard.follow.things import DepthView, Mask, Thing
from onboard.fusion.motion import MotionFilter
from onboard.proximity.pose import Pose

Array = NDArray[np.float64]
_LEAST_M, _LEAST_M2 = 0.5, 0.05
"""Least height of a thing, m, and least area, m²."""
_WIDEST_M, _DEEP_M = 2.5, 0.35
"""Greatest width of one, m, and how much nearer or farther than its half a part of it may be, m."""
_MERGED = 1.5
"""How many times as large as before two things are that are seen as one."""
_WIDER = 1.3
"""How many times as wide as one of them: he, who may only be a little wider, is not her and somebody else."""
_SIZE_MEMORY = 0.1
"""Share of a picture in what is known of a thing's area."""
_GATE_M, _GATE_M_S2 = 0.5, 1.5
"""How far from where it should be it may be found, m, and half of the acceleration by which that grows unseen, m/s²."""
_WIDEST_GATE_M = 0.8
_UNSEEN_S, _MERGED_S = 0.5, 2.0
"""After how long unseen it is not known any more who it is, s, and after how long as a part of something larger."""
_HIS_M, _APART_M = 0.4, 0.6
"""How near to the target's place the target's own thing is, m, and from how far on another is another, m."""
_KNOWN_S = 0.3
"""For how long it must have stood apart from a target that was seen just then, s."""
_NOISE_M, _START_M_S, _DENSITY = 0.1, 1.5, 4.0
"""Standard deviation of a place, m, and of an unknown velocity, m/s; spectral density of the acceleration, m²/s³."""
_MERGED_NOISE_M = 0.3
"""The same of the place of who is a part of something larger, m."""
_LONGEST_STEP_S = 0.1


@dataclass
class _Track:
    """A thing that is followed."""

    motion: MotionFilter
    """Its place over ground, north and east, m."""
    seen_ns: int
    """When it was seen last."""
    apart_s: float = 0.0
    """For how long it has stood apart from the target."""
    area_m2: float = 0.0
    """How large it has been of late; infinite where the picture cut it."""
    thing: Thing | None = None
    """What it is in the newest picture."""
    place: Array = field(default_factory=lambda: np.zeros(3))
    """Where that is, (3,), NED, m."""
    width_m: float = 0.0
    """How wide that was, m."""
    side: float = 1.0
    """Whether it was right (1) or left (-1) of the target in the picture."""
    merged_ns: int = 0
    """When it was last a part of something larger, ns."""

    @property
    def known(self) -> bool:
        """Whether it is known not to be the target."""
        return self.apart_s >= _KNOWN_S


class Others:
    """Follows what else stands there.

    Args:
        view: finds things in depth pictures.
    """

    def __init__(self, view: DepthView):
        self._view = view
        self._tracks: list[_Track] = []
        self._own: Array | None = None
        self._learned_ns = 0

    def look(
        self, t_ns: int, pose: Pose, depth_m: Array, free: Mask, target_ned_m: Array, reach_m: float
    ) -> tuple[Mask | None, Mask]:
        """Follow everything into a new picture.

        Returns which of its pixels are of somebody else, (h, w), None: of nobody, and which are of walls.

        Args:
            t_ns: capture stamp, ns.
            pose: the vehicle then.
            depth_m: depth picture, (h, w), m, 0 for none.
            free: which of its pixels stand free of the floor, (h, w).
            target_ned_m: where the target is foreseen, (3,), NED, m.
            reach_m: how far from there it may be, m.
        """
        things, walls = self._sorted(depth_m, free)
        places = np.array([self._place(thing, pose) for thing in things]).reshape(-1, 3)
        self._assign(t_ns, things, places, np.asarray(target_ned_m)[:2], reach_m)
        self._hold(t_ns, things, pose, target_ned_m, depth_m)
        known = [track.thing for track in self._tracks if track.known and track.thing is not None]
        if not known:
            return None, walls
        return _marked(known, depth_m.shape), walls

    def learn(self, t_ns: int, box: Box, target_ned_m: Array) -> None:
        """The target is surely seen: what stands apart from it is somebody else.

        Where its own thing is not measured, as beyond the camera's range, what the picture shows beside it.

        Args:
            t_ns: capture stamp of the picture that was looked at last, ns.
            box: of the target in it, px.
            target_ned_m: its place, (3,), NED, m.
        """
        step_s = min(max(t_ns - self._learned_ns, 0) * 1e-9, _LONGEST_STEP_S)
        self._learned_ns = t_ns
        seen = self._own is not None and math.dist(self._own[:2], target_ned_m[:2]) < _HIS_M
        for track in self._tracks:
            if track.seen_ns != t_ns or track.thing is None or math.dist(track.place[:2], target_ned_m[:2]) < _APART_M:
                continue
            if seen or _beside(track.thing.box, box):
                track.apart_s += step_s

    def forget(self) -> None:
        """Who is who is not known any more."""
        self._tracks, self._own = [], None

    def _sorted(self, depth_m: Array, free: Mask) -> tuple[list[Thing], Mask]:
        """What stands there, and which pixels are of what goes on for longer, (h, w)."""
        things, walls = [], []
        for piece in self._view.things(depth_m, free):
            part = self._view.near_its_half(depth_m, piece, _DEEP_M)
            if part is not None and self._is_thing(part):
                things.append(part)
            elif piece.box[2] * piece.distance_m > _WIDEST_M * self._view.camera.fx_px:
                walls.append(piece)
        return things, _marked(walls, depth_m.shape)

    def _is_thing(self, thing: Thing) -> bool:
        m = thing.distance_m / self._view.camera.fx_px
        large = thing.box[3] * m >= _LEAST_M and thing.area * m**2 >= _LEAST_M2
        return large and thing.box[2] * m <= _WIDEST_M

    def _width_m(self, thing: Thing) -> float:
        return thing.box[2] * thing.distance_m / self._view.camera.fx_px

    def _area_m2(self, thing: Thing) -> float:
        return thing.area * (thing.distance_m / self._view.camera.fx_px) ** 2

    def _most_m2(self, thing: Thing, known_m2: float) -> float:
        """How large a thing that was as large as known is now, m²: soon larger, smaller only by and by.

        Infinite where the picture cuts it.
        """
        x, _, width, _ = thing.box
        if x <= 0.0 or x + width >= self._view.camera.width:
            return math.inf
        area_m2 = self._area_m2(thing)
        return area_m2 if math.isinf(known_m2) else max(area_m2, known_m2 + _SIZE_MEMORY * (area_m2 - known_m2))

    def _place(self, thing: Thing, pose: Pose) -> Array:
        ray = self._view.camera.rays([center_of(thing.box)])[0]
        return in_ned(self._view.camera, pose, ray * thing.distance_m)

    def _hold(self, t_ns: int, things: list[Thing], pose: Pose, target_ned_m: Array, depth_m: Array) -> None:
        """Who is known and not seen by herself may be a part of something larger, at that end of it where she stood."""
        camera = self._view.camera
        target_px = float(camera.project(in_camera(camera, pose, np.asarray(target_ned_m))[None])[0, 0])
        for track in self._tracks:
            if track.thing is not None:
                track.side = math.copysign(1.0, center_of(track.thing.box)[0] - target_px)
            elif track.known and t_ns - track.seen_ns < _MERGED_S * 1e9:
                near = [thing for thing in things if self._may_hold(thing, track, t_ns, pose)]
                track.thing = self._end_of(near[0], track, depth_m) if near else None
                if track.thing is not None:
                    track.merged_ns = t_ns
                    track.motion.predict(t_ns, np.full(2, _DENSITY))
                    track.motion.update(self._place(track.thing, pose)[:2], np.full(2, _MERGED_NOISE_M**2))

    def _may_hold(self, thing: Thing, track: _Track, t_ns: int, pose: Pose) -> bool:
        camera = self._view.camera
        there = in_camera(camera, pose, np.array([*track.motion.value_at(t_ns), track.place[2]]))
        if there[2] <= 0.0 or abs(thing.distance_m - there[2]) > _GATE_M:
            return False
        u, room_px = float(camera.project(there[None])[0, 0]), _WIDEST_GATE_M / there[2] * camera.fx_px
        left, width = thing.box[0], thing.box[2]
        return left - room_px < u < left + width + room_px and self._width_m(thing) > _WIDER * track.width_m

    def _end_of(self, thing: Thing, track: _Track, depth_m: Array) -> Thing | None:
        wide_px = track.width_m / thing.distance_m * self._view.camera.fx_px
        left, right = thing.box[0], thing.box[0] + thing.box[2]
        ends = (left, left + wide_px) if track.side < 0.0 else (right - wide_px, right)
        return self._view.between(depth_m, thing, *ends)

    def _assign(self, t_ns: int, things: list[Thing], places: Array, target: Array, reach_m: float) -> None:
        """Who is who: the assignment of the least distances, in each one's gates; what is nobody's is new."""
        unseen_s = [(t_ns - track.seen_ns) * 1e-9 for track in self._tracks]
        gates = np.array([reach_m, *(min(_GATE_M + _GATE_M_S2 * s**2, _WIDEST_GATE_M) for s in unseen_s)])
        ahead = np.array([target, *(track.motion.value_at(t_ns) for track in self._tracks)])
        off = np.linalg.norm(ahead[:, None] - places[None, :, :2], axis=2)
        for track in self._tracks:
            track.thing = None
        self._own, free = None, set(range(len(things)))
        inside = off < gates[:, None]
        areas = np.array([self._area_m2(thing) for thing in things])
        for row, track in enumerate(self._tracks, 1):
            inside[row] &= areas < _MERGED * track.area_m2
        for row, column in zip(*linear_sum_assignment(np.where(inside, off, 1e3)), strict=True):
            if not inside[row, column]:
                continue
            free.discard(int(column))
            if row == 0:
                self._own = places[column]
            else:
                self._see(self._tracks[row - 1], things[column], places[column], t_ns)
        self._tracks = [t for t in self._tracks if t_ns - max(t.seen_ns, t.merged_ns) < _UNSEEN_S * 1e9]
        self._tracks += [self._begun(things[column], places[column], t_ns) for column in free]

    def _begun(self, thing: Thing, place: Array, t_ns: int) -> _Track:
        motion = MotionFilter(place[:2], t_ns, np.full(2, _NOISE_M), np.full(2, _START_M_S))
        return _Track(motion, t_ns, 0.0, self._most_m2(thing, 0.0), thing, place, self._width_m(thing))

    def _see(self, track: _Track, thing: Thing, place: Array, t_ns: int) -> None:
        track.motion.predict(t_ns, np.full(2, _DENSITY))
        track.motion.update(place[:2], np.full(2, _NOISE_M**2))
        track.area_m2 = self._most_m2(thing, track.area_m2)
        track.thing, track.place, track.seen_ns, track.width_m = thing, place, t_ns, self._width_m(thing)


def _marked(things: list[Thing], shape: tuple[int, ...]) -> Mask:
    mask = np.zeros(shape, bool)
    for thing in things:
        mask[thing.where] |= thing.mask
    return mask


def _beside(a: Box, b: Box) -> bool:
    """Whether two boxes share no column."""
    return a[0] > b[0] + b[2] or b[0] > a[0] + a[2]
