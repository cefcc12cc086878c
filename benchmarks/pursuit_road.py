"""Scenes of the benchmark `pursuit`: roads of right angles, stops, bridges that hide the car, look-alikes beside it."""

from __future__ import annotations

import math

import msgspec
import numpy as np

from benchmarks.chase import paint
from simulation.world.path_config import PathConfig, WaypointConfig
from simulation.world.scenario import (
    CarConfig,
    OccluderConfig,
    RadioConfig,
    ScenarioConfig,
    SensorConfig,
)

Point = tuple[float, float]

_SPEED_M_S = (0.8, 2.0)
_BRIDGED_M_S = (0.9, 1.5)
_ACCELERATION_M_S2 = 0.6  # along and across
_TURN_RATE_RAD_S = 0.7  # a vehicle turns at 0.8 rad/s at most
_START_DELAY_S = 8.0
_HIDDEN_S = (0.7, 1.6)
_DECK_M = 0.56  # just above the car: what it hides then hardly depends on the vehicle's height, 2 to 4 m …
_DECK_SHADOW = 1.12  # … this much more than its own width
_BRIDGED = ((1, 2), (3, 4), (5, 6), (7,))  # legs, of each group the longest: never a thousand pictures without one
_BESIDE_M = 1.25  # from the middle of the road to a parked look-alike
_COLUMNS, _COLUMN_M, _DEPTH_M, _STEP_M = 3, (5.0, 8.0), (6.0, 13.0), 3.5
_BROKEN_FRAMES = 0.02
_STAYS_S = 60.0


def chase_scenario(seed: int) -> ScenarioConfig:
    """A closed road of right angles past home, with bridges, stops, and two look-alikes beside it."""
    rng = np.random.default_rng((seed, 411))
    corners = _corners(rng)
    lengths = [math.dist(a, b) for a, b in _legs(corners)]
    bridged = [max(pair, key=lambda i: lengths[i]) for pair in _BRIDGED]
    waypoints = []
    for i, (north, east) in enumerate(corners):
        speed_m_s = float(rng.uniform(*(_BRIDGED_M_S if i in bridged else _SPEED_M_S)))
        stop_s = float(rng.uniform(1.0, 4.0)) if i and rng.random() < 0.3 else 0.0
        waypoints.append(WaypointConfig(north_m=north, east_m=east, speed_m_s=speed_m_s, stop_s=stop_s))
    path = PathConfig(
        waypoints=tuple(waypoints),
        turn_radius_m=float(rng.uniform(0.8, 1.6)),
        acceleration_m_s2=_ACCELERATION_M_S2,
        lateral_acceleration_m_s2=_ACCELERATION_M_S2,
        turn_rate_rad_s=_TURN_RATE_RAD_S,
        start_delay_s=_START_DELAY_S,
    )
    car = msgspec.structs.replace(CarConfig(), path=path, **paint(rng))
    legs = _legs(corners)
    bridges = tuple(_bridge(legs[i], waypoints[i].speed_m_s, car.length_m, rng) for i in bridged)
    parked = tuple(_look_alike(car, legs[i], rng) for i in rng.choice(len(legs), 2, replace=False))
    return _scenario(seed, car, bridges, parked)


def still_scenario(seed: int) -> ScenarioConfig:
    """A parked car close to home."""
    rng = np.random.default_rng((seed, 412))
    north_m, east_m, heading_deg = (float(rng.uniform(-a, a)) for a in (0.3, 0.3, 60.0))
    return _scenario(
        seed,
        msgspec.structs.replace(CarConfig(north_m=north_m, east_m=east_m, heading_deg=heading_deg), **paint(rng)),
        (),
        (),
    )


