"""What the limiter promises for every velocity and every set of obstacles."""

from __future__ import annotations

import math

import msgspec
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from common.geometry.rotation import quat_rotate
from common.messages import Obstacle
from onboard.helm.arbiter import Verdict
from onboard.helm.config import HelmConfig
from onboard.helm.pilot import Pilot
from onboard.helm.setpoint import AccelerationSetpoint
from onboard.helm.telemetry import AttitudeSample, PositionSample, Telemetry
from onboard.limiter.config import LimiterConfig
from onboard.limiter.constraints import Bounds, Motion, nearest_ahead, obstacle_rows, plain_rows
from onboard.limiter.law import stoppable, stopped_as_a_whole, stopping_distance_m
from onboard.limiter.limiter import bounded, bounded_many, limit
from onboard.limiter.project import project, project_whole_stops
from onboard.limiter.surroundings import Surroundings, of_obstacles

CONFIGS = [
    *(LimiterConfig(strategy=s) for s in ("proposed", "tti", "dpf")),
    LimiterConfig(push_back_m_s=0.0),
    LimiterConfig(strategy="dpf", push_back_m_s=0.0),
]
_CONFIG = st.sampled_from(CONFIGS)
_SPEED = st.floats(-3.0, 3.0)
_VELOCITY = st.tuples(_SPEED, _SPEED, _SPEED)
_FAST = settings(max_examples=max(150, settings().max_examples))
"""As many as the profile says, where it says more."""


@st.composite
def _unit(draw) -> tuple[float, float, float]:
    azimuth, z = draw(st.floats(-math.pi, math.pi)), draw(st.floats(-1.0, 1.0))
    r = math.sqrt(max(1.0 - z * z, 0.0))
    return (r * math.cos(azimuth), r * math.sin(azimuth), z)


@st.composite
def _obstacle(draw) -> Obstacle:
    return Obstacle(
        distance_m=draw(st.floats(0.0, 12.0)),
        ned_direction=draw(_unit()),
        ned_v_m_s=draw(st.one_of(st.just((0.0, 0.0, 0.0)), st.tuples(*[st.floats(-1.5, 1.5)] * 3))),
    )


_OBSTACLES = st.lists(_obstacle(), max_size=8)


def _size(vector) -> float:
    return float(np.linalg.norm(vector))


def _way(obstacle: Obstacle, config: LimiterConfig) -> tuple[np.ndarray, np.ndarray]:
    """Times and places of an obstacle, as it is foreseen, up to where it comes within h_min of the vehicle."""
    t_s = np.linspace(0.0, config.foresight_s, 161)
    places = obstacle.distance_m * np.array(obstacle.ned_direction) + t_s[:, None] * np.array(obstacle.ned_v_m_s)
    within = np.nonzero(np.linalg.norm(places, axis=1) < config.h_min_m)[0]
    until = max(int(within[0]) if len(within) else len(t_s), 1)
    return t_s[:until], places[:until]


@given(_VELOCITY, _VELOCITY, _OBSTACLES, _CONFIG)
@_FAST
def test_it_is_never_faster_towards_an_obstacle_than_the_bound(asked, flown, obstacles, config):
    """Wherever on its way it is by then: the half-space before the nearest place has all of the way behind it, and the
    vehicle, stopping as it can, ends h_min and the margin before every place."""
    result = np.array(limit(asked, of_obstacles(obstacles), config, ned_vehicle_v_m_s=flown).ned_v_m_s)
    kept_m = config.h_min_m + config.margin_m
    for obstacle in obstacles:
        place = (np.array([obstacle.distance_m]), np.array([obstacle.ned_direction]), np.array([obstacle.ned_v_m_s]))
        distance, normal = nearest_ahead(*place, config)
        speed = float(normal[0] @ result)
        assert speed <= float(stoppable(distance - kept_m, config)[0]) + 1e-6
        if speed > 1e-6:
            _, places = _way(obstacle, config)
            assert (places @ normal[0] - stopping_distance_m(speed, config) >= kept_m - 1e-5).all()


