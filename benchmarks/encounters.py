"""Random encounters of a vehicle that flies straight on with obstacles that stand and walk, many at once.

What flies is the limiter's own code (`onboard.limiter`), as rows over arrays; around it stand the vehicle's response,
a depth sensor with noise, delay and drop-outs, and an oracle that knows the truth and only brakes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.encounter_oracle import Oracles
from benchmarks.encounter_scene import CONTROL_S, FAR_M, HALF_VIEW_RAD, MOST, RANGE_M, TICKS, Scene, in_view, length
from benchmarks.encounter_vehicle import DT_S, Vehicles
from onboard.limiter.carried import averaged, keep_s, unsure_m
from onboard.limiter.config import LimiterConfig
from onboard.limiter.constraints import Motion, braking_after, deepest_braking, obstacle_rows
from onboard.limiter.law import sight_speed, stoppable
from onboard.limiter.limiter import bounded_many

Array = np.ndarray
_STEPS = round(CONTROL_S / DT_S)
_SAMPLE_TICKS = 2  # 10 Hz
_DISTANCE_NOISE_M, _VELOCITY_NOISE_M_S, _OWN_NOISE_M_S = 0.03, 0.1, 0.03


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
        self._places, self._velocities = np.full(shape, FAR_M), np.zeros(shape)
        self._means, self._counts = np.zeros(shape), np.zeros(shape[:2])
        self._stamps_s = np.full(shape[:2], -FAR_M)
        self._heard_s = np.zeros(shape[0])
        self.shown = np.zeros(shape[:2], dtype=bool)
        """Which obstacles a sample that arrived has shown, (N, 8)."""

    def look(self, tick: int, t_s: float, p_m: Array) -> None:
        """Take a sample at this tick, and deliver what is due."""
        scene, rng = self._scene, self._rng
        if tick % _SAMPLE_TICKS == 0:
            truth = scene.at(t_s)
            offset = truth - p_m[:, None]
            distance = length(offset)[..., None]
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
        known = age_s <= keep_s(velocities, length(offset) - unsure, self._config, looks=True)
        offset = np.where(known[..., None], offset, (FAR_M, 0.0, 0.0))
        distance = length(offset)
        velocities = np.where(known[..., None], velocities, 0.0)
        unit = offset / np.maximum(distance, 1e-6)[..., None]
        return distance, unit, velocities, np.where(known, unsure, 0.0)

    def fastest_m_s(self, t_s: float, v_m_s: Array) -> Array:
        """Fastest speed in the direction of each velocity, (N,), m/s."""
        config = self._config
        bearing = np.arctan2(v_m_s[:, 1], v_m_s[:, 0])
        silent_s = t_s - self._heard_s
        age_s = np.where(np.abs(bearing) <= HALF_VIEW_RAD, silent_s, FAR_M)
        free = stoppable(RANGE_M - config.h_min_m - config.margin_m, config)
        return sight_speed(free, age_s, silent_s, config)


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
    between: Array
    """Which obstacles were in range and view between two pictures alone, and never on one, (N, 8)."""
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
    nearest, unshown = np.full((count, MOST), FAR_M), np.full((count, MOST), FAR_M)
    ghost_m, standing_s, stood_s = np.full(count, FAR_M), np.zeros(count), np.zeros(count)
    sensor, braking = Sensor(scene, config, rng), np.zeros((count, 3))
    viewed, pictured = np.zeros((count, MOST), dtype=bool), np.zeros((count, MOST), dtype=bool)
    truth = scene.at(0.0)
    for tick in range(TICKS):
        t_s = tick * CONTROL_S
        seen = in_view(truth - vehicles.p[:, None])
        viewed |= seen
        if tick % _SAMPLE_TICKS == 0:
            pictured |= seen
        oracles.watch(tick, seen, vehicles, nearest)
        sensor.look(tick, t_s, vehicles.p)
        setpoint, braking = _limited(scene, config, sensor, vehicles, braking, t_s, rng)
        for _ in range(_STEPS):
            vehicles.step(setpoint)
            ghosts.step(scene.asked)
        truth = scene.at(t_s + CONTROL_S)
        distance = length(truth - vehicles.p[:, None])
        nearest = np.minimum(nearest, distance)
        unshown = np.where(sensor.shown, unshown, np.minimum(unshown, distance))
        ghost_m = np.minimum(ghost_m, length(truth - ghosts.p[:, None]).min(axis=1))
        slow = (vehicles.v[:, 0] < 0.1 * scene.asked[:, 0]) & (t_s > 2.0)
        standing_s = np.where(slow, standing_s + CONTROL_S, 0.0)
        stood_s = np.maximum(stood_s, standing_s)
    progress = vehicles.p[:, 0] / ghosts.p[:, 0]
    return Ends(nearest, oracles.nearest_m(nearest), unshown, viewed & ~pictured, ghost_m, progress, stood_s)


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
    v, _ = bounded_many(scene.asked, rows, config)
    speed = length(v)
    fastest = np.maximum(sensor.fastest_m_s(t_s, v), deepest_braking(rows))
    v = v * np.minimum(1.0, fastest / np.maximum(speed, 1e-9))[:, None]
    return v, braking_after(rows, motion, config, CONTROL_S)
