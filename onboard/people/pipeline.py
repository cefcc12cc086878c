"""From pictures to people: regions, poses, filter, association, tracks; no bus, no clock but for the poses' budget.

```python
people = PeoplePipeline(PeopleConfig(), colour_camera, depth_camera, PoseNetwork(blazepose(blazepose_file())))
findings = people.look(Frame(picture, capture_ns, depth_m, depth_ns, vehicle))
```
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from common.geometry.camera import Camera
from onboard.people.appearance import look_of, similarity
from onboard.people.beyond import one_beyond, whole
from onboard.people.budget import PoseBudget
from onboard.people.depth import UnusableDepth
from onboard.people.detector import PersonDetector
from onboard.people.examine import examine
from onboard.people.findings import Findings, Found, Frame
from onboard.people.identity import Detection, Track
from onboard.people.memory import Memory
from onboard.people.pipeline_config import PeopleConfig
from onboard.people.pose import STANDING_M, Pose
from onboard.people.pose_finder import PoseFinder
from onboard.people.pose_network import PoseNetwork
from onboard.people.sights import DepthSearch, Sight
from onboard.people.spot import Spot
from onboard.people.tracks import PeopleTracker
from onboard.people.trim import is_part
from onboard.people.walk import Walks
from onboard.people.watch import Watch


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
        self._budget = PoseBudget(config.watch.budget_ms)
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
        self._let_go(spots, frame)
        self._recognise(spots, frame)
        looks = self._pose(spots, frame, with_depth)
        posed = self._clock()
        people = self._identify(spots, frame)
        stages = {
            "regions": 1e3 * (between - start),
            "poses": 1e3 * (posed - between),
            "tracks": 1e3 * (self._clock() - posed),
        }
        floor_m = self._search.floor_m if with_depth and self._search is not None else None
        return Findings(people, with_depth, reason, tuple(sights), looks, floor_m, stages)

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
                sights = self._whole(self._search.find(frame.depth, frame.vehicle, expected), frame, self._search)
            except UnusableDepth as unusable:
                reason = str(unusable)
            else:
                no_pose = "no pose of the vehicle at the picture's time: places are in the camera's frame alone"
                return sights, True, "" if frame.vehicle is not None else no_pose
        if self._detector is None:
            return [], False, f"{reason}; without a detector (people.detector) nobody can be found"
        return [Sight(region) for region in self._detector.find(frame.colour)], False, reason

    @staticmethod
    def _whole(sights: Sequence[Sight], frame: Frame, search: DepthSearch) -> list[Sight]:
        """Regions with what of them lies beyond the depth picture, each once; of two the one that comes first."""
        found: list[Sight] = []
        for sight in sights:
            region = whole(frame.colour, sight.region, search.registration)
            if not any(one_beyond(region, other.region) for other in found):
                found.append(replace(sight, region=region))
        return found

    def _mismatch(self, frame: Frame) -> str:
        if frame.depth is None or frame.depth_ns is None:
            return "no depth with the picture"
        apart_ms = abs(frame.depth_ns - frame.capture_ns) / 1e6
        if apart_ms <= self.config.pair_ms:
            return ""
        return f"picture and depth are {apart_ms:.0f} ms apart, expected {self.config.pair_ms:g} ms or less"

    def _let_go(self, spots: Sequence[Spot], frame: Frame) -> None:
        """Nobody goes on as a region that is shaped and coloured otherwise than they were: what they lay beside is."""
        least = 1.0 - self.config.association.gate
        for spot in spots:
            pose = spot.pose_now(frame.capture_ns)
            if pose is None or spot.look is None or spot.sight.pose is not None or spot.keeps_shape:
                continue
            if similarity(spot.look, look_of(frame.colour, spot.sight.region, pose)) < least:
                spot.forget()

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
        budget, looks = self._budget, 0
        budget.next_picture()
        for spot in self.watch.due(spots, frame.capture_ns) if budget.budget_ms else spots:
            begun, known = self._clock(), spot.expected(frame.capture_ns) is not None
            if not budget.allows(known):
                break
            self._pose_of(spot, spots, frame, with_depth)
            looks += 1
            budget.took(known, 1e3 * (self._clock() - begun))
        return looks

    def _pose_of(self, spot: Spot, spots: Sequence[Spot], frame: Frame, with_depth: bool) -> None:
        t_ns, colour = frame.capture_ns, self._colour if with_depth else None
        around = [other for other in spots if other is not spot]
        poses = [other.pose_now(t_ns) for other in around if self.watch.carries(other, t_ns)]
        others = [pose for pose in poses if pose is not None]
        verdict = examine(spot, others, frame, self._finder, self.config.pose_filter, colour)
        if verdict.refusal:
            spot.refused(verdict.refusal, t_ns)
            return
        spot.sight, pose = verdict.sight, verdict.pose
        spot.found(pose, look_of(frame.colour, spot.sight.region, pose), verdict.evidence, t_ns)
        if colour is not None and spot.sight.ned_trunk_m is None:
            self.watch.joined(spot, [other for other in around if _may_be_part(other, pose, colour, t_ns)])

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
        found: list[Found] = []
        for spot, number in zip(shown, numbers, strict=True):
            if number in {f.number for f in found}:
                continue  # a part of somebody
            spot.number = number
            spot.confirmed = number in tracks and tracks[number].confirmed
            pose = spot.pose_now(t_ns)
            if number not in tracks or pose is None:
                continue
            if spot.sight.ned_p_m is not None and not spot.sight.region.at_edge:
                self.walks.add(number, t_ns, spot.sight.ned_p_m)
            fresh = spot.posed_ns == t_ns
            self._memory.see(spot, self._colour, frame.vehicle, t_ns)
            # A pose cannot be moved along with a region that is cut anew in every picture, or that is a part of it now.
            placed = fresh or spot.sight.pose is not None or spot.keeps_shape
            if placed and not tracks[number].dismissed:
                found.append(Found(number, spot.sight, pose, fresh, frame.colour.shape[1::-1]))
        return tuple(found)


def _may_be_part(spot: Spot, pose: Pose, colour: Camera, t_ns: int) -> bool:
    """Whether somebody's number is carried on along with a part of the body whose pose was found now."""
    lies = spot.sight.ned_trunk_m is None and spot.posed_ns < t_ns
    return lies and spot.number > 0 and is_part(spot.sight, pose, colour)


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
        stands=sight.ned_trunk_m is not None or (sight.region.height_m or 0.0) > STANDING_M,
    )
