"""What the limiter remembers: points carried to now, directions looked at, silence."""

from __future__ import annotations

import math

import numpy as np
import pytest

from common.geometry.rotation import matrix_to_quat
from common.messages import Obstacle, Obstacles, Vec3, View
from onboard.limiter.config import LimiterConfig
from onboard.limiter.law import stoppable
from onboard.limiter.limiter import limit
from onboard.limiter.map import ObstacleMap
from onboard.limiter.status import limiter_status, sectors_m
from onboard.limiter.surroundings import Surroundings, of_obstacles

CONFIG = LimiterConfig()
HOME: Vec3 = (0.0, 0.0, 0.0)
S = 1_000_000_000


def view(yaw_rad: float = 0.0, seen: tuple[bool, ...] = (True,), columns: int = 1) -> View:
    """A level sensor that looks 8 m far, 45 degrees to either side and 30 up and down."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    q = matrix_to_quat(np.array([[-s, 0.0, c], [c, 0.0, s], [0.0, 1.0, 0.0]]))
    w, x, y, z = (float(part) for part in q)
    return View(
        ned_q_sensor=(w, x, y, z),
        half_width_rad=math.pi / 4,
        half_height_rad=math.pi / 6,
        range_m=8.0,
        columns=columns,
        rows=1,
        seen=seen,
    )


def ahead(distance_m: float, v: Vec3 = HOME, label: str = "") -> Obstacle:
    return Obstacle(distance_m=distance_m, ned_direction=(1.0, 0.0, 0.0), ned_v_m_s=v, label=label)


def heard(*messages: tuple[int, Obstacles], source: str = "obstacles/depth", **settings: object) -> ObstacleMap:
    known = ObstacleMap(LimiterConfig(**settings))  # pyright: ignore[reportArgumentType]
    for t_ns, message in messages:
        known.follow(HOME, t_ns)
        known.hear(source, message, t_ns)
    return known


def now(known: ObstacleMap, t_ns: int, ned_p_m: Vec3 = HOME) -> Surroundings:
    around = known.now(ned_p_m, t_ns)
    assert around is not None
    return around


def test_a_vehicle_without_any_source_flies_as_asked_unless_it_must_see():
    around = now(ObstacleMap(CONFIG), S)
    limited = limit((3.0, 1.0, 0.0), around, CONFIG)
    assert limited.ned_v_m_s == (3.0, 1.0, 0.0) and limited.zone == "blind" and limited.why == "clear"
    assert ObstacleMap(LimiterConfig(required=True)).now(HOME, S) is None
    assert limit((3.0, 1.0, 0.0), None, CONFIG).why == "no data"


def test_points_stand_still_in_the_world_while_the_vehicle_moves_on():
    known = heard((S, Obstacles(obstacles=(ahead(5.0),))))
    around = now(known, S + S // 5, (2.0, 3.0, 0.0))
    assert around.distance_m == pytest.approx([math.hypot(3.0, 3.0)])
    assert around.ned_direction[0] == pytest.approx([math.sqrt(0.5), -math.sqrt(0.5), 0.0])


def test_a_message_is_placed_by_where_the_vehicle_was_when_it_was_true():
    known = ObstacleMap(CONFIG)
    for k in range(11):
        known.follow((0.2 * k, 0.0, 0.0), S + k * S // 10)
    known.hear("obstacles/depth", Obstacles(obstacles=(ahead(5.0),)), S + S // 2)
    assert now(known, 2 * S, (2.0, 0.0, 0.0)).distance_m == pytest.approx([4.0])


def test_what_should_be_here_by_now_is_not_forgotten_until_it_is_looked_for():
    """Walkers out of view for 8 s: one comes near, one goes away; then the sensor looks where the first should be."""
    near, away = ahead(8.0, v=(-0.7, 0.0, 0.0), label="near"), ahead(3.0, v=(0.9, 0.0, 0.0), label="away")
    aside = Obstacles(obstacles=(), views=(view(math.pi / 2),))
    known = heard((S, Obstacles(obstacles=(near, away), views=(view(),))), *((k * S, aside) for k in range(2, 10)))
    around = now(known, 9 * S)
    assert list(around.labels) == ["near"]
    assert around.distance_m[0] == pytest.approx(8.0 - 0.7 * 8.0, abs=1e-6)
    unsure_m = 7.5 * math.hypot(CONFIG.spread_m_s, CONFIG.velocity_error_m_s)
    assert around.least_m[0] == pytest.approx(max(2.4 - unsure_m, 0.0), abs=1e-6)
    known.hear("obstacles/depth", Obstacles(obstacles=(), views=(view(),)), 9 * S + 1)
    assert not len(now(known, 9 * S + 1).labels)


def test_a_walker_walks_on():
    known = heard((S, Obstacles(obstacles=(ahead(5.0, (-1.5, 0.0, 0.0)),))))
    assert now(known, S + 4 * S // 10).distance_m == pytest.approx([4.4])


def test_out_of_view_a_walker_walks_on_as_over_the_last_second_and_not_as_in_the_last_sample():
    """One who was measured often is known better: the mean is carried on, and the uncertainty is less."""
    errors = [0.2 if k % 2 else -0.2 for k in range(30)]
    walk = [ahead(9.0 - 0.1 * k, v=(-1.0 + e, 0.0, 0.0), label="person 1") for k, e in enumerate(errors)]
    aside = (view(math.pi / 2),)
    known = heard(*((S + k * S // 10, Obstacles(obstacles=(o,), views=(view(),))) for k, o in enumerate(walk)))
    seen = now(known, S + 29 * S // 10)
    assert seen.ned_v_m_s[0, 0] == pytest.approx(-0.8), "in view the newest sample counts"
    known.hear("obstacles/depth", Obstacles(obstacles=(), views=aside), S + 39 * S // 10)
    later = now(known, S + 39 * S // 10)
    assert later.ned_v_m_s[0, 0] == pytest.approx(-1.0, abs=0.02)
    assert later.distance_m[0] == pytest.approx(5.1, abs=0.02)
    once = now(heard((S, Obstacles(obstacles=(walk[-1],), views=(view(),)))), 2 * S)
    assert later.unsure_m is not None and once.unsure_m is not None
    assert 0.5 * CONFIG.spread_m_s < later.unsure_m[0] < 0.7 * once.unsure_m[0]


def test_obstacles_of_a_silent_source_stay_grow_and_go():
    known = heard((S, Obstacles(obstacles=(ahead(5.0, label="person 3"),))), source="obstacles/people")
    assert now(known, S + S // 2).distance_m == pytest.approx([5.0])
    later = now(known, S + 5 * S // 2)
    assert later.least_m == pytest.approx([5.0 - 2.0 * CONFIG.spread_m_s])
    assert (later.labels, later.sources) == (["person 3"], ["obstacles/people"])
    assert not len(now(known, 8 * S).distance_m)


def test_an_older_message_changes_nothing():
    known = heard((2 * S, Obstacles(obstacles=(ahead(5.0),))), (S, Obstacles(obstacles=(ahead(1.0),))))
    assert now(known, 2 * S).distance_m == pytest.approx([5.0])


def test_a_point_out_of_view_is_remembered_and_one_looked_at_again_is_not():
    barrel = Obstacles(obstacles=(ahead(4.0),), views=(view(),))
    turned = heard((S, barrel), (2 * S, Obstacles(obstacles=(), views=(view(math.pi / 2),))))
    assert now(turned, 2 * S).distance_m == pytest.approx([4.0])
    gone = heard((S, barrel), (2 * S, Obstacles(obstacles=(), views=(view(),))))
    assert not len(now(gone, 2 * S).distance_m)
    unsure = heard((S, barrel), (2 * S, Obstacles(obstacles=(), views=(view(seen=(False,)),))))
    assert now(unsure, 2 * S).distance_m == pytest.approx([4.0]), "no measurement is not free"


@pytest.mark.parametrize(
    ("direction", "fastest"),
    [
        ((1.0, 0.0, 0.0), float(stoppable(8.0 - CONFIG.h_min_m - CONFIG.margin_m, CONFIG))),
        ((-1.0, 0.0, 0.0), CONFIG.unseen_speed_m_s),
        ((0.0, 1.0, 0.0), CONFIG.unseen_speed_m_s),
        ((0.0, 0.0, -1.0), CONFIG.unseen_speed_m_s),
    ],
)
def test_where_nobody_looks_the_speed_is_bounded(direction: Vec3, fastest: float):
    around = now(heard((S, Obstacles(obstacles=(), views=(view(),)))), S)
    asked = (5.0 * direction[0], 5.0 * direction[1], 5.0 * direction[2])
    limited = limit(asked, around, CONFIG)
    assert np.linalg.norm(limited.ned_v_m_s) == pytest.approx(fastest)
    assert limited.why == "blind"


def test_cells_without_a_measurement_are_not_free():
    around = now(heard((S, Obstacles(obstacles=(), views=(view(seen=(True, False), columns=2),)))), S)
    fast, slow = (np.linalg.norm(limit((3.0, e, 0.0), around, CONFIG).ned_v_m_s) for e in (-1.0, 1.0))
    assert fast == pytest.approx(math.hypot(3.0, 1.0)) and slow == pytest.approx(CONFIG.unseen_speed_m_s)


def test_a_place_that_was_looked_at_is_known_for_a_while():
    looks = [(S + k * S // 10, Obstacles(obstacles=(), views=(view(math.pi),))) for k in range(1, 41)]
    known = heard((S, Obstacles(obstacles=(), views=(view(),))), *looks)
    speeds = [
        float(np.linalg.norm(limit((2.0, 0.0, 0.0), now(known, S + k * S // 2), CONFIG).ned_v_m_s)) for k in range(9)
    ]
    assert speeds[0] == speeds[1] == 2.0, "just turned away"
    assert speeds == sorted(speeds, reverse=True)
    assert speeds[-1] == pytest.approx(CONFIG.unseen_speed_m_s)


@pytest.mark.parametrize("silent", [True, False])
def test_a_blind_source_slows_the_vehicle_down_and_then_stops_it(silent: bool):
    """As it was up to late_s, at what the unseen allows from stale_s on, and standing a second after unseen_stop_s."""
    known = heard((S, Obstacles(obstacles=(), views=(view(),))))
    ages_s, speeds = np.arange(0.0, 4.0, 0.02), []
    for age_s in ages_s:
        t_ns = S + round(age_s * S)
        if not silent:
            known.follow(HOME, t_ns)
            known.hear("obstacles/depth", Obstacles(obstacles=(), views=(view(seen=(False,)),)), t_ns)
        speeds.append(float(np.linalg.norm(limit((2.0, 0.0, 0.0), now(known, t_ns), CONFIG).ned_v_m_s)))
    speeds = np.array(speeds)
    assert (speeds[ages_s <= CONFIG.late_s] == 2.0).all() and (np.diff(speeds) <= 0.0).all()
    blind = (ages_s >= CONFIG.stale_s) & (ages_s <= CONFIG.stale_s + CONFIG.unseen_stop_s)
    assert speeds[blind] == pytest.approx(CONFIG.unseen_speed_m_s)
    steepest = 2.0 * (float(stoppable(8.0, CONFIG)) - CONFIG.unseen_speed_m_s) / (CONFIG.stale_s - CONFIG.late_s)
    assert np.diff(speeds).min() >= -steepest * 0.02, "no jump"
    assert (speeds[ages_s >= CONFIG.stale_s + CONFIG.unseen_stop_s + 1.0] == 0.0).all()
    assert now(known, 4 * S).blind


def test_a_surface_overhead_is_remembered_as_overhead_and_only_near_there():
    rim = Obstacle(distance_m=1.6, ned_direction=(0.0, 0.0, -1.0))
    known = heard(
        (S, Obstacles(obstacles=(rim,), views=(view(),))), (S + S // 10, Obstacles(obstacles=(), views=(view(),)))
    )
    near = now(known, S + S // 5, (1.0, 0.0, 0.0))
    assert near.distance_m == pytest.approx([1.6])
    assert near.ned_direction[0] == pytest.approx([0.0, 0.0, -1.0])
    assert limit((-0.6, 0.0, 0.0), near, CONFIG).why == "clear", "level flight goes on"
    assert limit((0.0, 0.0, -0.6), near, CONFIG).why in ("curve", "bound"), "a climb is slowed"
    assert not len(now(known, S + S // 5, (0.0, 3.1, 0.0)).distance_m)
    person = Obstacle(distance_m=1.6, ned_direction=(0.0, 0.0, 1.0), label="person 1")
    beneath = heard((S, Obstacles(obstacles=(person,))), source="obstacles/people")
    assert now(beneath, S, (1.2, 0.0, 0.0)).distance_m == pytest.approx([2.0]), "who has a name is where they are"


def test_the_sectors_show_obstacles_free_space_and_the_unknown():
    around = now(heard((S, Obstacles(obstacles=(ahead(4.0),), views=(view(),)))), S)
    shown = sectors_m(around)
    assert shown[0] == pytest.approx(4.0) and shown[4] == pytest.approx(8.0) and shown[36] == -1.0
    above = of_obstacles([Obstacle(distance_m=2.0, ned_direction=(0.0, 0.0, -1.0))])
    assert sectors_m(above) == (-1.0,) * 72
    turned = heard(
        (S, Obstacles(obstacles=(ahead(4.0),), views=(view(),))),
        (6 * S, Obstacles(obstacles=(), views=(view(math.pi),))),
    )
    around = now(turned, 6 * S)
    status = limiter_status(limit(HOME, around, CONFIG), around, CONFIG)
    assert status.sectors_m[0] == pytest.approx(4.0) and not status.seen[0], "remembered, and nobody looks there"
    assert status.sectors_m[4] == -1.0 and status.seen[36] and status.sectors_m[36] == pytest.approx(8.0)


def test_the_status_names_what_limits():
    around = now(heard((S, Obstacles(obstacles=(ahead(2.0, label="barrel"),), views=(view(),)))), S)
    status = limiter_status(limit((2.0, 0.0, 0.0), around, CONFIG), around, CONFIG)
    status.check()
    assert (status.why, status.source, status.label) == ("curve", "obstacles/depth", "barrel")
    assert (status.zone, status.asked_m_s) == ("transition", 2.0)
    fast = limit((2.0, 0.0, 0.0), around, CONFIG, ned_vehicle_v_m_s=(3.0, 0.0, 0.0), dt_s=0.04)
    assert fast.why == "bound" and fast.ned_v_m_s[0] <= 0.0, "faster than it can stop: it brakes"
