"""Which region is which of the picture before: what lies where somebody stood is not them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from onboard.people.appearance import Look
from onboard.people.pipeline_config import WatchConfig
from onboard.people.sights import Sight
from onboard.people.watch import Watch
from tests.unit.people_bodies import STANDING, pose, region_of

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


def test_after_a_while_out_of_sight_they_have_to_be_found_again():
    (spot,) = _watched(0.3).follow([_sight(0.3)], SECOND // 5)
    assert spot.number == 1
    watch = _watched(0.3)
    watch.follow([], SECOND // 5)
    (spot,) = watch.follow([_sight(0.3)], SECOND // 2)
    assert spot.number == 0 and len(watch.spots) == 2
