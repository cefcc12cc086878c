"""People in the console: what the list says, what an order is, what is drawn."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from common.geometry.config import CameraConfig
from common.messages import (
    BONES,
    JOINTS,
    Command,
    People,
    PeopleDetections,
    Person,
    PersonDetection,
    SearchStatus,
    Track,
)
from ground.console.captions import hint
from ground.console.commands import APPROACH_PERSON, DISMISS, MERGE, RENAME
from ground.console.overlay import GREEN, Painter
from ground.console.people_boxes import carried, scaled
from ground.console.people_cards import (
    called,
    ellipse,
    faces_html,
    is_interrupted,
    listed,
    number_of,
    people_html,
    search_html,
    spread_m,
)
from ground.console.people_tab import NOBODY, OrderRefused, order
from ground.console.pictures import choose_picture
from ground.console.snapshot import DETECTIONS, PEOPLE, SEARCH, STATUS, TRACK, Picture, Snapshot
from ground.console.target import pixels_of
from tests.flying import flying, helm_status

S = 1_000_000_000


def person(number: int, **changes: object) -> Person:
    """Somebody in sight 3 m north and 2 m west of home, but for the changes."""
    someone = Person(
        number=number,
        name=f"person {number}",
        state="seen",
        ned_p_m=(3.0, -2.0, 0.0),
        ned_p_cov_m2=(0.04, 0.0, 0.0, 0.01, 0.0, 0.01),
        first_seen_ns=0,
        last_seen_ns=5 * S,
        pictures=7,
    )
    return msgspec.structs.replace(someone, **changes)


def detection(**changes: object) -> PersonDetection:
    """A person whose joints stand on a diagonal, but for the changes."""
    found = PersonDetection(
        number=1,
        box_px=(20.0, 20.0, 120.0, 120.0),
        joints_px=tuple((24.0 + 8.0 * k, 24.0 + 8.0 * k, 0.9) for k in range(len(JOINTS))),
        presence=0.99,
        fresh=True,
        with_depth=True,
    )
    return msgspec.structs.replace(found, **changes)


def view(*people: Person, age_ms: float = 100.0, **changes: object) -> Snapshot:
    """Somebody spoke of these people 10 s after the vehicle's clock began."""
    ages = {PEOPLE: age_ms, DETECTIONS: 50.0}
    return Snapshot(t_ns=0, ages_ms=ages, people=People(people=people), vehicle_ns=10 * S, **changes)  # type: ignore[arg-type]


def test_the_list_says_who_where_and_since_when() -> None:
    away = person(2, name="Anna", state="away", merged=(4,), ned_p_m=None)
    html = people_html(view(person(1), away, person(3, state="dismissed")))
    for words in ("person 1", "in sight", "3.0 m N, 2.0 m W ± 0.4 m", "<b>Anna</b> <i>person 2</i>", "1 dismissed"):
        assert words in html, words
    assert "out of sight, last seen 5 s ago" in html and "also 4" in html and "place not known" in html
    assert "person 3" not in html
    assert "This list is old" in people_html(view(person(1), age_ms=9000.0))
    assert "No word of people" in people_html(Snapshot(t_ns=0, ages_ms={}))
    evil = person(1, name="<img src=x>")
    assert "<img" not in people_html(view(evil)) and "&lt;img" in people_html(view(evil))
    assert "url(data:image/jpeg;base64,AAA=)" in faces_html({3: b"\0\0"}) and ".face3" in faces_html({3: b"\0\0"})


def test_a_choice_of_the_list_names_its_person_whatever_they_are_called() -> None:
    for someone in (person(7), person(7, name="Anna"), person(7, name="person 3: x")):
        assert number_of(called(someone)) == 7
    assert number_of(NOBODY) is None
    assert [p.number for p in listed((person(3), person(2, state="dismissed"), person(1)))] == [1, 3]


def test_orders_name_whom_they_mean() -> None:
    anna = "person 2: Anna"
    assert order(RENAME, anna, " Berta ", NOBODY) == Command(label="person 2", name="Berta")
    assert order(MERGE, anna, "", "person 1") == Command(label="person 2", into="person 1")
    assert order(DISMISS, anna, "", NOBODY) == order(APPROACH_PERSON, anna, "", NOBODY) == Command(label="person 2")


@pytest.mark.parametrize(
    ("who", "name", "other", "action", "words"),
    [
        (NOBODY, "Anna", NOBODY, RENAME, "Nobody was found"),
        ("person 2", "  ", NOBODY, RENAME, "Write a name of 1 to 40 letters; got 0"),
        ("person 2", "x" * 41, NOBODY, RENAME, "got 41"),
        ("person 2", "", "person 2", MERGE, "whom person 2 is the same as"),
        ("person 2", "", NOBODY, MERGE, "whom person 2 is the same as"),
    ],
)
def test_an_order_that_means_nothing_is_refused(who: str, name: str, other: str, action: object, words: str) -> None:
    with pytest.raises(OrderRefused, match=words):
        order(action, who, name, other)  # type: ignore[arg-type]


def test_the_ellipse_is_the_two_sigma_line_of_the_covariance() -> None:
    c, s = math.cos(0.5), math.sin(0.5)
    turn = np.array([[c, -s], [s, c]])
    covariance = turn @ np.diag([0.09, 0.01]) @ turn.T
    upper = (covariance[0, 0], covariance[0, 1], 0.0, covariance[1, 1], 0.0, 0.5)
    large, small, angle = spread_m(upper)
    assert (large, small) == pytest.approx((0.6, 0.2))
    assert math.remainder(angle - 0.5, math.pi) == pytest.approx(0.0, abs=1e-9)
    points = ellipse(upper, 24)
    assert points.shape == (25, 3) and not points[:, 2].any()
    mahalanobis = np.einsum("ni,ij,nj->n", points[:, :2], np.linalg.inv(covariance), points[:, :2])
    assert mahalanobis == pytest.approx(np.full(25, 4.0))