@given(_VELOCITY, _VELOCITY, _OBSTACLES, _CONFIG)
@_FAST
def test_a_stop_from_what_it_allows_keeps_h_min_to_every_obstacle_on_its_way(asked, flown, obstacles, config):
    """Instant by instant, straight on with the delay and the deceleration of the configuration; but for obstacles that
    would come nearer than h_min and the margin to a vehicle that stands.
    """
    v = np.array(limit(asked, of_obstacles(obstacles), config, ned_vehicle_v_m_s=flown).ned_v_m_s)
    speed, delay_s, braking = _size(v), config.stop_delay_s, config.stop_deceleration_m_s2
    kept_m = config.h_min_m + config.margin_m
    for obstacle in obstacles:
        t_s, places = _way(obstacle, config)
        if np.linalg.norm(places, axis=1).min() < kept_m:
            continue
        slowing_s = np.clip(t_s - delay_s, 0.0, speed / braking)
        way_m = speed * (np.minimum(t_s, delay_s) + slowing_s) - 0.5 * braking * slowing_s**2
        flown_m = way_m[:, None] * (v / max(speed, 1e-9))
        assert np.linalg.norm(places - flown_m, axis=1).min() >= kept_m - 1e-5


@given(_VELOCITY, _VELOCITY, _OBSTACLES, _CONFIG)
@_FAST
def test_it_is_never_faster_than_asked_but_for_capped_retreat(asked, flown, obstacles, config):
    still = limit(asked, of_obstacles(obstacles), config).ned_v_m_s
    assert _size(still) <= math.hypot(_size(asked), config.push_back_m_s) + 1e-6
    moving = limit(asked, of_obstacles(obstacles), config, ned_vehicle_v_m_s=flown, dt_s=0.04).ned_v_m_s
    assert _size(moving) <= math.hypot(_size(asked), max(config.push_back_m_s, config.brake_m_s)) + 1e-6
    firm = msgspec.structs.replace(config, push_back_m_s=0.0)
    assert _size(limit(asked, of_obstacles(obstacles), firm).ned_v_m_s) <= _size(asked) + 1e-6


@given(_VELOCITY, _OBSTACLES, _CONFIG)
@_FAST
def test_what_approaches_nothing_passes_unchanged(asked, obstacles, config):
    away = [
        o for o in obstacles if np.dot(asked, o.ned_direction) <= 0.0 and np.dot(o.ned_v_m_s, o.ned_direction) >= 0.0
    ]
    limited = limit(asked, of_obstacles(away), config, ned_vehicle_v_m_s=asked)
    assert limited.ned_v_m_s == asked and limited.why == "clear"


@given(_unit(), _unit(), st.floats(0.0, 8.0), st.floats(0.0, 3.0), _CONFIG)
@_FAST
def test_along_an_obstacle_passes_unchanged(normal, other, distance, speed, config):
    along = np.cross(normal, other)
    asked = (speed * along).tolist()
    result = limit(tuple(asked), of_obstacles([Obstacle(distance_m=distance, ned_direction=normal)]), config).ned_v_m_s
    assert np.allclose(result, asked, atol=1e-6)


@given(_VELOCITY, _VELOCITY, _OBSTACLES, st.floats(-math.pi, math.pi), _unit(), _CONFIG)
@_FAST
def test_it_has_no_preferred_direction(asked, flown, obstacles, angle, axis, config):
    q = np.array([math.cos(angle / 2), *(math.sin(angle / 2) * np.array(axis))])

    def turned(vector):
        x, y, z = quat_rotate(q, np.array(vector))
        return (float(x), float(y), float(z))

    around = [
        Obstacle(distance_m=o.distance_m, ned_direction=turned(o.ned_direction), ned_v_m_s=turned(o.ned_v_m_s))
        for o in obstacles
    ]
    straight = limit(asked, of_obstacles(obstacles), config, ned_vehicle_v_m_s=flown).ned_v_m_s
    result = limit(turned(asked), of_obstacles(around), config, ned_vehicle_v_m_s=turned(flown)).ned_v_m_s
    assert np.allclose(result, quat_rotate(q, np.array(straight)), atol=1e-4)


