"""The hall of the benchmark `follow`: where things are drawn, what the depth sensor reads, when a target is lost."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.base import Settings
from benchmarks.follow import run
from benchmarks.follow_ground import Course, depth_patch
from benchmarks.follow_scene import Hall, Lens, Light, Thing, camera, hidden_share
from benchmarks.follow_score import Score, four_distance, overlap
from benchmarks.follow_solids import bin_, person, pillar
from common.config import ConfigError
from common.geometry.rotation import quat_from_euler

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


def test_the_course_of_the_ground_robot_is_as_long_as_told() -> None:
    course = Course(5, 12.0)
    steps = np.linalg.norm(np.diff(course.places, axis=0), axis=1)
    assert steps.sum() == pytest.approx(12.0, abs=0.1)
    assert len(course._hidden_from) >= 1, "a full occlusion at least"


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


def test_overlap_and_distance_of_boxes() -> None:
    a, b = (0.0, 0.0, 10.0, 10.0), (5.0, 0.0, 10.0, 10.0)
    assert overlap(a, b) == pytest.approx(1 / 3) and overlap(a, (20.0, 0.0, 5.0, 5.0)) == 0.0
    assert four_distance(a, (3.0, 4.0, 10.0, 10.0)) == 5.0


def test_an_unknown_platform_is_named() -> None:
    with pytest.raises(ConfigError, match="did you mean 'pan-tilt'"):
        run(Settings(platform="pantilt"))
