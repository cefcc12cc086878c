"""People who were found: each with a number that stays (Al-Kaff 2019, section 4.4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from common.geometry.rotation import Array
from onboard.people.appearance import Look, similarity
from onboard.people.association import assign, match_cost
from onboard.people.config import AssociationConfig
from onboard.people.identity import Detection, Track
from onboard.people.pose import Pose

_LARGEST_STEP_S = 600.0
_NO_ROOM_M, _SURELY = 0.4, 2.0
"""Two in one picture whose middles are nearer than this, m, are one if they look so many times more alike than people
have to for it."""
_ONE_SIGHT_S = 2.0
"""Who was taken for somebody new so short a time ago, and in the same unbroken sight is known again, was not new."""
_CUT_OFF_M = 1.0
"""By so much the middle of what is left of a person at the picture's edge may be off."""


class PeopleTracker:
    """Gives each detection a person, known or new. Confirmed people are never forgotten.

    Args:
        config: gate, gallery, confirmation.
    """

    def __init__(self, config: AssociationConfig):
        self.config = config
        self.tracks: list[Track] = []
        self._next = 1
        self._last_ns: int | None = None
        self._together: set[frozenset[int]] = set()
        self._one_sight: set[tuple[int, int]] = set()

    def update(self, detections: Sequence[Detection], t_ns: int) -> list[int]:
        """Number of the person that each detection shows; 0 for one that is not fresh and whose person is gone.

        Args:
            detections: of one picture.
            t_ns: the picture's capture time; not before the last one's.

        Raises:
            ValueError: time runs backwards.
        """
        if self._last_ns is not None and t_ns < self._last_ns:
            raise ValueError(f"tracks: got t_ns {t_ns}, expected at least {self._last_ns}: pictures in their order")
        self._last_ns = t_ns
        self._one_sight.clear()
        numbers = [self._carried(d, t_ns) for d in detections]
        # In the order of their numbers whatever the order of the detections; ties are broken by cost alone.
        costs = np.array([[self._cost(track, d, t_ns, numbers) for d in detections] for track in self.tracks])
        for row, column in assign(costs, self.config.gate):
            self.tracks[row] = self._seen_again(self.tracks[row], detections[column], t_ns)
            numbers[column] = self.tracks[row].number
            self._note_sight(detections[column].known, numbers[column], t_ns)
        for index, detection in enumerate(detections):
            if not numbers[index] and detection.fresh:
                numbers[index] = self._begin(detection, t_ns)
        self._together |= {frozenset(pair) for pair in combinations((n for n in numbers if n), 2)}
        self._drop_doubtful(t_ns)
        return numbers

    def doubles(self) -> list[tuple[int, int]]:
        """Pairs (newer, older number) that are one person, as far as place and looks say.

        What was first seen of somebody, at the picture's edge, may lie too far from where they are for the second sight
        to be theirs; once the places agree, the evidence decides that would have then. Who were in one picture are two,
        but for those who lie where nobody else could and look the same: parts of one that a thing or a shadow divides.
        Who walks comes into view as legs that look like nobody known, and may be somebody new until the rest is seen:
        those on their feet are one if they can have walked there and look the same, and so are two numbers that follow
        each other in one unbroken sight.
        """
        believed = sorted((t for t in self.tracks if t.confirmed and not t.dismissed), key=lambda t: t.number)
        left = {track.number for track in self.tracks if not track.dismissed}
        followed = [pair for pair in self._one_sight if left >= set(pair) and set(pair) not in self._together]
        return followed + [
            (newer.number, older.number) for older, newer in combinations(believed, 2) if self._one(older, newer)
        ]

    def _note_sight(self, known: int | None, number: int, t_ns: int) -> None:
        """Note that what was followed without a break as somebody new is somebody older by their look."""
        newer = next((track for track in self.tracks if track.number == known), None)
        if newer is not None and number < newer.number and t_ns - newer.first_ns <= _ONE_SIGHT_S * 1e9:
            self._one_sight.add((newer.number, number))

    def _one(self, older: Track, newer: Track) -> bool:
        if older.ned_p_m is None or newer.ned_p_m is None:
            return False
        two = {older.number, newer.number} in self._together
        apart_m = float(np.linalg.norm((older.ned_p_m - newer.ned_p_m)[:2]))
        if apart_m <= (_NO_ROOM_M if two else self.config.near_m):
            factor = _SURELY if two else self.config.near_factor
        elif not two and older.stands and newer.stands and self._last_ns in (older.seen_ns, newer.seen_ns):
            if not self._reachable(older, newer, abs(older.seen_ns - newer.seen_ns) / 1e9):
                return False
            factor = _SURELY
        else:
            return False
        costs = (
            match_cost(older.looks, older.pose, look, newer.pose, float("inf"), self.config) for look in newer.looks
        )
        return min(costs) * factor < self.config.gate

    def recognises(self, track: Track, look: Look, pose: Pose, t_ns: int) -> bool:
        """Whether somebody seen where a person was is that person by their look."""
        gap_s = (t_ns - track.seen_ns) / 1e9
        cost = match_cost(track.looks, track.pose, look, pose, gap_s, self.config)
        return cost * self.config.near_factor < self.config.gate

    def dismiss(self, number: int) -> None:
        """Take a person for nobody from now on.

        Raises:
            KeyError: there is none of this number.
        """
        row = self._row(number)
        self.tracks[row] = replace(self.tracks[row], dismissed=True)

    def merge(self, number: int, into: int) -> None:
        """Take two people for one; the looks of both are kept, as far as the gallery has room.

        Args:
            number: which one is no more.
            into: who goes on.

        Raises:
            KeyError: there is none of this number.
        """
        gone, kept = self.tracks[self._row(number)], self.tracks[self._row(into)]
        newer = gone if gone.seen_ns > kept.seen_ns else kept
        looks = kept.looks
        for look in gone.looks:
            looks = self._gallery(looks, look)
        self.tracks[self._row(into)] = replace(
            newer,
            number=kept.number,
            confirmed=kept.confirmed or gone.confirmed,
            hits=kept.hits + gone.hits,
            evidence=kept.evidence + gone.evidence,
            looks=looks,
            first_ns=min(kept.first_ns, gone.first_ns),
            ned_p_m=kept.ned_p_m if newer.ned_p_m is None else newer.ned_p_m,
            ned_p_cov_m2=kept.ned_p_cov_m2 if newer.ned_p_m is None else newer.ned_p_cov_m2,
            dismissed=kept.dismissed,
            merged=(*kept.merged, number, *gone.merged),
        )
        del self.tracks[self._row(number)]
        self._together |= {frozenset({into, *pair} - {number}) for pair in self._together if number in pair}

    def _row(self, number: int) -> int:
        return {track.number: row for row, track in enumerate(self.tracks)}[number]

    def _carried(self, detection: Detection, t_ns: int) -> int:
        """Number of the person that a detection without a pose of its own goes on showing; 0 where there is none."""
        rows = {track.number: row for row, track in enumerate(self.tracks)}
        if detection.fresh or detection.known not in rows:
            return 0
        row = rows[detection.known]
        track = self.tracks[row]
        if track.seen_ns == t_ns:
            return 0
        position, covariance = self._position(track, detection, (t_ns - track.seen_ns) / 1e9)
        track = replace(track, seen_ns=t_ns, ned_p_m=position, ned_p_cov_m2=covariance)
        if detection.stands:
            track = replace(track, stands=True)
        if detection.followed:
            track = replace(track, hits=track.hits + 1)
        self.tracks[row] = self._judged(track)
        return track.number

    def _judged(self, track: Track) -> Track:
        """Believed once it was seen often enough."""
        enough = min(float(track.hits), track.evidence) >= self.config.confirm_hits
        return replace(track, confirmed=track.confirmed or enough)

    def _cost(self, track: Track, detection: Detection, t_ns: int, given: Sequence[int]) -> float:
        gap_s = (t_ns - track.seen_ns) / 1e9
        if not detection.fresh or track.number in given or not self._reachable(track, detection, gap_s):
            return float("inf")
        cost = match_cost(track.looks, track.pose, detection.look, detection.pose, gap_s, self.config)
        return cost * self._evidence(track, detection)

    def _evidence(self, track: Track, detection: Detection) -> float:
        """What place and unbroken sight leave of the cost, a factor up to 1."""
        if detection.known == track.number:
            return self.config.sight_factor
        if track.ned_p_m is None or detection.ned_p_m is None:
            return 1.0
        apart_m = float(np.linalg.norm((track.ned_p_m - detection.ned_p_m)[:2]))
        return self.config.near_factor if apart_m <= self.config.near_m else 1.0

    def _reachable(self, track: Track, detection: Detection | Track, gap_s: float) -> bool:
        """Whether the person can have walked there in the time; yes where a position is not known."""
        if track.ned_p_m is None or detection.ned_p_m is None:
            return True
        variance = sum(
            float(np.linalg.eigvalsh(c)[-1]) for c in (track.ned_p_cov_m2, detection.ned_p_cov_m2) if c is not None
        )
        reach = self.config.walk_m_s * min(gap_s, _LARGEST_STEP_S) + self.config.slack_m + 3.0 * variance**0.5
        return float(np.linalg.norm(detection.ned_p_m - track.ned_p_m)) <= reach

    def _seen_again(self, track: Track, detection: Detection, t_ns: int) -> Track:
        position, covariance = self._position(track, detection, (t_ns - track.seen_ns) / 1e9)
        seen = replace(
            track,
            hits=track.hits + 1,
            evidence=track.evidence + detection.evidence,
            looks=self._gallery(track.looks, detection.look),
            pose=detection.pose,
            seen_ns=t_ns,
            ned_p_m=position,
            ned_p_cov_m2=covariance,
            stands=track.stands or detection.stands,
        )
        return self._judged(seen)

    def _position(self, track: Track, detection: Detection, gap_s: float) -> tuple[Array | None, Array | None]:
        """A person stands or walks: Kalman filter of a random walk."""
        if detection.ned_p_m is None or detection.ned_p_cov_m2 is None:
            return track.ned_p_m, track.ned_p_cov_m2
        if track.ned_p_m is None or track.ned_p_cov_m2 is None:
            return detection.ned_p_m, detection.ned_p_cov_m2
        apart_m = float(np.linalg.norm((detection.ned_p_m - track.ned_p_m)[:2]))
        if not detection.whole and apart_m < _CUT_OFF_M:
            return track.ned_p_m, track.ned_p_cov_m2
        predicted = track.ned_p_cov_m2 + np.eye(3) * (self.config.walk_m_s * min(gap_s, _LARGEST_STEP_S)) ** 2
        gain = predicted @ np.linalg.inv(predicted + detection.ned_p_cov_m2)
        left = np.eye(3) - gain
        # Joseph's form stays symmetric and positive.
        covariance = left @ predicted @ left.T + gain @ detection.ned_p_cov_m2 @ gain.T
        return track.ned_p_m + gain @ (detection.ned_p_m - track.ned_p_m), 0.5 * (covariance + covariance.T)

    def _gallery(self, looks: tuple[Look, ...], look: Look) -> tuple[Look, ...]:
        """A look that none of the gallery resembles joins it; a full gallery gives up the one most like another."""
        if max(similarity(known, look) for known in looks) > self.config.same_look:
            return looks
        if len(looks) < self.config.gallery:
            return (*looks, look)
        likeness = [max(similarity(a, b) for b in looks if b is not a) for a in looks]
        drop = int(np.argmax(likeness))
        return (*looks[:drop], *looks[drop + 1 :], look)

    def _begin(self, detection: Detection, t_ns: int) -> int:
        number = self._next
        self._next += 1
        self.tracks.append(
            Track(
                number,
                self.config.confirm_hits <= min(1.0, detection.evidence),
                1,
                (detection.look,),
                detection.pose,
                t_ns,
                t_ns,
                detection.ned_p_m,
                detection.ned_p_cov_m2,
                evidence=detection.evidence,
                stands=detection.stands,
            )
        )
        return number

    def _drop_doubtful(self, t_ns: int) -> None:
        """Provisional people who were not seen again within the time were false alarms."""
        limit_ns = round(self.config.provisional_s * 1e9)
        self.tracks = [t for t in self.tracks if t.confirmed or t_ns - t.seen_ns <= limit_ns]
