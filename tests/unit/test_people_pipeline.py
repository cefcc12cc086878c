"""The search for people as a whole: found, named, placed; the budget; and what is said when something is missing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from benchmarks.people_scene import DepthScene, barrel, person, rock
from common.geometry.camera import Camera
from onboard.people.detector import PersonDetector
from onboard.people.findings import Frame
from onboard.people.pipeline import PeoplePipeline
from onboard.people.pipeline_config import DetectorConfig, PeopleConfig, WatchConfig
from onboard.people.regions import Region
from onboard.people.sights import Sight
from onboard.people.watch import Watch
from tests.unit.onnx_file import write_red_detector
from tests.unit.people_rig import DOWN, SECOND, Knower, above, frame

PLACES = {(0.5, -1.2), (-0.8, 1.3), (1.0, 1.2)}
"""North and east, m, of the people."""
SCENE = DepthScene(
    (
        person("lying", -1.2, 0.5, 0.4),
        person("standing", 1.3, -0.8, 1.0),
        person("sitting", 1.2, 1.0, 2.0),
        barrel(-1.0, -1.2),
        rock(0.0, 1.2, 0.3),
    ),
    5.0,
    camera=DOWN,
)


@pytest.fixture(scope="module")
def first() -> Frame:
    """The scene from 5 m above, at 0 s."""
    return frame(SCENE, 0.0, above(5.0))


def at(view: Frame, t_s: float, **changes: Any) -> Frame:
    """The same view at another time."""
    t_ns = round(t_s * SECOND)
    return replace(view, **{"capture_ns": t_ns, "depth_ns": t_ns} | changes)


def pipeline(
    knower: Knower, colour: Camera | None = DOWN, depth: Camera | None = DOWN, **fields: Any
) -> PeoplePipeline:
    """With a network that knows whom it sees, whose time is the clock's."""
    detector = fields.pop("detector", None)
    return PeoplePipeline(PeopleConfig(**fields), colour, depth, knower.network, detector, knower.clock)


def test_people_are_found_placed_and_keep_their_numbers(first: Frame):
    people = pipeline(Knower(), watch=WatchConfig(budget_ms=0.0))
    for step in range(4):
        found = people.look(at(first, 0.1 * step))
        assert found.reason == "" and found.with_depth
        assert [p.number for p in found.people] == [1, 2, 3] and all(p.fresh for p in found.people)

    def nearest(sight: Sight) -> tuple[float, float]:
        assert sight.ned_p_m is not None
        north, east = sight.ned_p_m[:2]
        return min(PLACES, key=lambda place: np.hypot(north - place[0], east - place[1]))

    places = {nearest(p.sight): p.sight for p in found.people}
    assert set(places) == PLACES, "each is somebody else"
    for place, sight in places.items():
        assert sight.ned_p_m is not None and sight.ned_p_cov_m2 is not None and sight.ned_nearest_m is not None
        assert np.hypot(*(sight.ned_p_m[:2] - place)) < 0.35
        assert -1.8 < sight.ned_p_m[2] < 0.05
        assert np.linalg.eigvalsh(sight.ned_p_cov_m2)[0] > 0
        vehicle = above(5.0).ned_p_m
        assert np.linalg.norm(sight.ned_nearest_m - vehicle) < np.linalg.norm(sight.ned_p_m - vehicle)
    assert [(t.number, t.confirmed) for t in people.tracks] == [(1, True), (2, True), (3, True)]


def test_a_turned_and_moved_vehicle_finds_them_at_the_same_places(first: Frame):
    """What the camera shows is the same, so everything moves with the vehicle."""
    people = pipeline(Knower(), watch=WatchConfig(budget_ms=0.0))
    east = replace(above(5.0, 20.0, -3.0), ned_q_body=np.array([0.5**0.5, 0.0, 0.0, 0.5**0.5]))
    found = people.look(at(first, 0.0, vehicle=east)).people
    expected = sorted((20.0 - e, -3.0 + n) for n, e in PLACES)
    got = sorted(tuple(p.sight.ned_p_m[:2]) for p in found if p.sight.ned_p_m is not None)
    np.testing.assert_allclose(got, expected, atol=0.35)


