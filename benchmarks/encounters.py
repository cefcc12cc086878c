"""Random encounters of a vehicle that flies straight on with obstacles that stand and walk, many at once.

What flies is the limiter's own code (`onboard.limiter`), as rows over arrays; around it stand the vehicle's response,
a depth sensor with noise, delay and drop-outs, and an oracle that knows the truth and only brakes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.encounter_vehicle import DT_S, Vehicles
from onboard.limiter.carried import averaged, keep_s, unsure_m
from onboard.limiter.config import LimiterConfig
from onboard.limiter.constraints import Motion, braking_after, deepest_braking, obstacle_rows
from onboard.limiter.law import sight_speed, stoppable
from onboard.limiter.limiter import bounded_many

Array = np.ndarray
MOST = 8
DURATION_S = 12.0
CONTROL_S = 0.05
TICKS = round(DURATION_S / CONTROL_S)
_STEPS = round(CONTROL_S / DT_S)
_SAMPLE_TICKS = 2  # 10 Hz
_RANGE_M, _HALF_VIEW_RAD = 8.0, np.radians(45.0)
_DISTANCE_NOISE_M, _VELOCITY_NOISE_M_S, _OWN_NOISE_M_S = 0.03, 0.1, 0.03
_FAR_M = 1e3
_SPEED_M_S, _CRUISING = (0.5, 2.5), 0.5
_WALKING = 0.5
_DRAGS_1_S = (0.1, 1.0)


@dataclass(frozen=True)
class Scene:
    """What is drawn for N encounters."""

    asked: Array
    """Velocity asked all the time, (N, 3), NED, m/s: north, with a little climb or sink."""
    cruising: Array
    """Whether it is flown from the beginning, (N,); else the vehicle starts at rest."""
    drag_1_s: Array
    """Drag by mass, (N,)."""
    places: Array
    """Obstacles at the beginning, (N, 8, 3), m; far away where there are fewer than eight."""
    velocities: Array
    """Their velocities, (N, 8, 3), m/s."""
    delay_ticks: Array
    """Delay of the sensor, (N,), control periods."""
    lost_from_s: Array
    """Beginning of the drop-out, (N,), s."""
    lost_for_s: Array
    """Its length, (N,), s."""

    def at(self, t_s: float) -> Array:
        """Obstacles at a time, (N, 8, 3), m."""
        return self.places + self.velocities * t_s


def draw(rng: np.random.Generator, count: int) -> Scene:
    """Encounters: 1 to 8 obstacles 3 to 15 m away (from 8.5 m where the vehicle is under way), within 60 degrees of the
    way, one or two of them walking at up to 1.5 m/s in every second encounter."""
    speed = rng.uniform(*_SPEED_M_S, count)
    cruising = rng.random(count) < _CRUISING
    number = rng.integers(1, MOST + 1, count)
    distance = rng.uniform(np.where(cruising, _RANGE_M + 0.5, 3.0)[:, None], 15.0, (count, MOST))
    bearing = np.radians(rng.uniform(-60.0, 60.0, (count, MOST)))
    height = rng.uniform(-1.0, 1.0, (count, MOST))
    places = np.stack([distance * np.cos(bearing), distance * np.sin(bearing), height], axis=-1)
    places[np.arange(MOST)[None, :] >= number[:, None]] = (_FAR_M, 0.0, 0.0)
    walkers = np.where(rng.random(count) < _WALKING, rng.integers(1, 3, count), 0)
    walks = (np.arange(MOST)[None, :] < np.minimum(walkers, number)[:, None]).astype(float)
    heading, pace = rng.uniform(-np.pi, np.pi, (count, MOST)), rng.uniform(0.3, 1.5, (count, MOST)) * walks
    velocities = np.stack([pace * np.cos(heading), pace * np.sin(heading), np.zeros((count, MOST))], axis=-1)
    climb = np.where(rng.random(count) < 0.2, rng.uniform(-0.3, 0.3, count), 0.0)
    return Scene(
        np.stack([speed, np.zeros(count), climb], axis=-1),
        cruising,
        rng.choice(_DRAGS_1_S, count),
        places,
        velocities,
        rng.integers(0, 5, count),
        rng.uniform(0.0, DURATION_S, count),
        np.where(rng.random(count) < 0.5, rng.uniform(0.0, 1.0, count), 0.0),
    )


class Sensor:
    """Depth sensor and obstacle map: what the limiter knows, from noisy samples that come late or not at all.

    Args:
        scene: the encounters.
        config: how long what is known counts.
        rng: of the noise.
    """

    def __init__(self, scene: Scene, config: LimiterConfig, rng: np.random.Generator):
        self._scene, self._config, self._rng = scene, config, rng
        shape = scene.places.shape
        self._samples: dict[int, tuple[Array, Array, Array]] = {}
        self._places, self._velocities = np.full(shape, _FAR_M), np.zeros(shape)
        self._means, self._counts = np.zeros(shape), np.zeros(shape[:2])
        self._stamps_s = np.full(shape[:2], -_FAR_M)
        self._heard_s = np.zeros(shape[0])
        self.shown = np.zeros(shape[:2], dtype=bool)
        """Which obstacles a sample that arrived has shown, (N, 8)."""

    def look(self, tick: int, t_s: float, p_m: Array) -> None:
        """Take a sample at this tick, and deliver what is due."""
        scene, rng = self._scene, self._rng
        if tick % _SAMPLE_TICKS == 0:
            truth = scene.at(t_s)
            offset = truth - p_m[:, None]
            distance = _length(offset)[..., None]
            measured = truth + offset / np.maximum(distance, 1e-6) * rng.normal(0.0, _DISTANCE_NOISE_M, distance.shape)
            walking = np.any(scene.velocities != 0.0, axis=-1, keepdims=True)
            noise = rng.normal(0.0, _VELOCITY_NOISE_M_S, truth.shape) * walking * (1.0, 1.0, 0.0)
            self._samples[tick] = (measured, scene.velocities + noise, in_view(offset))
            self._samples.pop(tick - 8, None)
        for delay in range(5):
            sample = self._samples.get(tick - delay)
            if sample is None:
                continue
            taken_s = t_s - delay * CONTROL_S
            lost = (taken_s >= scene.lost_from_s) & (taken_s < scene.lost_from_s + scene.lost_for_s)
            heard = (scene.delay_ticks == delay) & ~lost
            fresh = sample[2] & heard[:, None]
            self._places[fresh], self._velocities[fresh] = sample[0][fresh], sample[1][fresh]
            since_s = taken_s - self._stamps_s[fresh]
            self._means[fresh], self._counts[fresh] = averaged(
                self._means[fresh], self._counts[fresh], sample[1][fresh], since_s
            )
            self._stamps_s[fresh] = taken_s
            self.shown |= fresh
            self._heard_s[heard] = taken_s

    def obstacles(self, t_s: float, p_m: Array) -> tuple[Array, Array, Array, Array]:
        """Distances (N, 8), unit vectors and velocities (N, 8, 3) and uncertainties (N, 8) as they are known now."""
        age_s = t_s - self._stamps_s
        velocities = np.where((age_s > self._config.stale_s)[..., None], self._means, self._velocities)
        offset = self._places + velocities * age_s[..., None] - p_m[:, None]
        walking = np.any(velocities != 0.0, axis=-1)
        silent_s = np.where(walking, age_s, (t_s - self._heard_s)[:, None])
        unsure = unsure_m(silent_s, np.where(walking, np.maximum(self._counts, 1.0), np.inf), self._config)
        known = age_s <= keep_s(velocities, _length(offset) - unsure, self._config, looks=True)
        offset = np.where(known[..., None], offset, (_FAR_M, 0.0, 0.0))
        distance = _length(offset)
        velocities = np.where(known[..., None], velocities, 0.0)
        unit = offset / np.maximum(distance, 1e-6)[..., None]
        return distance, unit, velocities, np.where(known, unsure, 0.0)

    def fastest_m_s(self, t_s: float, v_m_s: Array) -> Array:
        """Fastest speed in the direction of each velocity, (N,), m/s."""
        config = self._config
        bearing = np.arctan2(v_m_s[:, 1], v_m_s[:, 0])
        silent_s = t_s - self._heard_s
        age_s = np.where(np.abs(bearing) <= _HALF_VIEW_RAD, silent_s, _FAR_M)
        free = stoppable(_RANGE_M - config.h_min_m - config.margin_m, config)
        return sight_speed(free, age_s, silent_s, config)


def _length(vectors: Array) -> Array:
    """Lengths of (..., 3), without the copies that `numpy.linalg.norm` makes: (...)."""
    return np.sqrt(np.einsum("...i,...i", vectors, vectors))


def in_view(offset_m: Array) -> Array:
    """Whether an offset from the vehicle lies within range and view, (...)."""
    near = np.einsum("...i,...i", offset_m, offset_m) <= _RANGE_M**2
    return near & (np.abs(np.arctan2(offset_m[..., 1], offset_m[..., 0])) <= _HALF_VIEW_RAD)


class Oracles:
    """For each obstacle, a copy of its vehicle that brakes fully from the instant at which it enters range and view.

    Until then it flies as the vehicle does: what comes from the side or from behind may have been nearer before. They
    depend on nothing that comes later, so all are flown at the end, together, each for the time that was left.

    Args:
        scene: the encounters.
    """

    def __init__(self, scene: Scene):
        self._scene = scene
        self._since = np.full(scene.places.shape[:2], TICKS)
        self._before = np.full(scene.places.shape[:2], _FAR_M)
        self._begun: list[tuple[Array, Vehicles]] = []

    def watch(self, tick: int, seen: Array, vehicles: Vehicles, nearest_m: Array) -> None:
        """Let those begin whose obstacle is seen, (N, 8), for the first time; it was as near as that before, m."""
        entered = seen & (self._since == TICKS)
        which = np.argwhere(entered)
        if len(which):
            self._since[entered] = tick
            self._before[entered] = nearest_m[entered]
            self._begun.append((which, vehicles.of(which[:, 0])))

    def nearest_m(self, otherwise_m: Array) -> Array:
        """Least distance of each to its obstacle, m, (N, 8); what is given where none ever began."""
        result = otherwise_m.copy()
        if not self._begun:
            return result
        # In the order of their beginning: those that have the most time left come first, and the rest drop off.
        which = np.concatenate([w for w, _ in self._begun])
        since = self._since[which[:, 0], which[:, 1]]
        places = self._scene.places[which[:, 0], which[:, 1]]
        velocities = self._scene.velocities[which[:, 0], which[:, 1]]
        oracles = Vehicles.together([v for _, v in self._begun])
        nearest = np.full(len(which), _FAR_M)
        standstill = np.zeros((len(which), 3))
        for flown in range(TICKS - int(since[0])):
            alive = int(np.searchsorted(since, TICKS - flown))
            if alive < len(oracles.p):
                oracles = oracles.of(slice(alive))
            for _ in range(_STEPS):
                oracles.step(standstill[:alive])
            t_s = (since[:alive] + flown + 1) * CONTROL_S
            truth = places[:alive] + velocities[:alive] * t_s[:, None]
            np.minimum(nearest[:alive], _length(truth - oracles.p), out=nearest[:alive])
        before = self._before[which[:, 0], which[:, 1]]
        result[which[:, 0], which[:, 1]] = np.minimum(before, nearest)
        return result


@dataclass(frozen=True)
class Ends:
    """How N encounters went."""

    nearest_m: Array
    """Least distance to each obstacle, (N, 8), m."""
    oracle_m: Array
    """The same for the oracle that brakes from the instant at which that obstacle enters range and view, (N, 8), m.
    One that never does leaves the oracle as blind as the vehicle: its nearest distance stands here."""
    unshown_m: Array
    """Least distance to each obstacle before any sample that arrived had shown it, (N, 8), m: the oracle has no
    drop-outs and no delay, and may have seen it."""
    ghost_m: Array
    """Least distance of the flight without limiter to any obstacle, (N,), m."""
    progress: Array
    """Way north over that of the flight without limiter, (N,)."""
    stood_s: Array
    """Longest time at less than a tenth of the asked speed after the start, (N,), s."""


def fly(scene: Scene, config: LimiterConfig, rng: np.random.Generator) -> Ends:
    """Fly all encounters of a scene with one strategy."""
    count = len(scene.asked)
    start = np.where(scene.cruising[:, None], scene.asked, 0.0)
    vehicles = Vehicles(np.zeros((count, 3)), start, scene.drag_1_s)
    ghosts = Vehicles(np.zeros((count, 3)), start, scene.drag_1_s)
    oracles = Oracles(scene)
    nearest, unshown = np.full((count, MOST), _FAR_M), np.full((count, MOST), _FAR_M)
    ghost_m, standing_s, stood_s = np.full(count, _FAR_M), np.zeros(count), np.zeros(count)
    sensor, braking = Sensor(scene, config, rng), np.zeros((count, 3))
    truth = scene.at(0.0)
    for tick in range(TICKS):
        t_s = tick * CONTROL_S
        oracles.watch(tick, in_view(truth - vehicles.p[:, None]), vehicles, nearest)
        sensor.look(tick, t_s, vehicles.p)
        setpoint, braking = _limited(scene, config, sensor, vehicles, braking, t_s, rng)
        for _ in range(_STEPS):
            vehicles.step(setpoint)
            ghosts.step(scene.asked)
        truth = scene.at(t_s + CONTROL_S)
        distance = _length(truth - vehicles.p[:, None])
        nearest = np.minimum(nearest, distance)
        unshown = np.where(sensor.shown, unshown, np.minimum(unshown, distance))
        ghost_m = np.minimum(ghost_m, _length(truth - ghosts.p[:, None]).min(axis=1))
        slow = (vehicles.v[:, 0] < 0.1 * scene.asked[:, 0]) & (t_s > 2.0)
        standing_s = np.where(slow, standing_s + CONTROL_S, 0.0)
        stood_s = np.maximum(stood_s, standing_s)
    return Ends(nearest, oracles.nearest_m(nearest), unshown, ghost_m, vehicles.p[:, 0] / ghosts.p[:, 0], stood_s)


def _limited(
    scene: Scene,
    config: LimiterConfig,
    sensor: Sensor,
    vehicles: Vehicles,
    braking: Array,
    t_s: float,
    rng: np.random.Generator,
) -> tuple[Array, Array]:
    """Setpoints and the braking memory, (N, 3) each: `limit` over arrays."""
    flown = vehicles.v + rng.normal(0.0, _OWN_NOISE_M_S, vehicles.v.shape)
    motion = Motion(scene.asked, scene.asked, flown, braking)
    distance, unit, velocities, unsure = sensor.obstacles(t_s, vehicles.p)
    rows = obstacle_rows(distance, unit, velocities, motion, config, unsure)
    v = bounded_many(scene.asked, rows)
    speed = _length(v)
    fastest = np.maximum(sensor.fastest_m_s(t_s, v), deepest_braking(rows))
    v = v * np.minimum(1.0, fastest / np.maximum(speed, 1e-9))[:, None]
    return v, braking_after(rows, motion, config, CONTROL_S)
