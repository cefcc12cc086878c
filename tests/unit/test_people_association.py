"""Looks, costs and tracks: turning the camera changes nothing, the order changes nothing, nobody is forgotten."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest

from onboard.people.appearance import Look, look_of, similarity
from onboard.people.association import assign, match_cost, pose_dissimilarity
from onboard.people.config import AssociationConfig
from onboard.people.identity import Detection
from onboard.people.pose import Pose
from onboard.people.tracks import PeopleTracker
from tests.unit.people_bodies import STANDING, moved, pose, region_of

CONFIG = AssociationConfig()
SECOND = 1_000_000_000
CLOTHES = {
    "red over blue": ((60, 90, 160), (40, 40, 200), (160, 60, 30)),
    "blue over red": ((60, 90, 160), (160, 60, 30), (40, 40, 200)),
    "green over black": ((60, 90, 160), (60, 150, 40), (20, 20, 20)),
    "white over grey": ((60, 90, 160), (230, 230, 230), (110, 110, 110)),
}


def _painted(name: str, angle_rad: float = 0.0, scale: float = 1.0, ground: int = 90) -> tuple[np.ndarray, Pose]:
    """A picture of a person in some clothes, noise on everything, and the pose."""
    joints = moved(STANDING, angle_rad, scale, (200.0, 200.0))
    joints += 200.0 - joints.mean(axis=0)
    picture = np.full((400, 400, 3), ground, np.uint8)
    head, trunk, legs = CLOTHES[name]
    places = np.round(joints).astype(np.int32)
    hull = cv2.convexHull(places[[2, 5, 11, 8]])
    cv2.fillConvexPoly(picture, hull, trunk)
    cv2.polylines(picture, [hull], True, trunk, round(10 * scale))
    for chain in ((8, 9, 10), (11, 12, 13)):
        cv2.polylines(picture, [places[list(chain)].reshape(-1, 1, 2)], False, legs, round(13 * scale))
    cv2.circle(picture, tuple(map(int, places[0])), round(10 * scale), head, -1)
    noise = np.random.default_rng(3).normal(size=picture.shape) * 6.0
    return np.clip(picture + noise, 0, 255).astype(np.uint8), pose(joints)


def _look(name: str, angle_rad: float = 0.0, scale: float = 1.0, ground: int = 90) -> tuple[Look, Pose]:
    picture, body = _painted(name, angle_rad, scale, ground)
    return look_of(picture, region_of(body.joints_px), body), body


def _detection(name: str, angle_rad: float = 0.0, scale: float = 1.0, **place: Any) -> Detection:
    look, body = _look(name, angle_rad, scale)
    return Detection(body, look, **place)


@pytest.mark.parametrize(("angle_deg", "scale"), [(90, 1.0), (-135, 1.0), (30, 0.6), (180, 1.4)])
def test_turning_the_camera_and_flying_higher_change_no_look(angle_deg: float, scale: float):
    plain, body = _look("red over blue")
    turned, turned_body = _look("red over blue", math.radians(angle_deg), scale)
    assert similarity(plain, turned) > 0.93
    assert pose_dissimilarity(body, turned_body) < 1e-9
    assert match_cost([plain], body, turned, turned_body, 0.0, CONFIG) < CONFIG.gate


def test_the_ground_is_no_part_of_a_look():
    assert similarity(_look("red over blue", ground=40)[0], _look("red over blue", ground=200)[0]) > 0.9


def test_clothes_tell_people_apart_part_by_part():
    looks = {name: _look(name)[0] for name in CLOTHES}
    for one in CLOTHES:
        for other in CLOTHES:
            value = similarity(looks[one], looks[other])
            assert value > 0.999 if one == other else value < 0.7, (one, other)
            assert value == pytest.approx(similarity(looks[other], looks[one]))


def test_looks_that_share_no_part_are_not_alike():
    look, _ = _look("red over blue")
    legs = Look(look.histograms * np.array([[0.0], [0.0], [1.0]]))
    head = Look(look.histograms * np.array([[1.0], [0.0], [0.0]]))
    assert similarity(legs, head) == 0.0
    assert similarity(look, legs) == pytest.approx(1.0)


def test_the_pose_distance_is_the_mean_in_body_lengths():
    joints = STANDING.copy()
    joints[[3, 6]] += [12.0, 0.0]  # both elbows, a tenth of the body
    weights = np.array([1.0, 1.0, 0.7, 0.4, 1.0, 0.7, 0.4, 1.0, 0.8, 0.6, 1.0, 0.8, 0.6, 1.0])
    assert pose_dissimilarity(pose(), pose(joints)) == pytest.approx(0.1 * 1.4 / weights.sum())
    hidden = replace(pose(joints), confidence=np.where(np.isin(np.arange(15), (3, 6)), 0.1, 0.9))
    assert pose_dissimilarity(pose(), hidden) == 0.0
    assert pose_dissimilarity(pose(), pose(confidence=0.1)) == 1.0


def test_the_cost_grows_with_both_and_forgets_the_pose():
    (look, body), (other, _) = _look("red over blue"), _look("green over black")
    bent = STANDING.copy()
    bent[[9, 10, 12, 13]] += [50.0, -20.0]
    cost = match_cost([look], body, other, body, 0.0, CONFIG)
    assert match_cost([look], body, other, pose(bent), 0.0, CONFIG) > cost > 0.3
    assert match_cost([look], body, other, pose(bent), 60.0, CONFIG) == pytest.approx(cost)
    assert match_cost([other, look], body, look, body, 0.0, CONFIG) == pytest.approx(0.0, abs=1e-9)


def test_the_gate_keeps_bad_pairs_from_pushing_good_ones_out():
    assert assign(np.array([[0.05, 0.5], [0.5, 0.9]]), 0.1) == [(0, 0)]
    assert assign(np.array([[np.inf, 0.05], [0.04, np.inf]]), 0.1) == [(0, 1), (1, 0)]
    assert assign(np.zeros((0, 3)), 0.1) == [] and assign(np.zeros((2, 0)), 0.1) == []


@pytest.mark.parametrize("gap_s", [1.0, 10.0, 60.0, 1800.0])
def test_people_keep_their_numbers_over_gaps_from_any_side(gap_s: float):
    tracker = PeopleTracker(CONFIG)
    for k in range(3):
        assert tracker.update([_detection(n) for n in CLOTHES], k * SECOND) == [1, 2, 3, 4]
    assert tracker.update([], 4 * SECOND) == []
    back = [_detection(name, 2.0, 0.8) for name in reversed(CLOTHES)]
    assert tracker.update(back, round((2 + gap_s) * SECOND) + 2 * SECOND) == [4, 3, 2, 1]


def test_the_order_of_the_detections_does_not_matter():
    names = list(CLOTHES)
    for order in ((0, 1, 2, 3), (3, 1, 0, 2), (2, 3, 1, 0)):
        tracker = PeopleTracker(CONFIG)
        tracker.update([_detection(n) for n in names], 0)
        assert tracker.update([_detection(names[k]) for k in order], SECOND) == [k + 1 for k in order]


def test_believed_after_three_pictures_and_a_false_alarm_is_forgotten():
    tracker = PeopleTracker(CONFIG)
    for k in range(3):
        tracker.update([_detection("red over blue")] + [_detection("white over grey")] * (k == 0), k * SECOND)
    assert [(t.number, t.confirmed, t.hits) for t in tracker.tracks] == [(1, True, 3), (2, False, 1)]
    tracker.update([], 5 * SECOND)
    assert [t.number for t in tracker.tracks] == [1]
    assert tracker.update([_detection("white over grey")], 6 * SECOND) == [3]


def test_nobody_is_in_two_places():
    """The same clothes twice in one picture are two people; far away after a second is somebody else."""
    tracker = PeopleTracker(CONFIG)
    assert tracker.update([_detection("red over blue"), _detection("red over blue")], 0) == [1, 2]
    placed = PeopleTracker(CONFIG)
    covariance = np.eye(3) * 0.01
    here, there = np.zeros(3), np.array([30.0, 0.0, 0.0])
    assert placed.update([_detection("red over blue", ned_p_m=here, ned_p_cov_m2=covariance)], 0) == [1]
    assert placed.update([_detection("red over blue", ned_p_m=there, ned_p_cov_m2=covariance)], SECOND) == [2]


def test_the_position_settles_and_stays_when_out_of_sight():
    tracker, rng = PeopleTracker(replace_walk(0.05)), np.random.default_rng(0)
    truth, covariance = np.array([4.0, -3.0, 0.0]), np.diag([0.09, 0.09, 0.04])
    for k in range(20):
        seen = truth + rng.normal(size=3) * [0.3, 0.3, 0.2]
        tracker.update([_detection("red over blue", ned_p_m=seen, ned_p_cov_m2=covariance)], k * SECOND // 10)
    tracker.update([], 60 * SECOND)
    (track,) = tracker.tracks
    assert track.ned_p_m is not None and track.ned_p_cov_m2 is not None
    assert np.linalg.norm(track.ned_p_m - truth) < 0.3
    assert (np.linalg.eigvalsh(track.ned_p_cov_m2) > 0).all() and np.trace(track.ned_p_cov_m2) < 0.1
    with pytest.raises(ValueError, match="pictures in their order"):
        tracker.update([], 0)


def replace_walk(walk_m_s: float) -> AssociationConfig:
    """Settings with people who hardly walk."""
    return AssociationConfig(walk_m_s=walk_m_s)


def test_place_and_unbroken_sight_count_for_who_it_is():
    """A look that costs too much by itself, of somebody who is where the person was, or in the same region."""
    place = {"ned_p_m": np.array([3.0, 1.0, 0.0]), "ned_p_cov_m2": 0.04 * np.eye(3)}
    away = {"ned_p_m": np.array([4.0, 2.0, 0.0]), "ned_p_cov_m2": 0.04 * np.eye(3)}
    first = _detection("red over blue", **place)
    other = _detection("red over blue", math.radians(20), 0.5, **place)
    cost = match_cost([first.look], first.pose, other.look, other.pose, 60.0, CONFIG)
    assert cost > 0.0
    tight = msgspec.structs.replace(CONFIG, gate=0.75 * cost, slack_m=5.0)

    def number(second: Detection) -> int:
        tracker = PeopleTracker(tight)
        tracker.update([first], 0)
        tracker.update([first], 30 * SECOND)
        tracker.tracks = [replace(track, confirmed=True) for track in tracker.tracks]
        (given,) = tracker.update([second], 60 * SECOND)
        return given

    assert number(replace(other, **away)) == 2, "by its look alone it is somebody else"
    assert number(other) == 1, "at the place it is the same person"
    assert number(replace(other, **away, known=1)) == 1, "in the region it is the same person"


@pytest.mark.parametrize("together", [False, True])
def test_who_turns_out_to_be_in_the_same_place_is_one_person_unless_both_were_in_one_picture(together: bool):
    covariance = 0.04 * np.eye(3)
    first = _detection("red over blue", ned_p_m=np.array([3.0, 1.0, 0.0]), ned_p_cov_m2=covariance)
    there = np.array([3.9, 1.0, 0.0])
    other = _detection("red over blue", math.radians(20), 0.5, ned_p_m=there, ned_p_cov_m2=covariance)
    cost = match_cost([first.look], first.pose, other.look, other.pose, 60.0, CONFIG)
    tracker = PeopleTracker(msgspec.structs.replace(CONFIG, gate=0.75 * cost, confirm_hits=1))
    assert tracker.update([first], 0) == [1]
    assert tracker.update([other, first] if together else [other], 2 * SECOND) == ([2, 1] if together else [2])
    assert tracker.doubles() == [], "too far apart"
    for step in range(20):
        nearer = replace(other, ned_p_m=np.array([3.1, 1.0, 0.0]), known=2)
        assert tracker.update([nearer], 3 * SECOND + step * SECOND // 10) == [2]
    assert tracker.doubles() == ([] if together else [(2, 1)])
    tracker.merge(2, 1)
    assert [(t.number, t.merged) for t in tracker.tracks] == [(1, (2,))]


@pytest.mark.parametrize("change", ["none", "lies", "far", "clothes", "together"])
def test_who_stood_elsewhere_and_can_have_walked_is_one_with_whoever_looks_the_same(change: str):
    """Seen again they are legs, and somebody new; the rest of them is seen with that number."""
    there, later = np.array([3.0, 1.0, -1.0]), np.array([9.0 if change == "far" else 5.5, 1.0, -1.0])
    first = _detection("red over blue", ned_p_m=there, ned_p_cov_m2=0.01 * np.eye(3), stands=True)
    legs = _detection("green over black", ned_p_m=later, ned_p_cov_m2=0.01 * np.eye(3), stands=change != "lies")
    tracker = PeopleTracker(msgspec.structs.replace(CONFIG, confirm_hits=1))
    assert tracker.update([first], 0) == [1]
    assert tracker.update([legs, first] if change == "together" else [legs], SECOND)[0] == 2
    look = legs.look if change == "clothes" else first.look
    tracker.tracks[-1] = replace(tracker.tracks[-1], looks=(legs.look, look))
    # On the way out of the picture the edge cuts them: who stood once may walk.
    assert tracker.update([replace(legs, known=2, fresh=False, stands=False)], SECOND + 1) == [2]
    assert tracker.doubles() == ([(2, 1)] if change == "none" else [])


@pytest.mark.parametrize("together", [False, True])
def test_who_was_new_a_moment_ago_and_is_known_in_the_same_sight_was_not_new(together: bool):
    there, later = np.array([3.0, 1.0, -1.0]), np.array([4.5, 1.0, -1.0])
    first = _detection("red over blue", ned_p_m=there, ned_p_cov_m2=0.01 * np.eye(3))
    legs = _detection("green over black", ned_p_m=later, ned_p_cov_m2=0.01 * np.eye(3))
    tracker = PeopleTracker(CONFIG)
    assert [tracker.update([first], k * SECOND) for k in range(2)] == [[1], [1]]
    assert tracker.update([legs, first] if together else [legs], 9 * SECOND)[0] == 2 and tracker.doubles() == []
    whole = replace(first, ned_p_m=later, known=2)
    assert tracker.update([whole], 9 * SECOND + SECOND // 10) == [1], "by the look"
    assert tracker.doubles() == ([] if together else [(2, 1)]), "also while nobody believes in the second"


def test_two_in_one_picture_where_only_one_has_room_are_one_if_they_look_the_same():
    def doubles(colours: str, north_m: float) -> list[tuple[int, int]]:
        here = _detection("red over blue", ned_p_m=np.array([3.0, 1.0, 0.0]), ned_p_cov_m2=0.04 * np.eye(3))
        part = _detection(colours, ned_p_m=np.array([north_m, 1.0, 0.0]), ned_p_cov_m2=0.04 * np.eye(3))
        tracker = PeopleTracker(msgspec.structs.replace(CONFIG, confirm_hits=1))
        assert tracker.update([here, part], 0) == [1, 2]
        return tracker.doubles()

    assert doubles("red over blue", 3.3) == [(2, 1)]
    assert doubles("red over blue", 3.6) == [], "beside each other"
    assert doubles("green over black", 3.3) == [], "across each other"


def test_who_has_no_pose_of_their_own_goes_on_as_the_region_says():
    first, second = _detection("red over blue"), _detection("green over black")
    tracker = PeopleTracker(CONFIG)
    assert tracker.update([first, second], 0) == [1, 2]
    carried = replace(first, known=2, fresh=False)
    assert tracker.update([carried, replace(second, known=7, fresh=False)], SECOND) == [2, 0]
    hits = {track.number: (track.hits, track.seen_ns) for track in tracker.tracks}
    assert hits == {1: (1, 0), 2: (1, SECOND)}, "it counts as seen, not as another look"


def test_what_the_pictures_edge_cuts_off_does_not_move_a_known_place():
    place = np.array([3.0, 1.0, 0.0])
    first = _detection("red over blue", ned_p_m=place, ned_p_cov_m2=0.04 * np.eye(3))
    tracker = PeopleTracker(CONFIG)

    def north(detection: Detection, t_s: float) -> float:
        assert tracker.update([detection], round(t_s * SECOND)) == [1]
        known = tracker.tracks[0].ned_p_m
        assert known is not None
        return float(known[0])

    assert north(replace(first, whole=False), 0.0) == 3.0, "better than none"
    beside = replace(first, ned_p_m=np.array([3.6, 1.0, 0.0]), whole=False)
    assert all(north(beside, 0.1 * step) == 3.0 for step in range(1, 12))
    assert north(replace(beside, whole=True), 2.0) > 3.4
    walked = replace(first, ned_p_m=np.array([5.0, 1.0, 0.0]), whole=False)
    assert north(walked, 4.0) > 4.5, "farther than an edge explains"
