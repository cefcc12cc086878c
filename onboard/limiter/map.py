"""The obstacle map: what each source said last, carried to now, and how long ago each direction was looked at.

No measurement is not "free": obstacles of a silent source stay for a while, moving on and growing nearer with their
uncertainty; the speed towards space that nobody looks at is bounded, and when nothing sees any more, the vehicle stops.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from common.geometry.rotation import quat_to_matrix
from common.messages import Obstacles, Vec3, View
from onboard.limiter.carried import STANDING_M_S, averaged, keep_s, unsure_m
from onboard.limiter.config import LimiterConfig
from onboard.limiter.law import sight_speed, stoppable
from onboard.limiter.surroundings import COLUMNS, ROWS, Surroundings, cell_directions

Array = np.ndarray
_TRACK_S = 2.0
_MOST_KEPT = 256
_STEEP = 0.999
_PATCH_M = 3.0
"""A surface that is told as straight beneath or overhead lies somewhere within this distance of there, horizontally:
`proximity.beneath_m` of its source."""
_NEVER = -(10**18)


NOTHING_KNOWN = Surroundings(blind=True)
"""Around a vehicle without any source."""


@dataclass
class _Source:
    """What one source said, in world coordinates."""

    capture_ns: int = _NEVER
    """Of its newest message."""
    looked_ns: int = _NEVER
    """When it last saw anything; a source without views never does."""
    looks: bool = False
    """Whether it has ever sent a view."""
    ned_p_m: Array = field(default_factory=lambda: np.zeros((0, 3)))
    ned_v_m_s: Array = field(default_factory=lambda: np.zeros((0, 3)))
    mean_v_m_s: Array = field(default_factory=lambda: np.zeros((0, 3)))
    """Velocities over their last second in view, for those that have a name."""
    samples: Array = field(default_factory=lambda: np.zeros(0))
    """How many samples these are worth."""
    stamps_ns: Array = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    labels: list[str] = field(default_factory=list)
    steep: Array = field(default_factory=lambda: np.zeros(0, dtype=bool))
    """Which bare points were told as straight beneath or overhead: surfaces around there."""


class ObstacleMap:
    """Obstacles and sight around one vehicle.

    Args:
        config: how long what is known counts.
    """

    def __init__(self, config: LimiterConfig):
        self._config = config
        self._sources: dict[str, _Source] = {}
        self._track: deque[tuple[int, Vec3]] = deque()
        self._directions = cell_directions()
        self._cell_ns = np.full((ROWS, COLUMNS), _NEVER, dtype=np.int64)
        self._cell_range_m = np.zeros((ROWS, COLUMNS))
        self._cell_place_m = np.zeros((ROWS, COLUMNS, 3))

    def follow(self, ned_p_m: Vec3, t_ns: int) -> None:
        """Note where the vehicle is; what sources say later is placed by it."""
        if self._track and t_ns <= self._track[-1][0]:
            return
        self._track.append((t_ns, ned_p_m))
        while self._track[0][0] < t_ns - _TRACK_S * 1e9:
            self._track.popleft()

    def hear(self, source: str, message: Obstacles, capture_ns: int) -> None:
        """Take the newest message of a source; one that is not newer than the last changes nothing.

        Args:
            source: topic.
            message: obstacles and views, from where the vehicle was at the capture.
            capture_ns: when that was, on the vehicle's clock.
        """
        known = self._sources.setdefault(source, _Source())
        if capture_ns <= known.capture_ns or not self._track:
            return
        place = self._place(capture_ns)
        count = len(message.obstacles)
        directions = np.array([o.ned_direction for o in message.obstacles]).reshape(-1, 3)
        points = place + directions * np.array([o.distance_m for o in message.obstacles])[:, None]
        velocities = np.array([o.ned_v_m_s for o in message.obstacles]).reshape(-1, 3)
        means, samples = _followed(known, [o.label for o in message.obstacles], velocities, capture_ns)
        kept = self._still_unseen(known, message.views, place, capture_ns)
        known.ned_p_m = np.concatenate([points, known.ned_p_m[kept]])
        known.ned_v_m_s = np.concatenate([velocities, known.ned_v_m_s[kept]])
        known.mean_v_m_s = np.concatenate([means, known.mean_v_m_s[kept]])
        known.samples = np.concatenate([samples, known.samples[kept]])
        known.stamps_ns = np.concatenate([np.full(count, capture_ns, dtype=np.int64), known.stamps_ns[kept]])
        bare = np.array([not o.label for o in message.obstacles], dtype=bool)
        known.steep = np.concatenate([bare & (np.abs(directions[:, 2]) > _STEEP), known.steep[kept]])
        known.labels = [o.label for o in message.obstacles] + [known.labels[k] for k in kept]
        known.capture_ns = capture_ns
        for view in message.views:
            known.looks = True
            if any(view.seen):
                known.looked_ns = capture_ns
                seen = covered(view, self._directions)
                self._cell_ns[seen] = capture_ns
                self._cell_range_m[seen] = view.range_m
                self._cell_place_m[seen] = place

    def now(self, ned_p_m: Vec3, t_ns: int) -> Surroundings | None:
        """What is around the vehicle now; None when standing still is all that is known to be safe."""
        config = self._config
        spoken = [s for s in self._sources.values() if s.capture_ns > _NEVER]
        if not spoken:
            return None if config.required else NOTHING_KNOWN
        if config.required and not any(_age_s(t_ns, s.capture_ns) <= config.keep_s for s in spoken):
            return None
        parts = [(name, *self._of(source, ned_p_m, t_ns)) for name, source in self._sources.items()]
        places = np.concatenate([np.zeros((0, 3)), *(p for _, p, _, _, _ in parts)]) - np.array(ned_p_m)
        size = np.sqrt((places * places).sum(axis=1))
        unit = np.where(size[:, None] > 1e-6, places / np.maximum(size, 1e-6)[:, None], (1.0, 0.0, 0.0))
        speed, range_m = self._sight(ned_p_m, t_ns, spoken)
        return Surroundings(
            size,
            unit,
            np.concatenate([np.zeros((0, 3)), *(v for _, _, v, _, _ in parts)]),
            [label for *_, labels in parts for label in labels],
            [name for name, places_m, *_ in parts for _ in range(len(places_m))],
            np.concatenate([np.zeros(0), *(u for *_, u, _ in parts)]),
            speed,
            not any(_age_s(t_ns, s.looked_ns if s.looks else s.capture_ns) <= config.stale_s for s in spoken),
            range_m,
        )

    def _of(self, source: _Source, ned_p_m: Vec3, t_ns: int) -> tuple[Array, Array, Array, list[str]]:
        """Places now (K, 3), velocities (K, 3), uncertainties (K,), m, and labels of a source's obstacles.

        A remembered surface beneath or overhead stays straight beneath or overhead while the vehicle is near where it
        was told: as a point of that place it would brake level flight past nothing.
        """
        config = self._config
        age_s, v = self._ages_and_velocities(source, t_ns)
        silent_s = np.float64(_age_s(t_ns, source.capture_ns))
        aside_m = np.hypot(source.ned_p_m[:, 0] - ned_p_m[0], source.ned_p_m[:, 1] - ned_p_m[1])
        places = source.ned_p_m + v * age_s[:, None]
        walks = (v * v).sum(axis=1) >= STANDING_M_S**2
        unsure = unsure_m(np.where(walks, age_s, silent_s), np.where(walks, source.samples, np.inf), config)
        offset = places - np.array(ned_p_m)
        nearest_m = np.sqrt((offset * offset).sum(axis=1)) - unsure
        known = age_s <= keep_s(v, nearest_m, config, source.looks)
        kept = np.nonzero(known & ~(source.steep & (aside_m > _PATCH_M)))[0]
        places = places[kept]
        places[source.steep[kept], :2] = ned_p_m[:2]
        return places, v[kept], unsure[kept], [source.labels[k] for k in kept]

    def _ages_and_velocities(self, source: _Source, t_ns: int) -> tuple[Array, Array]:
        """How old a source's points are, (K,), s, and their velocities (K, 3), m/s: the mean, out of view."""
        age_s = np.maximum((t_ns - source.stamps_ns) / 1e9, 0.0)
        return age_s, np.where((age_s > self._config.stale_s)[:, None], source.mean_v_m_s, source.ned_v_m_s)

    def _sight(self, ned_p_m: Vec3, t_ns: int, spoken: list[_Source]) -> tuple[Array | None, Array | None]:
        """Fastest speed and known range in each direction; None where no source says anything of them.

        Sources that look decide where there are any. Those that only name obstacles free no space, so while they speak
        they bound no speed; when they fall silent there is nothing left to trust.
        """
        config = self._config
        looking = [s for s in spoken if s.looks]
        silent_s = min(_age_s(t_ns, s.looked_ns if s.looks else s.capture_ns) for s in looking or spoken)
        if looking:
            moved = np.array(ned_p_m) - self._cell_place_m
            left_m = np.maximum(self._cell_range_m - np.sqrt((moved * moved).sum(axis=-1)), 0.0)
            age_s = (t_ns - self._cell_ns) / 1e9
        elif silent_s > config.late_s:
            left_m, age_s = np.full((ROWS, COLUMNS), config.h_max_m), np.full((ROWS, COLUMNS), silent_s)
        else:
            return None, None
        free = stoppable(left_m - config.h_min_m - config.margin_m, config)
        speed = sight_speed(free, age_s, silent_s, config)
        return speed, np.where(age_s < config.memory_s, left_m, 0.0) if looking else None

    def _still_unseen(self, known: _Source, views: tuple[View, ...], place_m: Array, capture_ns: int) -> list[int]:
        """Indices of a source's older points that its new message does not speak of: out of its views."""
        if not views or not len(known.ned_p_m):
            return []
        age_s, v = self._ages_and_velocities(known, capture_ns)
        offset = known.ned_p_m + v * age_s[:, None] - place_m  # where those that walk should be by now
        hidden = age_s <= self._config.remember_s
        distance = np.sqrt((offset * offset).sum(axis=1))
        for view in views:
            hidden &= ~(covered(view, offset) & (distance <= view.range_m))
        indices = np.nonzero(hidden)[0]
        return indices[np.argsort(distance[indices])[:_MOST_KEPT]].tolist()

    def _place(self, t_ns: int) -> Array:
        """Where the vehicle was, NED, m, (3,)."""
        stamps = [t for t, _ in self._track]
        return np.array([np.interp(t_ns, stamps, [p[axis] for _, p in self._track]) for axis in range(3)])