def test_a_skeleton_is_drawn_where_the_joints_are_and_sure() -> None:
    picture = np.zeros((200, 200, 3), np.uint8)
    Painter().person(picture, detection(), "Anna", GREEN)
    on_line = [picture[64, 64], picture[20, 80]]  # a bone between two joints, and the box
    assert all(pixel.max() > 120 for pixel in on_line)
    assert picture[100, 60].max() == 0, "nothing beside them"
    unsure = tuple((x, y, 0.1) for x, y, _ in detection().joints_px)
    boxed = np.zeros((200, 200, 3), np.uint8)
    Painter().person(boxed, detection(joints_px=unsure), "Anna", GREEN)
    assert boxed[40:120, 40:120].max() == 0 and boxed[20, 80].max() > 120, "the box alone"
    assert len(BONES) == len(JOINTS) - 1


def test_a_detection_fits_a_picture_of_another_size() -> None:
    half = scaled(detection(), 0.5, 0.25)
    assert half.box_px == (10.0, 5.0, 60.0, 30.0)
    assert half.joints_px[2] == (20.0, 10.0, 0.9)


def test_boxes_go_with_the_ground_when_the_vehicle_has_flown_on() -> None:
    camera = CameraConfig().camera()
    place = (1.0, 0.5, 0.0)
    then, now = flying(5.0), flying(5.0, ned_p_m=(0.6, 0.0, -5.0))
    found = PeopleDetections(
        camera="down", width=320, height=240, people=(detection(ned_p_m=place), detection()), with_depth=True
    )
    moved, unplaced = carried(found, camera, then, now)
    half = camera.resized(320, 240)
    x, y = pixels_of([place], half, now)[0] - pixels_of([place], half, then)[0]
    assert y > 20.0 and abs(x) < 1e-6, "what lies ahead comes down the picture"
    assert moved.box_px == pytest.approx((20.0 + x, 20.0 + y, 120.0, 120.0))
    assert moved.joints_px[2] == pytest.approx((40.0 + x, 40.0 + y, 0.9))
    assert unplaced == detection()
    for unknown in ((None, then, now), (camera, None, now), (camera, then, None)):
        assert carried(found, *unknown) == list(found.people)


def test_the_picture_that_people_were_found_in_is_shown_with_them() -> None:
    pictures = [Picture(b"", 640, 480, n, 50 * n * 1_000_000, 50 * n * 1_000_000) for n in range(6)]
    found = PeopleDetections(camera="down", width=640, height=480, people=(detection(),), with_depth=True)
    assert choose_picture(pictures, view(detections=found, detections_capture_ns=3)) is pictures[3]
    elsewhere = msgspec.structs.replace(found, camera="front")
    assert choose_picture(pictures, view(detections=elsewhere, detections_capture_ns=3)) is pictures[5]
    nobody = msgspec.structs.replace(found, people=())
    assert choose_picture(pictures, view(detections=nobody, detections_capture_ns=3)) is pictures[5]


def test_the_name_of_who_lies_at_the_lower_edge_stands_above_them() -> None:
    """The last rows are the captions'."""

    def words(y: float) -> tuple[bool, bool]:
        picture = np.full((200, 200, 3), 90, np.uint8)
        unsure = tuple((x, y, 0.1) for x, y, _ in detection().joints_px)
        Painter().person(picture, detection(box_px=(60.0, y, 80.0, 60.0), joints_px=unsure), "Anna", GREEN)
        changed = (picture != 90).any(axis=(1, 2))
        return bool(changed[: round(y) - 6].any()), bool(changed[round(y) + 66 :].any())

    assert words(40.0) == (False, True)
    assert words(110.0) == (True, False)


def test_no_box_is_asked_for_over_people() -> None:
    found = PeopleDetections(camera="down", width=640, height=480, people=(detection(),), with_depth=True)
    lost = Track(state="lost", x_px=1.0, y_px=1.0, width_px=1.0, height_px=1.0)
    for detections, words in ((found, ""), (None, "Draw a box around the target")):
        ages = {TRACK: 10.0, DETECTIONS: 10.0}
        assert hint(Snapshot(t_ns=0, ages_ms=ages, track=lost, detections=detections)) == words


def test_the_search_says_how_far_it_is_and_whether_it_is_flown() -> None:
    way = ((0.0, 0.0), (0.0, 5.0), (3.0, 5.0), (3.0, 0.0))
    under_way = SearchStatus(state="searching", way_m=way, next_corner=2, skipped=1)

    def at(state: str, search: SearchStatus | None, age_ms: float = 50.0) -> Snapshot:
        status = helm_status(state, source="helm")
        return Snapshot(t_ns=0, ages_ms={SEARCH: age_ms, STATUS: 50.0}, search=search, status=status)

    flown, held = at("search", under_way), at("hold", under_way)
    assert "under way" in search_html(flown) and "line 2 of 2, 1 corners left out" in search_html(flown)
    assert "interrupted" in search_html(held) and is_interrupted(held) and not is_interrupted(flown)
    ended = at("hold", SearchStatus(state="idle", reason="flown to its <end>"))
    assert "flown to its &lt;end&gt;" in search_html(ended) and not is_interrupted(ended)
    old = at("hold", under_way, 9000.0)
    assert "no word" in search_html(old) and not is_interrupted(old) and "no word" in search_html(at("hold", None))
