"""The hall of the benchmark `follow`: where things are drawn, what the depth sensor reads, when a target is lost."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from benchmarks import follow_course, follow_ground, follow_pan_tilt
from benchmarks.base import Settings
from benchmarks.follow import run
from benchmarks.follow_depth import DepthEye
from benchmarks.follow_ground import Course, depth_patch
from benchmarks.follow_scene import Hall, Lens, Light, Thing, camera, hidden_share
from benchmarks.follow_score import Score
from benchmarks.follow_solids import bin_, person, pillar
from common.config import ConfigError
from common.geometry.rotation import quat_from_euler
from common.processes import load_config
from common.tracking.registry import make_tracker
from onboard.fusion.config import FusionConfig
from onboard.fusion.foreseen import core_of
from onboard.fusion.tracker import HabDfTracker

EYE = camera(320, 240, math.radians(70.0))
HALL = Hall((8.0, 8.0), 1, noise=0.0)


@pytest.mark.parametrize(("lean_rad", "within_px"), [(0.0, 2.5), (0.9, 14.0)])
@pytest.mark.parametrize("roll_rad", [0.0, 0.1])
def test_a_thing_is_drawn_where_its_box_is(lean_rad: float, within_px: float, roll_rad: float) -> None:
    solid, _ = person(np.random.default_rng(2))
    lens = Lens(EYE, np.array([0.5, -0.3, -1.4]), quat_from_euler(roll_rad, -0.05, 0.3))
    thing = Thing(solid, np.array([4.0, 0.8, 0.0]), 1.0, lean_rad)
    shown = lens.show(thing)
    assert shown is not None
    drawn = HALL.picture(lens, [thing], Light()).astype(int) - HALL.picture(lens, [], Light())
    rows, columns = np.nonzero(np.abs(drawn).max(axis=2) > 3)
    x, y, width, height = shown.box
    slack = within_px + 40.0 * roll_rad * (lean_rad == 0.0)  # the box is of the upright picture
    assert [columns.min(), columns.max() + 1] == pytest.approx([x, x + width], abs=slack)
    assert [rows.min(), rows.max() + 1] == pytest.approx([y, y + height], abs=slack)


def test_what_stands_before_the_target_hides_it() -> None:
    rng = np.random.default_rng(3)
    lens = Lens(EYE, np.array([0.0, 0.0, -1.0]), quat_from_euler(0.0, 0.0, 0.0))
    target = Thing(person(rng)[0], np.array([4.0, 0.0, 0.0]))
    post = pillar(rng, 1.0, 3.0)
    assert hidden_share(lens, target, [Thing(post, np.array([2.0, 0.0, 0.0]))]) == 1.0
    assert hidden_share(lens, target, [Thing(post, np.array([6.0, 0.0, 0.0]))]) == 0.0
    assert lens.show(Thing(post, np.array([-2.0, 0.0, 0.0]))) is None, "it is behind"


def test_the_depth_sensor_sees_no_further_than_a_metre() -> None:
    rng = np.random.default_rng(4)
    lens = Lens(EYE, np.array([0.0, 0.0, -0.35]), quat_from_euler(0.0, 0.0, 0.0))
    for distance_m, empty in ((0.8, 0.15), (1.6, 0.97)):
        thing = Thing(bin_(rng), np.array([distance_m, 0.0, 0.0]))
        shown = lens.show(thing)
        assert shown is not None
        patch = depth_patch(rng, lens, shown.box, [(thing, shown)])
        assert float((patch == 0.0).mean()) == pytest.approx(empty, abs=0.1)
        if distance_m < 1.0:
            assert float(np.median(patch[patch > 0])) == pytest.approx(0.8, abs=0.03)


def test_the_depth_camera_shows_who_passes_before_the_target_and_the_end_of_its_range() -> None:
    rng = np.random.default_rng(5)
    lens = Lens(EYE, np.array([0.0, 0.0, -1.5]), quat_from_euler(0.0, 0.0, 0.0))
    solid, _ = person(rng)
    target, passing = Thing(solid, np.array([4.0, 0.0, 0.0])), Thing(solid, np.array([3.0, 0.6, 0.0]))
    eye = DepthEye((320, 240), math.radians(70.0), 0.0, 6)
    depth = eye.picture(Hall((9.0, 9.0), 1), lens, [target, passing])
    assert depth.shape == (120, 160)
    for thing, distance_m in ((target, 4.0), (passing, 3.0)):
        shown = lens.show(thing)
        assert shown is not None
        core = core_of(depth, shown.box, (240, 320))
        assert core is not None and float(np.median(core[core > 0.0])) == pytest.approx(distance_m, abs=0.03)
    assert depth[119, 5] == pytest.approx(1.5 / math.tan(math.atan(59.5 / 114.25)), rel=0.03), "the floor"
    assert not depth[45:58, 5:40].any(), "the wall is nine metres off"


def test_the_course_of_the_ground_robot_is_as_long_as_told() -> None:
    course = Course(5, 12.0)
    steps = np.linalg.norm(np.diff(course.places, axis=0), axis=1)
    assert steps.sum() == pytest.approx(12.0, abs=0.1)
    assert len(course._hidden_from) >= 1, "a full occlusion at least"
    assert course.courses[0] == 0.0 and np.ptp(course.courses[:90]) == 0.0, "it begins straight on"
    assert np.ptp(course.courses) > 0.5 and np.abs(np.diff(course.courses)).max() <= 0.9 / 30 + 1e-9
    assert {course.light(0, 0.0).gain, course.light(course.frames - 1, 0.0).gain} != {(1.0, 1.0, 1.0)}


@pytest.mark.parametrize("kind", follow_pan_tilt.TARGETS)
def test_what_the_head_looks_at_begins_calmly(kind: str) -> None:
    course = follow_pan_tilt.Course(kind, 4, 900)
    things = [course.things(index)[0] for index in range(900)]
    headings = np.unwrap([thing.heading_rad for thing in things])
    assert np.abs(headings[:30] - headings[0]).max() < 0.35 < np.ptp(headings)
    moved = np.linalg.norm(np.diff([thing.ned_p_m for thing in things], axis=0), axis=1) * follow_pan_tilt.RATE_HZ
    assert moved[:15].max() < moved.max()
    distances = [float(np.hypot(*thing.ned_p_m[:2])) for thing in (things[0], things[-1])]
    assert distances[1] > distances[0]


@pytest.mark.parametrize("seed", [3, 8])
def test_everything_happens_on_the_uavs_course_and_he_stays_in_the_hall(seed: int) -> None:
    course = follow_course.Course(seed, 2400)
    for row in follow_course.ROWS:
        drawn = [event for event in course.events if event.kind in row]
        assert {event.kind for event in drawn[: len(row)]} == set(row), "each once before any again"
        ends = [event.begin_s + row[event.kind] for event in drawn]
        assert all(event.begin_s >= end for event, end in zip(drawn[1:], ends, strict=False)), "one at a time in a row"
    kinds = [{event.kind for event, _ in course.on(index)} for index in range(2400)]
    assert sum(len(k) == 3 for k in kinds) > 600, "one of each row at once"
    assert not any("aside" in k and k & set(follow_course.BESIDE) for k in kinds), "nobody could tell them apart"
    places = np.array([course.target(index).ned_p_m for index in range(0, 2400, 5)])
    assert np.abs(places).max() < follow_course.HALF_M[0] - 2.0
    speeds_m_s = np.linalg.norm(np.diff(places, axis=0), axis=1) * follow_course.RATE_HZ / 5
    assert speeds_m_s.max() < 4.1 and speeds_m_s.mean() > 0.4
    again = follow_course.Course(seed, 2400)
    assert again.events == course.events and (again.target(900).ned_p_m == course.target(900).ned_p_m).all()


def test_what_happens_on_the_uavs_course_is_seen() -> None:
    course = follow_course.Course(3, 2400)
    eye = np.array([0.0, 0.0, -1.5])

    def middle(kind: str, share: float = 0.5) -> int:
        event = next(event for event in course.events if event.kind == kind)
        return round((event.begin_s + share * follow_course.KINDS[kind]) * follow_course.RATE_HZ)

    for kind in ("screen", "crossing"):
        index = middle(kind)
        target = course.target(index)
        away = target.ned_p_m / np.linalg.norm(target.ned_p_m)
        lens = Lens(EYE, target.ned_p_m - 3.0 * away + eye, quat_from_euler(0.0, 0.0, math.atan2(away[1], away[0])))
        hidden = hidden_share(lens, target, course.others(index, lens.ned_p_m))
        assert hidden > (0.85 if kind == "screen" else 0.4), "he may bend over behind it"
    assert abs(course.target(middle("lean")).lean_rad) > 0.29
    headings = [course.target(middle("turn", share)).heading_rad for share in (0.15, 0.99)]
    assert abs(headings[1] - headings[0]) == pytest.approx(2 * math.pi, abs=0.35), "once round"
    assert max(course.light(middle("light"), 0.0).gain) < 0.95
    assert course.operators_turn_rad_s(middle("aside", 0.2)) in (-0.8, 0.8)
    assert course.operators_turn_rad_s(middle("aside", 0.8)) is None
    quiet = np.array([1.0, 0.0, 0.0, 0.0])
    shaken = [course.shaken(middle("shake") + step, quiet) for step in range(6)]
    assert max(abs(q[3]) for q in shaken) > 0.005 and (course.shaken(0, quiet) == quiet).all()


def test_who_walks_beside_him_does_not_fly_round_him_while_he_turns_about() -> None:
    course, together = follow_course.Course(3, 2400), 0
    for event in (event for event in course.events if event.kind == "companion"):
        first, last = (round((event.begin_s + s) * follow_course.RATE_HZ) for s in (1.5, 4.5))  # beside him by then
        if last > course.frames:
            continue
        beside = [
            course._other(event, event.share(index / follow_course.RATE_HZ), index, np.zeros(3))
            for index in range(first, last)
        ]
        speeds_m_s = np.linalg.norm(np.diff([t.ned_p_m for t in beside], axis=0), axis=1) * follow_course.RATE_HZ
        turned_rad = [
            abs(math.remainder(b.heading_rad - a.heading_rad, 2 * math.pi)) for a, b in itertools.pairwise(beside)
        ]
        together += len(beside)
        assert speeds_m_s.max() < 5.0 and max(turned_rad) * follow_course.RATE_HZ < 0.6, "walks on, as he would"
    assert together > 90


def test_robot_and_head_tell_the_fusion_where_to_expect_the_target() -> None:
    def tracker() -> HabDfTracker:
        return HabDfTracker({"dsst": make_tracker("dsst", load_config(None), np.random.default_rng(1))}, FusionConfig())

    driven = follow_ground.follow(Course(5, 0.15), tracker(), 5)
    assert driven.score.frames > 10 and driven.estimate_error_m < 0.05
    assert min(driven.score.overlaps) > 0.8
    turned = follow_pan_tilt.follow(follow_pan_tilt.Course("bin", 4, 12), tracker())
    assert turned.frames == 12 and min(turned.overlaps) > 0.8


def test_a_target_counts_as_lost_after_two_seconds() -> None:
    score = Score(EYE, 30.0)
    truth = (140.0, 100.0, 40.0, 60.0)
    for _ in range(30):
        score.note(truth, 0.0, truth)
    for _ in range(59):
        score.note(truth, 0.0, (10.0, 10.0, 40.0, 60.0))
    assert not score.lost and score.followed == 89
    score.note((-50.0, 100.0, 40.0, 60.0), 0.0, None)
    assert score.lost and score.followed == 30
    assert score.success(90) == pytest.approx(30 / 89)

    hidden = Score(EYE, 30.0)
    for _ in range(120):
        hidden.note(truth, 0.9, None)
    assert not hidden.lost, "nobody sees what is hidden"
    for covered, frames, lost in ((0.0, 40, False), (0.9, 60, False), (0.0, 19, False), (0.0, 1, True)):
        for _ in range(frames):
            hidden.note(truth, covered, None)
        assert hidden.lost == lost
    assert hidden.followed == 120, "it is lost from where it was missed first"


def test_an_unknown_platform_is_named() -> None:
    with pytest.raises(ConfigError, match="did you mean 'pan-tilt'"):
        run(Settings(platform="pantilt"))