def covered(view: View, ned_offsets: Array) -> Array:
    """Whether a view looks along offsets and had a usable measurement there.

    Args:
        view: the view.
        ned_offsets: from the sensor, NED, any length, (..., 3).

    Returns:
        (...), bool.
    """
    sensor = ned_offsets @ quat_to_matrix(view.ned_q_sensor)  # R^T of each offset
    azimuth = np.arctan2(sensor[..., 0], sensor[..., 2])
    elevation = np.arctan2(sensor[..., 1], np.hypot(sensor[..., 0], sensor[..., 2]))
    column = np.floor((azimuth / view.half_width_rad + 1.0) * 0.5 * view.columns).astype(int)
    row = np.floor((elevation / view.half_height_rad + 1.0) * 0.5 * view.rows).astype(int)
    within = (np.abs(azimuth) <= view.half_width_rad) & (np.abs(elevation) <= view.half_height_rad)
    seen = np.array(view.seen, dtype=bool).reshape(view.rows, view.columns)
    return within & seen[np.clip(row, 0, view.rows - 1), np.clip(column, 0, view.columns - 1)]


def _followed(known: _Source, labels: list[str], ned_v_m_s: Array, capture_ns: int) -> tuple[Array, Array]:
    """Mean velocities (K, 3), m/s, of new points, and how many samples they are worth, (K,): those that have a name go
    on from what was known under it."""
    before = {label: k for k, label in reversed(list(enumerate(known.labels))) if label}
    indices = np.array([before.get(label, -1) for label in labels], dtype=int)
    again = indices >= 0
    means, samples, dt_s = ned_v_m_s.copy(), np.zeros(len(labels)), np.zeros(len(labels))
    means[again], samples[again] = known.mean_v_m_s[indices[again]], known.samples[indices[again]]
    dt_s[again] = (capture_ns - known.stamps_ns[indices[again]]) / 1e9
    return averaged(means, samples, ned_v_m_s, dt_s)


def _age_s(t_ns: int, stamp_ns: int) -> float:
    return (t_ns - stamp_ns) / 1e9