def test_what_the_edge_of_an_aligned_sensors_picture_cuts_off_does_not_move_a_place():
    people = pipeline(Knower(), watch=WatchConfig(budget_ms=0.0))

    def seen_from(west_m: float, t_s: float) -> Sight:
        """Somebody who lies 0.5 m north of home, from so far west of them."""
        scene = DepthScene((person("lying", west_m, 0.5, 0.4),), 5.0, camera=DOWN)
        (found,) = people.look(at(frame(scene, t_s, above(5.0, 0.0, -west_m)), t_s)).people
        assert found.number == 1
        return found.sight

    sights = [seen_from(0.0, 0.1 * step) for step in range(4)]
    (known,) = people.tracks
    half_m = 5.0 * DOWN.width / (2.0 * DOWN.fx_px)
    cut = seen_from(half_m - 0.1, 0.4)
    (after,) = people.tracks
    assert known.ned_p_m is not None and after.ned_p_m is not None and cut.ned_p_m is not None
    assert cut.ned_p_m[1] < known.ned_p_m[1] - 0.15, "half of them lies beyond the edge"
    np.testing.assert_allclose(after.ned_p_m, known.ned_p_m)
    whole_m2, cut_m2 = sights[-1].ned_p_cov_m2, cut.ned_p_cov_m2
    assert whole_m2 is not None and cut_m2 is not None and cut_m2[1, 1] > 2.0 * whole_m2[1, 1], "and it says so"


def test_the_budget_holds_and_nobody_is_forgotten(first: Frame):
    knower = Knower()
    people = pipeline(knower, watch=WatchConfig(budget_ms=55.0))
    shown: list[int] = []
    for step in range(40):
        before = knower.seconds
        found = people.look(at(first, 0.1 * step))
        assert found.looks >= (1 if step < 5 else 0), "something new is looked at at once"
        assert knower.seconds - before <= 0.081, "one look that takes longer than the budget, and no second one"
        shown.append(len(found.people))
    assert shown[6:] == [3] * 34, "between its looks a region goes on being who it was"
    assert all(track.confirmed for track in people.tracks)
    looks = {spot.number: spot.looks for spot in people.watch.spots}
    assert min(looks[n] for n in (1, 2, 3)) >= 6, "each in its turn"
    assert looks[0] <= 6, "a barrel is looked at ever more rarely"


def test_what_is_new_comes_first(first: Frame):
    watch = Watch(WatchConfig())

    def sight(north_m: float) -> Sight:
        region = Region((10, 10, 30, 60), np.ones((60, 30), bool), (0.0, 0.0, 5.0), 1.7, 0.5, 0.3)
        return Sight(region, np.array([north_m, 0.0, 0.0]))

    (known,) = watch.follow([sight(0.0)], 0)
    known.refused("no", 0)
    spots = watch.follow([sight(0.1), sight(5.0)], SECOND)
    assert spots[0] is known and list(watch.due(spots, SECOND)) == [spots[1], known]
    spots[1].refused("no", SECOND)
    assert list(watch.due(spots, SECOND + SECOND // 10)) == [known], "no person, unchanged: not at once again"
    assert watch.follow([sight(0.1)], 3 * SECOND)[0] is not known, "forgotten"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"depth": None}, "no depth with the picture"),
        ({"depth_ns": SECOND - 80_000_000}, "picture and depth are 80 ms apart, expected 20 ms or less"),
        ({"depth": np.zeros((424, 512), np.uint16)}, "every depth is zero or NaN"),
        ({"depth": np.full((424, 512), np.nan, np.float32)}, "every depth is zero or NaN"),
        ({"depth": np.full((424, 512), 5000.0, np.float32)}, "median of 5000 m, .* floats are metres, divide"),
        ({"depth": np.full((424, 512), 5, np.uint16)}, "0 of 3392 sampled depths lie in 0.4 to 14.0 m"),
        ({"depth": np.zeros((100, 100), np.uint16)}, r"got shape \(100, 100\), expected \(424, 512\)"),
        ({"depth": np.zeros((424, 512), np.int32)}, r"got int32, expected uint16 \(mm\) or float32"),
        (
            {"depth": np.tile(np.linspace(0.6, 9.0, 512, dtype=np.float32), (424, 1))},
            "no plane within 15 degrees of level",
        ),
    ],
)
def test_depth_that_cannot_be_used_is_refused_with_the_reason(first: Frame, changes: dict, words: str):
    found = pipeline(Knower()).look(at(first, 1.0, **changes))
    assert (found.people, found.with_depth) == ((), False)
    with pytest.raises(AssertionError, match=words + r".*without a detector \(people.detector\) nobody can be found"):
        raise AssertionError(found.reason)