@given(_VELOCITY, _unit(), st.floats(0.3, 9.0), st.floats(-1e-3, 1e-3), _VELOCITY, _CONFIG)
@_FAST
def test_a_small_change_of_the_inputs_changes_little(asked, direction, distance, step, nudge, config):
    """One standing obstacle: 60 m/s per metre (the steepest curve near h_min), 45 per m/s: the curve's v_max grows in
    over the first 0.1 m/s of approach."""
    first = limit(asked, of_obstacles([Obstacle(distance_m=distance, ned_direction=direction)]), config).ned_v_m_s
    near = of_obstacles([Obstacle(distance_m=distance + step, ned_direction=direction)])
    assert _size(np.subtract(limit(asked, near, config).ned_v_m_s, first)) <= 60.0 * abs(step) + 1e-6
    other = tuple((np.array(asked) + 1e-3 * np.array(nudge)).tolist())
    same = of_obstacles([Obstacle(distance_m=distance, ned_direction=direction)])
    assert _size(np.subtract(limit(other, same, config).ned_v_m_s, first)) <= 45e-3 * _size(nudge) + 1e-6


@given(_VELOCITY, _OBSTACLES, st.sampled_from([math.nan, math.inf, -math.inf]), st.integers(0, 6), _CONFIG)
@_FAST
def test_what_is_not_finite_stands_still(asked, obstacles, bad, where, config):
    around = of_obstacles([*obstacles, Obstacle(distance_m=5.0, ned_direction=(1.0, 0.0, 0.0))])
    if where < 3:
        broken = tuple(bad if axis == where else c for axis, c in enumerate(asked))
        assert limit(broken, around, config).ned_v_m_s == (0.0, 0.0, 0.0)
    else:
        around.distance_m[-1] = bad if where == 3 else around.distance_m[-1]
        around.ned_direction[-1, 0] = bad if where == 4 else 1.0
        around.ned_v_m_s[-1, 1] = bad if where >= 5 else 0.0
        assert limit(asked, around, config).ned_v_m_s == (0.0, 0.0, 0.0)
    assert limit(asked, None, config).ned_v_m_s == (0.0, 0.0, 0.0)
    assert limit(asked, Surroundings(), config).ned_v_m_s == asked


@given(st.lists(_VELOCITY, min_size=4, max_size=4), _OBSTACLES, _CONFIG)
@_FAST
def test_the_compiled_half_spaces_are_those_of_the_law_as_it_is_written(velocities, obstacles, config):
    around, motion = of_obstacles(obstacles), Motion(*np.array(velocities))
    h, n, v = around.distance_m, around.ned_direction, around.ned_v_m_s
    rows = obstacle_rows(h, n, v, motion, config)
    for compiled, plain in zip(rows, plain_rows(h, n, v, motion, config), strict=True):
        assert compiled.shape == plain.shape and np.allclose(compiled, plain, rtol=0.0, atol=1e-9)
    two = obstacle_rows(
        np.stack([h, h]), np.stack([n, n]), np.stack([v, v]), Motion(*np.stack([motion] * 2, 1)), config
    )
    for many, one in zip(two, rows, strict=True):
        assert (many == one).all()


_LEVEL = st.tuples(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0))


