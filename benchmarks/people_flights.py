"""The four flights of `outrider bench people`: who lies and walks where among what, and how the vehicle flies there.

They follow the sequences of Al-Kaff 2019, section 6.2.1 and Table 1: rates, lengths, and what happens. Everything else
is drawn from the seed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.geometry.rotation import quat_from_euler
from simulation.world.depth_config import DepthNoiseConfig
from simulation.world.objects_config import BarrelConfig, PersonConfig, ThingConfig
from simulation.world.path_config import PathConfig, WaypointConfig
from simulation.world.scenario import CarConfig, GroundConfig, LightConfig, ScenarioConfig, SensorConfig
from simulation.world.stances import Posture
from simulation.world.truth_filter import Motion

Array = NDArray[np.float64]

_SHIRTS = (
    "#d9480f", "#1d7a4c", "#f2f2ee", "#1746a2", "#c8102e", "#2b2b2e", "#f5b301", "#7a3fa0",
    "#6f7f8c", "#8a5a2b", "#3fa7c4", "#e58fb0", "#4d5b2a", "#b9b2a3",
)  # fmt: skip
_TROUSERS = ("#2b3440", "#5a4632", "#1c1c20", "#3a4f7a", "#77735f", "#4b2f2f", "#8f8a80")
_SKINS = ("#c99a77", "#e0b394", "#8d5a3c", "#5d3a26", "#d8a47f")
_HAIRS = ("#3a2a1e", "#14100c", "#a07840", "#6b6560", "#7a3a1c")
_SHOES = ("#2a2522", "#d9d6cf", "#5b3a22", "#30405a")
_THINGS: tuple[tuple[str, float, float], ...] = (
    ("rock", 0.3, 1.1), ("rubble", 0.7, 1.6), ("planks", 1.0, 2.2), ("crate", 0.5, 1.1), ("bag", 0.5, 0.9),
    ("pipe", 1.0, 2.2), ("tyre", 0.55, 0.8), ("branch", 1.0, 2.0), ("dummy", 1.4, 1.8),
)  # fmt: skip
_COLOURS = ("#8a857c", "#6e675c", "#9c8468", "#40403f", "#7d3b2a", "#3c5b76", "#b8a888", "#4f5d3a")
_STATIC: tuple[Posture, ...] = ("supine", "supine", "prone", "side", "sitting")
_ON_THE_SPOT: tuple[Posture, ...] = ("jumping", "jumping", "waving")
_PERSON_GAP_M, _WALK_GAP_M, _THING_GAP_M = 1.7, 1.1, 1.15
"""Least distances of middles: nobody walks through anybody or anything."""
_KINECT_DEPTH = DepthNoiseConfig(noise_m=0.004, noise_per_m=0.0008, edge_m=0.15, flying=0.3, edge_holes=0.2, holes=0.03)
"""As in `deploy/scenarios/approach.toml`: a Kinect v2 outdoors, 1.7 cm at 4 m, 5.5 cm at 8 m."""
_SWAY_RAD, _SWAY_M = math.radians(1.5), 0.12


@dataclass(frozen=True)
class Flight:
    """One sequence."""

    number: int
    """1 to 4, as in the paper."""
    rate_hz: float
    """Pictures a second."""
    frames: int
    """Its length."""
    quick_every: int
    """With `--quick` only every n-th picture is taken: all that happens, in as many seconds, at a lower rate. (Its
    first seconds alone would be harder than the whole: who waits for a first look does so once.)"""
    make: Callable[[np.random.Generator, int], Take]
    """Draws scene and flight."""

    def pictures(self, quick: bool) -> tuple[float, int]:
        """Pictures a second, and how many."""
        every = self.quick_every if quick else 1
        return self.rate_hz / every, -(-self.frames // every)


@dataclass(frozen=True)
class Take:
    """Scene and flight of one sequence."""

    scenario: ScenarioConfig
    """What is there."""
    course: Callable[[float], tuple[Array, float]]
    """Position (3,), NED, m, and heading, rad, of the vehicle at a time, s; without sway."""
    sway: Sway
    """How it is off that course."""
    shakes: Sequence[tuple[float, float, float]] = ()
    """Periods of blurred pictures: from, to, s, and the blur's length, px."""

    def motion(self, t_s: float) -> Motion:
        """The vehicle's true motion at a time."""
        (ahead, _), (now, heading), (behind, _) = (self.course(t_s + dt) for dt in (0.02, 0.0, -0.02))
        offset, roll, pitch, yaw = self.sway.at(t_s)
        quat = quat_from_euler(roll, pitch, heading + yaw)
        return Motion(round(1e9 * t_s), now + offset, (ahead - behind) / 0.04, quat, np.zeros(3))


