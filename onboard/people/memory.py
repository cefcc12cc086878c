"""Where the bodies of people known are in space: what the next picture is searched for first."""

from __future__ import annotations

from collections.abc import Iterable

from common.geometry.camera import Camera
from common.geometry.rotation import Array
from onboard.people.bodies import Body, VehiclePose, body_of
from onboard.people.identity import Track
from onboard.people.spot import Spot
from onboard.people.walk import Walks

_IN_SIGHT_S = 0.5
"""Who was seen so lately is followed wherever they go."""

CLEAR = 2.0
"""A pose that says so much, in looks, is clear."""


class Memory:
    """Bodies by the numbers of their people."""

    def __init__(self) -> None:
        self._bodies: dict[int, Body] = {}

    def expected(self, tracks: Iterable[Track], walks: Walks, t_ns: int) -> list[Body]:
        """Bodies of those who may be where they were: who are in sight, and who are away and did not walk. Whoever is
        in none of the tracks is forgotten."""
        known = {track.number: track for track in tracks}
        self._bodies = {number: body for number, body in self._bodies.items() if number in known}

        def stays(number: int) -> bool:
            track = known[number]
            in_sight = (t_ns - track.seen_ns) / 1e9 < _IN_SIGHT_S
            return in_sight or (track.confirmed and not walks.walked(number))

        def walked(number: int) -> Array:
            away_s = (t_ns - known[number].seen_ns) / 1e9
            return walks.ned_v_m_s(number, t_ns) * min(away_s, _IN_SIGHT_S)

        return [body.shifted(walked(number)) for number, body in self._bodies.items() if stays(number)]

    def see(self, spot: Spot, camera: Camera | None, vehicle: VehiclePose | None, t_ns: int) -> None:
        """Note where somebody is in a picture. A pose that the colour picture may have cut off is no body to go by,
        unless it is clear and there is none yet.

        Args:
            spot: their region.
            camera: that took the picture.
            vehicle: where it was then.
            t_ns: when.
        """
        sight, number, pose = spot.sight, spot.number, spot.pose
        if sight.points_m is None or camera is None or vehicle is None:
            return
        whole = sight.region.cut or not sight.region.at_edge
        trusted = whole or (spot.evidence >= CLEAR and number not in self._bodies)
        if pose is not None and spot.posed_ns == t_ns and trusted:
            size = sight.area_m2, sight.region.height_m or 0.0
            self._bodies[number] = body_of(
                number, pose, sight.points_m, size, sight.camera_height_m, camera, vehicle, sight.ned_trunk_m
            )
        elif sight.body is not None and sight.body.number == number:
            self._bodies[number] = sight.body

    def forget(self, number: int) -> None:
        """Somebody turned out to be somebody else."""
        self._bodies.pop(number, None)
