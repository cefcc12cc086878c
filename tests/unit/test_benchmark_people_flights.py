"""The four flights of the people benchmark: what is in them, what the sensor gives, and how claims are scored."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from benchmarks.people_flights import FLIGHTS
from benchmarks.people_score import Claim, Score, figures, iou
from benchmarks.people_sensor import DEPTH, shots
from simulation.world.path import car_path
from simulation.world.people_truth import SeenPerson


def _person(number: int, x: int, head: float = 1.0, body: float = 1.0) -> SeenPerson:
    return SeenPerson(number, (x, 0, 40, 80), head, body, np.zeros(3))


def test_claims_are_right_wrong_or_spared():
    score = Score()
    # One found, one missed by a box that is too small, one seen too little to count.
    people = [_person(1, 0), _person(2, 100), _person(3, 200, head=0.2)]
    missed, false = score.add(
        people, [Claim(7, (2, 3, 40, 80)), Claim(8, (100, 0, 40, 30)), Claim(9, (200, 0, 40, 60))]
    )
    assert missed == [2] and [c.number for c in false] == [8]
    # Nobody is there who counts: a claim on somebody half seen is spared, one beside is false.
    missed, false = score.add([_person(3, 200, body=0.4)], [Claim(9, (200, 0, 40, 60)), Claim(10, (400, 0, 40, 60))])
    assert missed == [] and [c.number for c in false] == [10]
    # Whoever gets another number switched.
    score.add([_person(1, 0)], [Claim(11, (0, 0, 40, 80))])
    found = figures({"seq1": score})
    assert found["people_boxes"] == 3.0 and found["id_switches"] == 1.0
    assert found["fn_rate"] == pytest.approx(1 / 3) and found["fp_rate"] == pytest.approx(2 / 3)
    assert found["mota"] == found["seq1_mota"] == found["worst_mota"] == pytest.approx(1 - 4 / 3)


def test_who_is_found_everywhere_scores_one():
    score = Score()
    for _ in range(4):
        score.add([_person(1, 0), _person(2, 100)], [Claim(5, (0, 0, 40, 80)), Claim(6, (100, 0, 40, 80))])
    found = figures({"seq1": score})
    assert found["mota"] == found["idf1"] == 1.0 and found["fn_rate"] == found["fp_rate"] == 0.0


def test_overlap_is_the_share_of_common_area():
    assert iou((0, 0, 10, 10), (0, 0, 10, 10)) == 1.0
    assert iou((0, 0, 10, 10), (5, 0, 10, 10)) == pytest.approx(50 / 150)
    assert iou((0, 0, 10, 10), (20, 0, 10, 10)) == 0.0


def test_the_flights_have_the_papers_rates_and_lengths():
    assert [(f.rate_hz, f.frames) for f in FLIGHTS] == [(15.0, 221), (30.0, 251), (15.0, 120), (15.0, 645)]


@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_a_seed_draws_the_scene_and_nobody_walks_into_anything(number: int):
    make = FLIGHTS[number - 1].make
    take, again, other = (make(np.random.default_rng(seed), seed) for seed in (5, 5, 6))
    assert take.scenario == again.scenario != other.scenario
    scene = take.scenario
    assert len(scene.people) >= 5 and len(scene.things) + len(scene.barrels) >= 4
    things = [(t.north_m, t.east_m) for t in (*scene.things, *scene.barrels)]
    ways = [car_path(p).at(np.linspace(0.0, 9.0, 46)).ned_p_m for p in scene.people]
    for way, (n, e) in itertools.product(ways, things):
        assert np.hypot(way[:, 0] - n, way[:, 1] - e).min() > 0.8
    for a, b in itertools.combinations(ways, 2):
        assert np.hypot(*(a - b).T).min() > 0.8
    one, later = take.motion(1.0), take.motion(1.5)
    fast = number > 2
    assert (4.0 < math.hypot(*one.ned_v_m_s[:2]) < 6.0) if fast else (math.hypot(*one.ned_v_m_s[:2]) < 0.1)
    assert np.hypot(*(later.ned_p_m - one.ned_p_m)[:2]) < (3.5 if fast else 0.6)
    assert -7.5 < one.ned_p_m[2] < -5.5


def test_the_sensor_gives_a_picture_depth_and_the_truth():
    take = FLIGHTS[0].make(np.random.default_rng(8), 8)
    first, second = shots(take, 15.0, 2, 8)
    assert first.picture.shape == (540, 960, 3) and first.picture.std() > 5.0
    assert first.depth_mm.shape == (424, 512) and first.depth_mm.max() <= 1000 * DEPTH.range_max_m
    height_mm = -1000 * take.motion(0.0).ned_p_m[2] - 50  # the camera hangs below the vehicle's middle
    assert np.median(first.depth_mm[first.depth_mm > 0]) == pytest.approx(height_mm, rel=0.05)
    assert 0.0 < (first.depth_mm == 0).mean() < 0.1, "holes"
    assert sum(p.counts for p in first.people) >= 4
    assert second.t_ns - first.t_ns == pytest.approx(1e9 / 15, abs=1)
    assert 0.0 < np.linalg.norm(first.ned_p_m - take.motion(0.0).ned_p_m) < 0.5, "the vehicle is a little wrong"


def test_quick_flights_are_as_long_in_time():
    for flight in FLIGHTS:
        (rate_hz, frames), (quick_hz, few) = flight.pictures(quick=False), flight.pictures(quick=True)
        assert (rate_hz, frames) == (flight.rate_hz, flight.frames)
        assert few <= frames and (few - 1) / quick_hz == pytest.approx((frames - 1) / rate_hz, abs=0.2)
    assert sum(f.pictures(quick=True)[1] for f in FLIGHTS) < 500
