"""Which region is which of the picture before: what lies where somebody stood is not them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from onboard.people.appearance import Look
from onboard.people.pipeline_config import WatchConfig
from onboard.people.regions import Crown
from onboard.people.sights import Sight
from onboard.people.watch import Watch, iou
from tests.unit.people_bodies import STANDING, moved, pose, region_of

SECOND = 1_000_000_000


def _sight(height_m: float, north_m: float = 0.0) -> Sight:
    region = replace(region_of(STANDING), camera_p_m=(0.0, 0.0, 5.0), length_m=0.8, width_m=0.4, height_m=height_m)
    return Sight(region, np.array([north_m, 0.0, 0.0]))


def _watched(height_m: float) -> Watch:
    """A watch that saw one person at 0 s."""
    watch = Watch(WatchConfig())
    (spot,) = watch.follow([_sight(height_m)], 0)
    spot.found(pose(), Look(np.ones((3, 1))), 2.0, 0)
    spot.number = 1
    return watch


def test_a_plank_where_somebody_stood_is_not_them():
    (spot,) = _watched(1.7).follow([_sight(0.35)], SECOND // 30)
    assert spot.number == 0
    (spot,) = _watched(1.7).follow([_sight(1.5, 0.1)], SECOND // 30)
    assert spot.number == 1, "who ducks stays who they are"
    (spot,) = _watched(0.3).follow([_sight(1.7)], SECOND // 30)
    assert spot.number == 0, "who passes by somebody who lies is not them"
    cut = _sight(0.35)
    (spot,) = _watched(1.7).follow([replace(cut, region=replace(cut.region, at_edge=True))], SECOND // 30)
    assert spot.number == 1, "the picture may end below the head"


def test_who_may_stand_is_looked_at_before_what_lies_even_at_an_edge():
    watch = Watch(WatchConfig())
    lying, standing = _sight(0.3), _sight(1.7, 3.0)
    lying = replace(lying, region=replace(lying.region, length_m=1.6, crown=Crown(np.zeros(2), 4.0, 0.05, 0.1)))
    edge = replace(standing, ned_trunk_m=np.zeros(3), region=replace(standing.region, at_edge=True))
    first, *_ = watch.due(watch.follow([lying, edge, _sight(0.3, 6.0)], 0), 0)
    assert first.sight is edge


def test_somebody_not_believed_yet_is_looked_at_again_soon_though_two_looks_found_nobody():
    watch = _watched(0.3)
    (spot,) = watch.spots
    spot.refused("nobody", 1)
    spot.refused("nobody", 2)
    soon = round(0.35 * SECOND)
    assert list(watch.due([spot], soon)) == [spot]
    spot.confirmed = True
    assert list(watch.due([spot], soon)) == [], "who is believed goes on for longer"


def test_a_region_that_is_something_else_is_forgotten():
    watch = _watched(0.3)
    (spot,) = watch.spots
    spot.forget()
    assert spot.pose_now(1) is None and not watch.carries(spot, 1) and spot.number == 0
    assert list(watch.due([spot], 1)) == [spot], "and is as urgent as what is new"


def _boxed(x: float, y: float = 100.0) -> Sight:
    """A region of a detector: a box, no place."""
    region = region_of(STANDING)
    return Sight(replace(region, box_px=(round(x), round(y), *region.box_px[2:])))


def test_without_places_a_box_that_goes_on_is_the_same_after_pictures_that_lack_it():
    watch, step = Watch(WatchConfig()), SECOND // 15
    (first,) = watch.follow([_boxed(100.0)], 0)
    for k in range(1, 7):
        assert watch.follow([_boxed(100.0 + 28 * k)], k * step)[0] is first
    for k in (7, 8):
        watch.follow([], k * step)
    assert watch.follow([_boxed(100.0 + 28 * 9)], 9 * step)[0] is first
    assert iou(_boxed(100.0 + 28 * 9).region.box_px, _boxed(100.0 + 28 * 6).region.box_px) == 0.0
    assert watch.follow([_boxed(700.0)], 10 * step)[0] is not first


def test_without_places_nobody_is_two():
    watch = Watch(WatchConfig())
    spots = watch.follow([_boxed(100.0), _boxed(104.0, 98.0), _boxed(400.0)], 0)
    look = Look(np.ones((3, 1)))
    for spot, shift, number in zip(spots, (0.0, 3.0, 300.0), (2, 1, 0), strict=True):
        spot.found(pose(moved(STANDING, 0.0, 1.0, (shift, 0.0))), look, 2.0, 0)
        spot.number = number
    assert [id(s) for s in watch.shown(spots, 0)] == [id(s) for s in spots[1:]], "who was there first stays"
    assert spots[0] is not watch.spots[0] and len(watch.spots) == 2, "the second box is forgotten"
    assert len(watch.follow([_boxed(100.0), _boxed(105.0)], 1)) == 1, "a second box of somebody is left out"
    # With places it is the depth that says who is where.
    for spot in spots[1:]:
        spot.sight = replace(spot.sight, ned_p_m=np.zeros(3))
        spot.pose = pose()
    assert len(watch.shown(spots[1:], 0)) == 2
