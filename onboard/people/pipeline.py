"""From pictures to people: regions, poses, filter, association, tracks; no bus, no clock but for the poses' budget.

```python
people = PeoplePipeline(PeopleConfig(), colour_camera, depth_camera, PoseNetwork(blazepose(blazepose_file())))
findings = people.look(Frame(picture, capture_ns, depth_m, depth_ns, vehicle))
```
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from common.geometry.camera import Camera
from onboard.people.appearance import look_of
from onboard.people.bodies import VehiclePose
from onboard.people.depth import UnusableDepth
from onboard.people.detector import PersonDetector
from onboard.people.memory import Memory
from onboard.people.pipeline_config import PeopleConfig
from onboard.people.pose import STANDING_M, Picture, Pose, PoseFinder, PoseNetwork
from onboard.people.pose_filter import evidence, foreshortened_refusal, pose_refusal, same_body
from onboard.people.regions import Box
from onboard.people.sights import DepthSearch, Sight
from onboard.people.tracks import Detection, PeopleTracker, Track
from onboard.people.trim import trimmed
from onboard.people.walk import Walks
from onboard.people.watch import Spot, Watch

_SEEN = 0.6
"""Joints of this confidence are in the picture."""
_SMOOTHING = 0.2
"""Share of the newest look's duration in what the next one is expected to take."""
_MOST_OWED = 2.0
"""Looks that took longer than the budget are made up for, up to so many budgets: a machine that stood still is no
reason to stop looking."""
_LEAST_LEFT = 0.5
"""A look is begun when so much of what it is expected to take is left of the budget."""


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
        if not len(seen) or (stands and not self.fresh):  # whose limbs may be elsewhere by now
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
    stage_ms: dict[str, float] = field(default_factory=dict)
    """How long `regions`, `poses` and `tracks` took, ms."""