def leaving_scenario(seed: int) -> ScenarioConfig:
    """A car that drives away from home, comes back from the side, and stays there."""
    rng = np.random.default_rng((seed, 415))
    turn, side = float(rng.uniform(-math.pi, math.pi)), float(rng.choice((-1.0, 1.0)))
    c, s = math.cos(turn), math.sin(turn)
    way = ((0.0, 0.0, 0.0), (6.0, 0.0, 0.0), (6.0, 5.0, 0.0), (0.5, 5.0, 0.0), (0.5, 0.6, _STAYS_S), (-4.0, 0.6, 0.0))
    path = PathConfig(
        waypoints=tuple(
            WaypointConfig(
                north_m=c * ahead - s * side * beside,
                east_m=s * ahead + c * side * beside,
                speed_m_s=1.8,
                stop_s=stop_s,
            )
            for ahead, beside, stop_s in way
        ),
        turn_radius_m=0.8,
        start_delay_s=_START_DELAY_S,
    )
    return _scenario(seed, msgspec.structs.replace(CarConfig(), path=path, **paint(rng)), (), ())


def _corners(rng: np.random.Generator) -> list[Point]:
    """A closed way with right angles only, from home along a long straight and back to it: a row of columns."""
    while True:
        widths = rng.uniform(*_COLUMN_M, _COLUMNS)
        depths = rng.uniform(*_DEPTH_M, _COLUMNS)
        if np.abs(np.diff(depths)).min() > _STEP_M:
            break
    edges = np.concatenate(([0.0], np.cumsum(widths)))
    middle = float(edges[-1] / 2)
    way: list[Point] = [(0.0, 0.0), (0.0, float(edges[-1]) - middle)]
    for i in reversed(range(_COLUMNS)):
        way += [(float(depths[i]), float(edges[i + 1]) - middle), (float(depths[i]), float(edges[i]) - middle)]
    way.append((0.0, -middle))
    turn, mirror = rng.uniform(-math.pi, math.pi), float(rng.choice((-1.0, 1.0)))
    c, s = math.cos(turn), math.sin(turn)
    return [(float(c * n - s * mirror * e), float(s * n + c * mirror * e)) for n, e in way]


def _legs(corners: list[Point]) -> list[tuple[Point, Point]]:
    return list(zip(corners, [*corners[1:], corners[0]], strict=True))


def _bridge(leg: tuple[Point, Point], speed_m_s: float, car_m: float, rng: np.random.Generator) -> OccluderConfig:
    """A low deck across the middle of a leg, wide enough to hide the whole car for a while."""
    (north_a, east_a), (north_b, east_b) = leg
    along_deg = math.degrees(math.atan2(east_b - east_a, north_b - north_a))
    return OccluderConfig(
        kind="bridge",
        north_m=(north_a + north_b) / 2,
        east_m=(east_a + east_b) / 2,
        heading_deg=along_deg + 90.0,
        span_m=2.6,
        width_m=float(rng.uniform(*_HIDDEN_S) * speed_m_s + car_m) / _DECK_SHADOW,
        height_m=_DECK_M,
    )


def _look_alike(car: CarConfig, leg: tuple[Point, Point], rng: np.random.Generator) -> CarConfig:
    """A parked car in the same colours, otherwise arranged, beside a leg at a quarter or three quarters of it."""
    (north_a, east_a), (north_b, east_b) = leg
    share, side = float(rng.choice((0.25, 0.75))), float(rng.choice((-1.0, 1.0))) * _BESIDE_M
    heading = math.atan2(east_b - east_a, north_b - north_a)
    return CarConfig(
        bonnet=car.boot,
        roof=car.bonnet,
        boot=car.roof,
        stripe=car.stripe,
        north_m=north_a + share * (north_b - north_a) - side * math.sin(heading),
        east_m=east_a + share * (east_b - east_a) + side * math.cos(heading),
        heading_deg=math.degrees(heading) + float(rng.uniform(-8.0, 8.0)),
    )


def _scenario(
    seed: int, car: CarConfig, bridges: tuple[OccluderConfig, ...], parked: tuple[CarConfig, ...]
) -> ScenarioConfig:
    return msgspec.structs.replace(
        ScenarioConfig(),
        seed=seed,
        car=car,
        occluders=bridges,
        distractors=parked,
        sensor=SensorConfig(noise_sigma=2.5, vignette=0.12),
        radio=RadioConfig(block_probability=_BROKEN_FRAMES, block_count=6),
    )