@given(_LEVEL, _VELOCITY, _OBSTACLES, st.booleans(), _CONFIG)
@_FAST
def test_an_acceleration_leads_to_no_more_than_the_bound_within_the_braking_horizon(asked, flown, obstacles, off, law):
    """Through helm's pilot, which flies it: within the horizon, or by as hard a brake as is allowed."""
    helm, t_ns = HelmConfig(), 1_000_000_000
    attitude = AttitudeSample(t_ns, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    position = PositionSample(t_ns, (0.0, 0.0, -5.0), flown)
    telemetry = Telemetry(found=True, attitude=attitude, position=position, home_local_m=(0.0, 0.0, 0.0))
    pilot = Pilot(helm, law)
    pilot.push_back(not off)
    pilot.reset(telemetry, t_ns)
    verdict = Verdict("pursuit", (0.0, 0.0, 0.0), 0.0, 0.0, ned_a_m_s2=asked)
    now = pilot.fly(verdict, telemetry, of_obstacles(obstacles), t_ns + 20_000_000)
    assert now is not None and isinstance(now.local, AccelerationSetpoint)
    north, east = now.local.north_m_s2, now.local.east_m_s2
    v, horizon_s = np.array(flown), law.stop_delay_s
    led_to = np.array([v[0] + north * horizon_s, v[1] + east * horizon_s, now.limited.ned_v_m_s[2]])
    most = helm.containment.braking_m_s2
    assert math.hypot(north, east) <= most + 1e-9
    for obstacle in obstacles:
        place = (np.array([obstacle.distance_m]), np.array([obstacle.ned_direction]), np.array([obstacle.ned_v_m_s]))
        distance, normal = nearest_ahead(*place, law)
        bound = float(stoppable(distance - law.h_min_m - law.margin_m, law)[0])
        braked = math.hypot(north, east) >= most - 1e-6
        share = most * horizon_s / max(math.dist(now.limited.ned_v_m_s[:2], flown[:2]), 1e-9) if braked else 1.0
        # A vehicle too fast for one horizon comes as near to the bound as the hardest braking brings it.
        reached = (1.0 - share) * float(normal[0, :2] @ v[:2]) + share * bound
        vertical = (1.0 - share) * float(normal[0, 2] * led_to[2])
        assert float(normal[0] @ led_to) <= max(reached + vertical, bound) + 1e-6


_ROWS = st.lists(st.tuples(_unit(), st.floats(-0.5, 2.0)), min_size=1, max_size=12)


@given(_VELOCITY, _ROWS)
@_FAST
def test_the_projection_is_the_nearest_point(asked, rows):
    """Optimality: what was taken away is a sum of normals of active half-spaces with positive weights."""
    v, normals = np.array(asked), np.array([n for n, _ in rows])
    bounds = np.maximum([b for _, b in rows], 0.0)
    w = project(v, normals, bounds)
    assert (normals @ w <= bounds + 1e-7).all()
    # The nearest point is the only one for which (v - w)·(x - w) <= 0 for all x of the set; the set is a cone hull of
    # the origin's neighbourhood, so it is enough to try the origin and points that keep to every bound by scaling.
    for x in (np.zeros(3), v, *normals, *-normals, *np.eye(3)):
        reach = normals @ x
        share = min([1.0, *(b / r for b, r in zip(bounds, reach, strict=True) if r > b)])
        assert (v - w) @ (share * x - w) <= 1e-4, "three nearly dependent normals cost a few digits"


@given(_VELOCITY, _ROWS, st.lists(st.booleans(), min_size=12, max_size=12))
@_FAST
def test_the_hard_bounds_are_those_of_a_stop_as_a_whole_from_the_result(asked, rows, hard):
    """It is the nearest velocity under bounds as low as its own speed makes them."""
    config, v = LimiterConfig(), np.array(asked)
    normals, bounds = np.array([n for n, _ in rows]), np.maximum([b for _, b in rows], 0.0)
    firm = np.array(hard[: len(rows)])
    (w,), (lowered,) = project_whole_stops(v[None], normals[None], bounds[None], firm[None], config)
    at_its_speed = np.where(firm, stopped_as_a_whole(bounds, _size(w), config), bounds)
    assert (lowered <= bounds).all() and (lowered >= stopped_as_a_whole(bounds, _size(v), config) - 1e-9).all()
    assert np.allclose(w, project(v, normals, lowered), atol=1e-6)
    assert np.allclose(w, project(v, normals, at_its_speed), atol=1e-5)
    towards, whole_s = normals @ w, config.stop_delay_s + _size(w) / (2.0 * config.stop_deceleration_m_s2)
    rooms_m = np.array([stopping_distance_m(b, config) for b in bounds])
    assert (towards * whole_s <= np.where(firm, rooms_m, np.inf) + 1e-6).all()


@given(
    st.lists(
        st.tuples(_VELOCITY, st.lists(st.tuples(_unit(), st.floats(-0.5, 2.0)), min_size=4, max_size=4)),
        min_size=1,
        max_size=6,
    )
)
@settings(max_examples=max(60, settings().max_examples // 10))
def test_many_at_once_are_the_same_as_one_by_one(cases):
    asked = np.array([v for v, _ in cases])
    bounds = np.array([[b for _, b in rows] for _, rows in cases])
    normals = np.array([[n for n, _ in rows] for _, rows in cases])
    rows = Bounds(normals, bounds, np.zeros_like(bounds), np.tile([False, False, True, True], (len(cases), 1)))
    config = LimiterConfig()
    together, _ = bounded_many(asked, rows, config)
    for k in range(len(cases)):
        alone, _ = bounded(asked[k], Bounds(*(part[k] for part in rows)), config)
        assert np.allclose(together[k], alone, atol=1e-9)