class Sway:
    """What wind and gimbal leave: slow sines in place and attitude.

    Args:
        rng: their phases and periods.
        scale: 1 for a hover.
    """

    def __init__(self, rng: np.random.Generator, scale: float = 1.0):
        self._rates = math.tau / rng.uniform(1.5, 6.0, (6, 2))
        self._phases = rng.uniform(0.0, math.tau, (6, 2))
        self._sizes = scale * np.array([_SWAY_M, _SWAY_M, 0.6 * _SWAY_M, _SWAY_RAD, _SWAY_RAD, 2.0 * _SWAY_RAD])

    def at(self, t_s: float) -> tuple[Array, float, float, float]:
        """Offset (3,), m, roll, pitch and yaw, rad, at a time."""
        values = self._sizes * np.sin(self._rates * t_s + self._phases).sum(axis=1) / math.sqrt(2.0)
        return values[:3], float(values[3]), float(values[4]), float(values[5])


def _pick(rng: np.random.Generator, values: Sequence[str]) -> str:
    return values[int(rng.integers(len(values)))]


def _person(rng: np.random.Generator, place: tuple[float, float], posture: Posture, path: PathConfig) -> PersonConfig:
    return PersonConfig(
        north_m=place[0],
        east_m=place[1],
        heading_deg=float(rng.uniform(0.0, 360.0)),
        posture=posture,
        limbs=int(rng.integers(10_000)),
        height_m=float(rng.uniform(1.55, 1.92)),
        build=float(rng.uniform(0.9, 1.3)),
        shirt=_pick(rng, _SHIRTS),
        pattern=int(rng.integers(5)),
        short_sleeves=bool(rng.random() < 0.4),
        trousers=_pick(rng, _TROUSERS),
        shorts=bool(rng.random() < 0.2),
        shoes=_pick(rng, _SHOES),
        skin=_pick(rng, _SKINS),
        hair=_pick(rng, _HAIRS),
        long_hair=bool(rng.random() < 0.4),
        path=path,
    )


def _thing(rng: np.random.Generator, place: tuple[float, float]) -> ThingConfig | BarrelConfig:
    if rng.random() < 0.15:
        return BarrelConfig(north_m=place[0], east_m=place[1], radius_m=0.29, height_m=0.9, colour=_pick(rng, _COLOURS))
    kind, least, most = _THINGS[int(rng.integers(len(_THINGS)))]
    return ThingConfig(
        kind=kind,  # pyright: ignore[reportArgumentType]  from the table above
        north_m=place[0],
        east_m=place[1],
        heading_deg=float(rng.uniform(0.0, 360.0)),
        size_m=float(rng.uniform(least, most)),
        colour=_pick(rng, _COLOURS),
    )


class _Places:
    """Draws places in a field that keep their distance from each other."""

    def __init__(self, rng: np.random.Generator, low: tuple[float, float], high: tuple[float, float]):
        self._rng, self._low, self._high = rng, low, high
        self._taken: list[tuple[float, float, float]] = []

    def draw_way(self, gap_m: float, least_m: float) -> tuple[tuple[float, float], tuple[float, float]] | None:
        """Ends of a straight way at least so long, m, that keeps its distance all along; None when there is none."""
        for _ in range(400):
            ends = self._rng.uniform(self._low, self._high, (2, 2))
            if float(np.linalg.norm(ends[1] - ends[0])) < least_m:
                continue
            points = [
                (float(n), float(e)) for n, e in ends[0] + np.linspace(0.0, 1.0, 12)[:, None] * (ends[1] - ends[0])
            ]
            if all(math.hypot(n - n0, e - e0) > min(gap_m, g) for n, e in points for n0, e0, g in self._taken):
                self._taken += [(n, e, gap_m) for n, e in points]
                return points[0], points[-1]
        return None

    def draw(self, gap_m: float) -> tuple[float, float] | None:
        """A free place; None when the field is full."""
        for _ in range(400):
            n, e = (float(v) for v in self._rng.uniform(self._low, self._high))
            if all(math.hypot(n - n0, e - e0) > min(gap_m, other) for n0, e0, other in self._taken):
                self._taken.append((n, e, gap_m))
                return n, e
        return None


def _scenario(
    rng: np.random.Generator, seed: int, kind: str, people: list[PersonConfig], places: _Places, things: int
) -> ScenarioConfig:
    drawn = [_thing(rng, place) for place in (places.draw(_THING_GAP_M) for _ in range(things)) if place is not None]
    return ScenarioConfig(
        seed=seed,
        ground=GroundConfig(
            kind=kind,  # pyright: ignore[reportArgumentType]
            size_m=70.0,
            trees=0,
            houses=0,
            road=False,
        ),
        car=CarConfig(north_m=-34.0, east_m=-34.0),
        people=tuple(people),
        things=tuple(thing for thing in drawn if isinstance(thing, ThingConfig)),
        barrels=tuple(thing for thing in drawn if isinstance(thing, BarrelConfig)),
        light=LightConfig(gain=float(rng.uniform(0.85, 1.1)), drift=0.05, drift_period_s=20.0),
        sensor=SensorConfig(noise_sigma=3.0, vignette=0.15),
        depth=_KINECT_DEPTH,
    )


