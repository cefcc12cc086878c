"""The console's picture: where it lies on the canvas, what is drawn on it, which box a drag means."""

from __future__ import annotations

import itertools
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.messages import FollowMembers, MemberBox, Track
from ground.console.captions import hint, target_caption
from ground.console.overlay import (
    BLUE,
    GREEN,
    GREY,
    MEMBER_COLOURS,
    ORANGE,
    Caption,
    Letterbox,
    Painter,
    decode,
    on_canvas,
)
from ground.console.pictures import BoxRefused, Shown, choose_picture, drawn_box
from ground.console.scene import Trail
from ground.console.snapshot import FOLLOWED, MEMBERS, STATUS, TRACK, Picture, Snapshot
from tests.flying import helm_status

MS = 1_000_000


@given(st.integers(16, 4000), st.integers(16, 4000), st.floats(0.3, 4.0), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_canvas_has_the_window_shape_and_maps_back(width: int, height: int, aspect: float, u: float, v: float) -> None:
    box = Letterbox.fit(width, height, aspect)
    assert box.width >= width
    assert box.height >= height
    assert box.width == width or box.height == height
    assert abs(box.width - aspect * box.height) <= 1.0 + aspect
    x, y = box.to_picture((box.left + u * width) / box.width, (box.top + v * height) / box.height)
    assert x == pytest.approx(u * width, abs=1e-6 * width)
    assert y == pytest.approx(v * height, abs=1e-6 * height)


def test_picture_lies_on_the_canvas_where_the_letterbox_says() -> None:
    picture = np.full((48, 64, 3), 200, np.uint8)
    for aspect in (0.8, 4 / 3, 2.0):
        box = Letterbox.fit(64, 48, aspect)
        canvas = on_canvas(picture, box)
        assert canvas.shape == (box.height, box.width, 3)
        inside = canvas[box.top : box.top + 48, box.left : box.left + 64]
        assert (inside == 200).all()
        assert (canvas == 200).all(axis=2).sum() == 64 * 48


def test_picture_is_centred_or_at_the_top_of_a_tall_canvas() -> None:
    assert (Letterbox.fit(640, 480, 1.0).top, Letterbox.fit(640, 480, 2.0).left) == (80, 160)
    phone = Letterbox.fit(640, 480, 0.5)
    assert (phone.top, phone.left, phone.height) == (0, 0, 1280)


def test_drawn_box_becomes_picture_pixels() -> None:
    box = Letterbox.fit(640, 480, 1.0)  # 640 x 640, 80 px above and below
    drawn = drawn_box(Shown(box, 77, "front"), (0.25, 0.5), (0.5, 0.625))
    assert drawn.box_px == pytest.approx((160.0, 240.0, 160.0, 80.0))
    assert (drawn.capture_ns, drawn.camera) == (77, "front")


def test_box_over_the_edge_is_cut() -> None:
    box = Letterbox.fit(640, 480, 1.0)
    drawn = drawn_box(Shown(box, 1), (0.9, 0.0), (1.0, 0.25))
    assert drawn.box_px == pytest.approx((576.0, 0.0, 64.0, 80.0))


@pytest.mark.parametrize(
    ("shown", "first", "second", "words"),
    [
        (None, (0.2, 0.2), (0.4, 0.4), "no live picture"),
        (Shown(Letterbox.fit(640, 480, 1.0), 1), (0.2, 0.0), (0.4, 0.1), "beside the picture"),
        (Shown(Letterbox.fit(640, 480, 1.0), 1), (0.5, 0.5), (0.6, 0.505), "64 x 3 px"),
    ],
)
def test_box_without_a_target_is_refused_with_the_reason(
    shown: Shown | None, first: tuple[float, float], second: tuple[float, float], words: str
) -> None:
    with pytest.raises(BoxRefused, match=words):
        drawn_box(shown, first, second)


def _picture(number: int, received_ms: int) -> Picture:
    return Picture(b"", 640, 480, number, received_ms * MS, received_ms * MS)


def _view(track: Track | None, capture_ns: int, age_ms: float = 30.0) -> Snapshot:
    return Snapshot(t_ns=0, ages_ms={TRACK: age_ms}, track=track, track_capture_ns=capture_ns)


def test_shown_picture_is_the_one_that_the_box_belongs_to() -> None:
    pictures = [_picture(n, 50 * n) for n in range(6)]
    tracking = Track(state="tracking")
    assert choose_picture(pictures, _view(tracking, 4)) is pictures[4]
    assert choose_picture(pictures, _view(tracking, 1)) is pictures[5], "a box that trails by 200 ms is not waited for"
    assert choose_picture(pictures, _view(tracking, 4, age_ms=900.0)) is pictures[5], "nor a track that stopped"
    assert choose_picture(pictures, _view(None, 0)) is pictures[5]
    assert choose_picture([], _view(tracking, 4)) is None


@pytest.mark.parametrize(("state", "colour"), [("tracking", GREEN), ("lost", ORANGE)])
def test_box_is_drawn_along_the_rotated_rectangle(state: str, colour: tuple[int, int, int]) -> None:
    picture = np.zeros((200, 200, 3), np.uint8)
    track = Track(state=state, x_px=100, y_px=90, width_px=80, height_px=40, angle_rad=0.5)  # type: ignore[arg-type]
    Painter().target(picture, track)
    drawn = np.argwhere((picture == colour).all(axis=2))[:, ::-1] - (100.0, 90.0)
    drawn = drawn[np.hypot(*drawn.T) > 8]  # without the mark in the middle
    c, s = np.cos(0.5), np.sin(0.5)
    along = drawn @ np.array([[c, -s], [s, c]])  # in the rectangle's own axes
    off_edge = np.minimum(np.abs(np.abs(along[:, 0]) - 40), np.abs(np.abs(along[:, 1]) - 20))
    assert len(drawn) > 100
    assert off_edge.max() < 2.5


def test_the_followed_target_and_its_trackers_are_drawn() -> None:
    picture = np.zeros((200, 200, 3), np.uint8)
    track = Track(state="tracking", x_px=90, y_px=90, width_px=60, height_px=40)
    members = MemberBox(name="dsst"), MemberBox(name="cmt", box_px=(30.0, 40.0, 100.0, 110.0))
    Painter().followed(picture, track, members, obeyed=True)
    drawn = np.argwhere((picture == BLUE).all(axis=2))[:, ::-1] - (90.0, 90.0)
    drawn = drawn[np.hypot(*drawn.T) > 8]
    assert len(drawn) > 100
    assert np.minimum(np.abs(np.abs(drawn[:, 0]) - 30), np.abs(np.abs(drawn[:, 1]) - 20)).max() < 2.5
    assert np.abs(picture[40, 40:120].astype(int) - MEMBER_COLOURS[1]).max() < 30
    assert not (picture == MEMBER_COLOURS[0]).all(axis=2).any(), "a tracker that sees nothing has no box"


def test_the_followers_target_is_shown_on_its_own_camera_alone() -> None:
    fresh = {MEMBERS: 50.0, FOLLOWED: 50.0}
    view = Snapshot(0, fresh, followed=Track(state="lost"), members=FollowMembers(camera="down"), shown="down")
    assert view.followed_in_picture is view.followed
    assert replace(view, shown="front").followed_in_picture is None
    assert replace(view, followed=Track(state="idle")).followed_in_picture is None
    assert replace(view, ages_ms=fresh | {FOLLOWED: 900.0}).followed_in_picture is None


def _following(state: str, **changes: object) -> Snapshot:
    """A view of a target that only the follower has, in the picture that is shown, and nothing else."""
    ages = {TRACK: 30.0, MEMBERS: 50.0, FOLLOWED: 50.0, STATUS: 100.0}
    view = Snapshot(
        t_ns=0,
        ages_ms=ages,
        track=Track(state="idle"),
        followed=Track(state=state),  # type: ignore[arg-type]
        followed_capture_ns=4,
        followed_age_ms=70.0,
        followed_ago_ms=1200.0,
        members=FollowMembers(camera="down"),
    )
    return replace(view, **changes)  # type: ignore[arg-type]


def test_the_followers_box_is_shown_on_its_own_picture() -> None:
    pictures = [_picture(n, 50 * n) for n in range(6)]
    assert choose_picture(pictures, _following("tracking")) is pictures[4]
    chased = _following("tracking", track=Track(state="tracking"), track_capture_ns=3)
    assert choose_picture(pictures, chased) is pictures[3], "where there are two targets, on the chased one's"
    assert choose_picture(pictures, _following("tracking", shown="front")) is pictures[5]


def test_what_is_followed_has_the_word_where_nothing_is_chased_or_helm_obeys_the_follower() -> None:
    assert target_caption(_following("tracking")) == Caption("TO FOLLOW  70 ms", BLUE), "helm does not obey it yet"
    assert target_caption(_following("lost")) == Caption("LOST  1.2 s", ORANGE)
    assert hint(_following("tracking")) == "", "there is a target"
    assert "what to follow" in hint(_following("lost"))
    chased = _following("tracking", track=Track(state="lost"), tracked_ago_ms=500.0)
    assert target_caption(chased) == Caption("LOST  0.5 s", ORANGE), "the chase's target"
    obeyed = replace(chased, status=helm_status("follow"))
    assert target_caption(obeyed) == Caption("FOLLOWING  70 ms", BLUE)
    assert target_caption(replace(obeyed, shown="front")) == Caption("NO SELECTION", GREY), "elsewhere it is not seen"


def test_names_of_the_trackers_stand_beside_the_box_and_apart_from_each_other() -> None:
    names = ("dsst", "cmt", "struck", "tld")
    members = tuple(MemberBox(name=name, box_px=(200.0, 100.0, 60.0, 40.0)) for name in names)
    for x_px, beside in ((230.0, slice(262, 330)), (600.0, slice(500, 568))):
        picture = np.full((480, 640, 3), 200, np.uint8)
        track = Track(state="tracking", x_px=x_px, y_px=120.0, width_px=60.0, height_px=40.0)
        Painter().followed(picture, track, members, obeyed=True)
        rows = [np.flatnonzero((picture[:, beside] == colour).all(axis=2).any(axis=1)) for colour in MEMBER_COLOURS]
        assert all(len(own) > 4 for own in rows), "each name can be read"
        assert all(own.max() < other.min() for own, other in itertools.pairwise(rows)), "one below the other"


def test_idle_track_draws_nothing() -> None:
    picture = np.zeros((200, 200, 3), np.uint8)
    Painter().target(picture, Track(state="idle", x_px=100, y_px=100, width_px=50, height_px=50))
    assert not picture.any()


def test_stale_picture_has_no_colour_but_that_of_the_warning() -> None:
    rng = np.random.default_rng(3)
    picture = rng.integers(0, 255, (240, 320, 3), dtype=np.uint8)
    Painter().stale(picture, "NO PICTURE 3.2 s", "old")
    spread = picture.astype(int).max(axis=2) - picture.min(axis=2)
    assert (spread[:70] == 0).all()
    assert (spread[170:] == 0).all()
    assert picture[:70].max() < 120
    assert (spread > 60).any(), "the warning is orange"


def test_captions_change_only_the_lower_edge() -> None:
    picture = np.full((480, 640, 3), 90, np.uint8)
    Painter().captions(picture, Caption("LIVE  45 ms", GREEN), Caption("LOST  1.2 s", ORANGE), "Draw a box")
    assert (picture[:440] == 90).all()
    assert (picture[440:] != 90).any()


def test_decoding_gives_rgb_and_survives_rubbish() -> None:
    picture = np.zeros((32, 32, 3), np.uint8)
    picture[:] = (0, 0, 255)  # red in OpenCV's order
    pixels = decode(cv2.imencode(".jpg", picture)[1].tobytes())
    assert pixels is not None
    assert pixels[16, 16, 0] > 200
    assert pixels[16, 16, 2] < 50
    assert decode(b"\xff\xd8 nothing \xff\xd9") is None


@pytest.mark.parametrize(
    ("track", "age_ms", "words"),
    [
        (Track(state="tracking"), 30.0, "TRACKING"),
        (Track(state="lost"), 30.0, "LOST  1.5 s"),
        (Track(state="idle"), 30.0, "NO TARGET"),
        (Track(state="tracking"), 2500.0, "NO TRACK  2.5 s"),
        (None, -1.0, "NO PURSUIT"),
    ],
)
def test_word_about_the_target(track: Track | None, age_ms: float, words: str) -> None:
    view = replace(_view(track, 1, age_ms), tracked_ago_ms=1500.0)
    assert target_caption(view).text.startswith(words)


def test_trail_keeps_its_span_and_its_spacing() -> None:
    trail = Trail(10.0)
    assert trail.segments().shape == (1, 2, 3)
    for step in range(200):
        trail.add(step * 100 * MS, np.array([0.1 * step, 0.0, -5.0]))
    segments = trail.segments()
    assert (segments[1:, 0] == segments[:-1, 1]).all()
    assert segments[0, 0, 0] >= 0.1 * 95
    assert np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1).min() >= 0.05