@pytest.mark.parametrize(
    ("cameras", "words"),
    [
        ({"colour": None}, "no intrinsics of the colour camera"),
        ({"depth": None}, "no depth camera, or no intrinsics of it"),
        ({"use_depth": False}, "switched off"),
    ],
)
def test_missing_intrinsics_are_named(first: Frame, cameras: dict, words: str):
    found = pipeline(Knower(), **cameras).look(first)
    assert not found.people and words in found.reason


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"colour": np.zeros((424, 512), np.uint8)}, "expected uint8 of"),
        ({"colour": np.zeros((424, 512, 3), np.float32)}, "got float32"),
        ({"colour": np.zeros((480, 640, 3), np.uint8)}, "got 640x480 px, expected 512x424 of its calibration"),
    ],
)
def test_a_picture_that_cannot_be_used_is_refused(first: Frame, changes: dict, words: str):
    found = pipeline(Knower()).look(replace(first, **changes))
    assert not found.people and words in found.reason


def test_a_picture_that_is_not_newer_is_refused(first: Frame):
    people = pipeline(Knower())
    assert people.look(first).reason == ""
    assert "is not after the last one's" in people.look(first).reason


def test_without_a_vehicle_pose_places_are_the_cameras(first: Frame):
    found = pipeline(Knower(), watch=WatchConfig(budget_ms=0.0)).look(replace(first, vehicle=None))
    assert len(found.people) == 3 and "no pose of the vehicle" in found.reason
    assert all(p.sight.ned_p_m is None and p.sight.region.camera_p_m is not None for p in found.people)


def test_without_depth_the_detector_says_where_and_it_is_flagged(first: Frame, tmp_path: Path):
    path = tmp_path / "red.onnx"
    write_red_detector(path, 128, 16, (16.0, 30.0))
    detector = PersonDetector(DetectorConfig(file=str(path), decoder="yolo", size_px=128))
    colour = np.full((424, 512, 3), 70, np.uint8)
    colour[192:320, 256:320] = (40, 40, 200)  # one cell of the detector, as wide and high as a box below it
    people = pipeline(Knower(), detector=detector)
    for step in range(10):
        found = people.look(at(first, 0.1 * step, colour=colour, depth=None))
        assert found.reason == "no depth with the picture" and not found.with_depth
    assert found.people and all(p.sight.ned_p_m is None for p in found.people)
    assert people.tracks[0].confirmed


def test_a_merged_person_is_one_from_then_on(first: Frame):
    people = pipeline(Knower(), watch=WatchConfig(budget_ms=0.0))
    people.look(first)
    people.merge(3, 1)
    assert [t.number for t in people.tracks] == [1, 2]
    numbers = [p.number for p in people.look(at(first, 0.1)).people]
    assert 3 not in numbers and {1, 2} <= set(numbers)
    with pytest.raises(KeyError):
        people.merge(3, 1)


def test_who_was_dismissed_is_not_found_again_as_somebody_new(first: Frame):
    people = pipeline(Knower(), watch=WatchConfig(budget_ms=0.0))
    people.look(first)
    people.tracker.dismiss(2)
    assert [p.number for p in people.look(at(first, 0.1)).people] == [1, 3]
    assert len(people.tracks) == 3


def test_the_same_pictures_give_the_same_findings(first: Frame):
    runs = []
    for _ in range(2):
        people = pipeline(Knower())
        runs.append(
            [
                (p.number, p.fresh, p.sight.region.box_px)
                for k in range(6)
                for p in people.look(at(first, 0.1 * k)).people
            ]
        )
    assert runs[0] == runs[1]


def test_settings_refuse_a_camera_that_is_not_there():
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert({"watch": {"budget_ms": -1.0}}, PeopleConfig)
    with pytest.raises(ValueError, match="camera: got 'tail', expected one of down, front"):
        PeopleConfig(camera="tail").check()
