"""The judge of the encounters: what a vehicle that knows the truth, and only brakes, would have come to."""

from __future__ import annotations

import numpy as np

from benchmarks.encounter_scene import CONTROL_S, FAR_M, TICKS, Scene, length
from benchmarks.encounter_vehicle import DT_S, Vehicles

Array = np.ndarray
_STEPS = round(CONTROL_S / DT_S)


class Oracles:
    """For each obstacle, a copy of its vehicle that brakes fully from the instant at which it enters range and view.

    Whether a picture of the sensor has it or not. Until then the copy flies as the vehicle does: what comes from the
    side or from behind may have been nearer before. They depend on nothing that comes later, so all are flown at the
    end, together, each for the time that was left.

    Args:
        scene: the encounters.
    """

    def __init__(self, scene: Scene):
        self._scene = scene
        self._since = np.full(scene.places.shape[:2], TICKS)
        self._before = np.full(scene.places.shape[:2], FAR_M)
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
        nearest = np.full(len(which), FAR_M)
        standstill = np.zeros((len(which), 3))
        for flown in range(TICKS - int(since[0])):
            alive = int(np.searchsorted(since, TICKS - flown))
            if alive < len(oracles.p):
                oracles = oracles.of(slice(alive))
            for _ in range(_STEPS):
                oracles.step(standstill[:alive])
            t_s = (since[:alive] + flown + 1) * CONTROL_S
            truth = places[:alive] + velocities[:alive] * t_s[:, None]
            np.minimum(nearest[:alive], length(truth - oracles.p), out=nearest[:alive])
        before = self._before[which[:, 0], which[:, 1]]
        result[which[:, 0], which[:, 1]] = np.minimum(before, nearest)
        return result