class PeoplePipeline:
    """Finds and follows people through the pictures of one camera.

    Args:
        config: how its stages work.
        colour: calibration of the colour camera; None where it is not known.
        depth: calibration of its depth camera; None without one.
        network: finds joints in an upright crop.
        detector: regions where depth gives none.
        clock: seconds, for the budget of the poses and the stages' times; without one no time passes for them.
    """

    def __init__(
        self,
        config: PeopleConfig,
        colour: Camera | None,
        depth: Camera | None,
        network: PoseNetwork,
        detector: PersonDetector | None = None,
        clock: Callable[[], float] | None = None,
    ):
        self.config = config
        self.tracker = PeopleTracker(config.association)
        self.walks = Walks()
        self.watch = Watch(config.watch)
        self._detector, self._clock = detector, clock or _standstill
        self.fit(colour, depth)
        self._finder = PoseFinder(network)
        self._memory = Memory()
        self._left_ms = 0.0  # of the budget; less than nothing after looks that took longer
        self._look_ms = {False: 0.0, True: 0.0}  # of a region that is new, of one whose pose is known
        self._last_ns: int | None = None

    @property
    def tracks(self) -> Sequence[Track]:
        """Everybody who was seen and not forgotten."""
        return self.tracker.tracks

    def fit(self, colour: Camera | None, depth: Camera | None) -> None:
        """Take other calibrations from now on: of pictures of another size."""
        self._colour, self._search = colour, None
        self._blind = _why_without_depth(self.config, colour, depth)
        if colour is not None and depth is not None and not self._blind:
            self._search = DepthSearch(self.config, colour, depth)

    def merge(self, number: int, into: int) -> None:
        """Take two people for one.

        Raises:
            KeyError: there is none of one of the numbers.
        """
        self.tracker.merge(number, into)
        self._memory.forget(number)
        self.watch.merged(number, into)

    def look(self, frame: Frame) -> Findings:
        """People in a picture. What is missing or wrong is stated in `reason`; what can be done without it is done."""
        refusal = self._refusal(frame)
        if refusal:
            return Findings((), False, refusal)
        self._last_ns = frame.capture_ns
        start = self._clock()
        sights, with_depth, reason = self._sights(frame)
        between = self._clock()
        spots = self.watch.follow(sights, frame.capture_ns)
        self._recognise(spots, frame)
        looks = self._pose(spots, frame, with_depth)
        posed = self._clock()
        people = self._identify(spots, frame)
        stages = {
            "regions": 1e3 * (between - start),
            "poses": 1e3 * (posed - between),
            "tracks": 1e3 * (self._clock() - posed),
        }
        return Findings(people, with_depth, reason, tuple(sights), looks, stages)

    def _refusal(self, frame: Frame) -> str:
        """Why a picture cannot be used at all."""
        shape, colour = frame.colour.shape, self._colour
        if len(shape) != 3 or shape[2] != 3 or frame.colour.dtype != np.uint8:
            return f"picture: got {frame.colour.dtype} of shape {shape}, expected uint8 of (height, width, 3), BGR"
        if colour is not None and shape[:2] != (colour.height, colour.width):
            return f"picture: got {shape[1]}x{shape[0]} px, expected {colour.width}x{colour.height} of its calibration"
        if self._last_ns is not None and frame.capture_ns <= self._last_ns:
            return f"picture: its time {frame.capture_ns} ns is not after the last one's, {self._last_ns} ns"
        return ""

    def _sights(self, frame: Frame) -> tuple[list[Sight], bool, str]:
        """Regions, whether from depth, and what was missing."""
        reason = self._blind or self._mismatch(frame)
        if not reason and self._search is not None and frame.depth is not None:
            try:
                expected = self._memory.expected(self.tracker.tracks, self.walks, frame.capture_ns)
                sights = self._search.find(frame.depth, frame.vehicle, expected)
            except UnusableDepth as unusable:
                reason = str(unusable)
            else:
                no_pose = "no pose of the vehicle at the picture's time: places are in the camera's frame alone"
                return sights, True, "" if frame.vehicle is not None else no_pose
        if self._detector is None:
            return [], False, f"{reason}; without a detector (people.detector) nobody can be found"
        return [Sight(region) for region in self._detector.find(frame.colour)], False, reason

    def _mismatch(self, frame: Frame) -> str:
        if frame.depth is None or frame.depth_ns is None:
            return "no depth with the picture"
        apart_ms = abs(frame.depth_ns - frame.capture_ns) / 1e6
        if apart_ms <= self.config.pair_ms:
            return ""
        return f"picture and depth are {apart_ms:.0f} ms apart, expected {self.config.pair_ms:g} ms or less"

    def _recognise(self, spots: Sequence[Spot], frame: Frame) -> None:
        """Take those who are back where they were, with the colours that they had, for themselves: their next pose need
        not be waited for."""
        tracks = {track.number: track for track in self.tracker.tracks}
        for spot in spots:
            body, pose = spot.sight.body, spot.sight.pose
            if spot.pose is not None or body is None or pose is None:
                continue
            track = tracks.get(body.number)
            if track is None or not track.confirmed or track.seen_ns >= frame.capture_ns:
                continue
            look = look_of(frame.colour, spot.sight.region, pose)
            if self.tracker.recognises(track, look, pose, frame.capture_ns):
                spot.recognised(pose, look, track.number, frame.capture_ns)

    def _pose(self, spots: Sequence[Spot], frame: Frame, with_depth: bool) -> int:
        """Look for poses, the most urgent regions first, within the budget; how many were looked at."""
        budget_ms, looks = self.config.watch.budget_ms, 0
        # What the last picture's looks took too long is missing now, so that the budget holds over time.
        self._left_ms = min(self._left_ms + budget_ms, budget_ms)
        for spot in self.watch.due(spots, frame.capture_ns) if budget_ms else spots:
            begun, known = self._clock(), spot.expected(frame.capture_ns) is not None
            expected_ms = self._look_ms[known]
            if budget_ms and self._left_ms < _LEAST_LEFT * min(expected_ms, budget_ms):
                break
            self._pose_of(spot, spots, frame, with_depth)
            looks += 1
            took_ms = 1e3 * (self._clock() - begun)
            self._left_ms = max(self._left_ms - took_ms, -_MOST_OWED * budget_ms)
            self._look_ms[known] += (_SMOOTHING if expected_ms else 1.0) * (took_ms - expected_ms)
        return looks

    def _pose_of(self, spot: Spot, spots: Sequence[Spot], frame: Frame, with_depth: bool) -> None:
        config, t_ns, colour = self.config.pose_filter, frame.capture_ns, self._colour
        focal_px = 0.5 * (colour.fx_px + colour.fy_px) if with_depth and colour is not None else None

        def stands(pose: Pose) -> bool:
            """Whether a pose is that of somebody who stands: from above, another way round would say no more."""
            if focal_px is None or (spot.sight.region.height_m or 0.0) <= STANDING_M:
                return False
            return not foreshortened_refusal(pose, spot.sight.region, config, focal_px)

        pose = self._finder.find(frame.colour, spot.sight.region, spot.expected(t_ns), stands)
        refusal = pose_refusal(pose, spot.sight.region, config, focal_px)
        if refusal and colour is not None and pose.presence >= config.sure_presence:
            part = trimmed(spot.sight, pose, colour, frame.vehicle)
            if part is not None:
                again = self._finder.again(frame.colour, pose)
                if not pose_refusal(again, part.region, config, focal_px):
                    spot.sight, pose, refusal = part, again, ""
        others = [other.pose_now(t_ns) for other in spots if other is not spot and self.watch.carries(other, t_ns)]
        if not refusal and any(other is not None and same_body(pose, other) for other in others):
            refusal = "the pose of somebody beside"
        if refusal:
            spot.refused(refusal, t_ns)
        else:
            says = evidence(pose, spot.sight.region, config, focal_px)
            spot.found(pose, look_of(frame.colour, spot.sight.region, pose), says, t_ns)

    def _identify(self, spots: Sequence[Spot], frame: Frame) -> tuple[Found, ...]:
        """Who is in the picture."""
        t_ns = frame.capture_ns
        shown = self.watch.shown(spots, t_ns)
        numbers = self.tracker.update([_detection(spot, t_ns) for spot in shown], t_ns)
        while doubles := self.tracker.doubles():
            newer, older = doubles[0]
            self.merge(newer, older)
            numbers = [older if number == newer else number for number in numbers]
        tracks = {track.number: track for track in self.tracker.tracks}
        self.walks.keep(tracks)
        found = []
        for spot, number in zip(shown, numbers, strict=True):
            spot.number = number
            spot.confirmed = number in tracks and tracks[number].confirmed
            pose = spot.pose_now(t_ns)
            if number not in tracks or pose is None:
                continue
            if spot.sight.ned_p_m is not None and not spot.sight.region.at_edge:
                self.walks.add(number, t_ns, spot.sight.ned_p_m)
            fresh = spot.posed_ns == t_ns
            self._memory.see(spot, self._colour, frame.vehicle, t_ns)
            # A pose cannot be moved along with a region that is cut anew in every picture.
            placed = fresh or spot.sight.pose is not None or not spot.sight.region.cut or spot.keeps_shape
            if placed and not tracks[number].dismissed:
                found.append(Found(number, spot.sight, pose, fresh, frame.colour.shape[1::-1]))
        return tuple(found)


def _standstill() -> float:
    return 0.0


def _why_without_depth(config: PeopleConfig, colour: Camera | None, depth: Camera | None) -> str:
    if not config.use_depth:
        return "depth is switched off (people.use_depth)"
    if colour is None:
        return "no intrinsics of the colour camera: depth cannot be registered with it"
    return "" if depth is not None else "no depth camera, or no intrinsics of it"


def _detection(spot: Spot, t_ns: int) -> Detection:
    pose, look = spot.pose_now(t_ns), spot.look
    if pose is None or look is None:
        raise RuntimeError("a spot without a pose counts as a person")  # `Watch.carries` rules it out
    sight = spot.sight
    return Detection(
        pose,
        look,
        sight.ned_p_m,
        sight.ned_p_cov_m2,
        known=spot.number or None,
        fresh=spot.posed_ns == t_ns,
        evidence=spot.evidence,
        followed=sight.body is not None and sight.body.number == spot.number,
        whole=not sight.region.at_edge,
    )