def _still(rng: np.random.Generator, places: _Places, count: int) -> list[PersonConfig]:
    """People who lie and sit, in each run of them all of the postures."""
    drawn = [places.draw(_PERSON_GAP_M) for _ in range(count)]
    order: list[Posture] = [_STATIC[k % len(_STATIC)] for k in range(count)]
    rng.shuffle(order)
    return [_person(rng, p, posture, PathConfig()) for p, posture in zip(drawn, order, strict=True) if p is not None]


def _hover_over_static(rng: np.random.Generator, seed: int) -> Take:
    height, heading = float(rng.uniform(6.0, 7.0)), float(rng.uniform(-math.pi, math.pi))
    reach = 0.42 * height
    places = _Places(rng, (-reach, -reach), (reach, reach))
    scenario = _scenario(rng, seed, "gravel", _still(rng, places, 6), places, 9)
    return Take(scenario, lambda _: (np.array([0.0, 0.0, -height]), heading), Sway(rng))


def _hover_over_moving(rng: np.random.Generator, seed: int) -> Take:
    """Three walk to and fro, two jump, one waves; the gimbal shakes three times."""
    height, heading = float(rng.uniform(6.0, 7.0)), float(rng.uniform(-math.pi, math.pi))
    reach = 0.40 * height
    places = _Places(rng, (-reach, -reach), (reach, reach))
    people = []
    for _ in range(3):
        way = places.draw_way(_WALK_GAP_M, 0.3 * height)
        if way is None:
            continue
        speed = float(rng.uniform(0.7, 1.4))
        corners = tuple(WaypointConfig(north_m=n, east_m=e, speed_m_s=speed, stop_s=0.4) for n, e in way)
        people.append(_person(rng, way[0], "standing", PathConfig(waypoints=corners, mode="ping_pong")))
    for posture in _ON_THE_SPOT:
        place = places.draw(_WALK_GAP_M)
        if place is not None:
            people.append(_person(rng, place, posture, PathConfig()))
    shakes = [(t, t + float(rng.uniform(0.3, 0.6)), float(rng.uniform(10.0, 22.0))) for t in (1.3, 4.1, 6.6)]
    scenario = _scenario(rng, seed, "gravel", people, places, 6)
    return Take(scenario, lambda _: (np.array([0.0, 0.0, -height]), heading), Sway(rng), shakes)


def _fast_pass(rng: np.random.Generator, seed: int) -> Take:
    """Along a line at 4.5 to 5.5 m/s."""
    height, speed = float(rng.uniform(6.0, 7.0)), float(rng.uniform(4.5, 5.5))
    places = _Places(rng, (-14.0, -0.4 * height), (speed * 8.0 - 14.0, 0.4 * height))
    scenario = _scenario(rng, seed, "meadow", _still(rng, places, 8), places, 14)

    def course(t_s: float) -> tuple[Array, float]:
        return np.array([speed * t_s - 16.0, 0.0, -height]), 0.0

    return Take(scenario, course, Sway(rng))


def _fast_passes(rng: np.random.Generator, seed: int) -> Take:
    """To and fro over the same field at 4.5 to 5.5 m/s, each pass 1.2 m beside the last, turning round at the ends."""
    height, speed = float(rng.uniform(6.0, 7.0)), float(rng.uniform(4.5, 5.5))
    half, turn_s = 8.0, 2.0
    places = _Places(rng, (-half + 1.0, -0.38 * height), (half - 1.0, 0.38 * height))
    scenario = _scenario(rng, seed, "meadow", _still(rng, places, 7), places, 12)
    run_s = 2.0 * half / speed
    # While it turns it slows down, moves aside and comes back: a half circle beyond the field's end.

    def course(t_s: float) -> tuple[Array, float]:
        leg, into = divmod(t_s + 0.5 * run_s, run_s + turn_s)
        way = 1.0 if leg % 2 == 0 else -1.0
        east = 1.2 * (leg % 4 - 1.5)
        if into < run_s:
            return np.array([way * (into * speed - half), east, -height]), 0.0 if way > 0 else math.pi
        share = (into - run_s) / turn_s
        radius = speed * turn_s / math.pi
        following = 1.2 * ((leg + 1) % 4 - 1.5)
        smooth = 0.5 - 0.5 * math.cos(math.pi * share)
        north = way * (half + radius * math.sin(math.pi * share))
        heading = (0.0 if way > 0 else math.pi) + math.pi * smooth
        return np.array([north, east + (following - east) * smooth, -height]), heading

    return Take(scenario, course, Sway(rng))


FLIGHTS: tuple[Flight, ...] = (
    Flight(1, 15.0, 221, 3, _hover_over_static),
    Flight(2, 30.0, 251, 3, _hover_over_moving),
    Flight(3, 15.0, 120, 1, _fast_pass),
    Flight(4, 15.0, 645, 3, _fast_passes),
)
"""Rates and lengths of the paper's Table 1."""
