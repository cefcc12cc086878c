"""The whole of a thing around the box that rides on a side of it: what moves with it belongs to it."""

from __future__ import annotations

import cv2
import numpy as np

from common.evaluation import jaccard
from common.tracking.base import Box
from onboard.fusion.outline import Outline

RNG = np.random.default_rng(2)
STILL = np.zeros(2)


def _texture(rows: int, columns: int) -> np.ndarray:
    soft = cv2.GaussianBlur(RNG.standard_normal((rows, columns)).astype(np.float32), (0, 0), 2.0)
    return np.clip(128 + 40 * soft / soft.std(), 0, 255).astype(np.uint8)


GROUND, THING = _texture(240, 420), _texture(50, 80)


def _turned(shown: int) -> np.ndarray:
    """The thing with so many columns: 40 are its first side; with more it has turned, and shows another beside it."""
    return THING[:, :shown] if shown <= 40 else cv2.resize(THING, (shown, 50), interpolation=cv2.INTER_AREA)


def _followed(outline: Outline, first: int, last: int, shown: int, step_px: float = 5.0) -> tuple[Box, Box, Box]:
    """Whole, ridden and true box after pictures of a thing that moves right and shows so many columns."""
    for number in range(first, last):
        x = round(20 + step_px * number)
        picture = GROUND.copy()
        picture[90:140, x : x + shown] = _turned(shown)
        ridden, true = (float(x), 90.0, 40.0, 50.0), (float(x), 90.0, float(shown), 50.0)
        whole = outline.whole(picture, number * 50_000_000, STILL, ridden)
    return whole, ridden, true


def test_a_side_that_comes_into_view_and_moves_along_belongs_to_it() -> None:
    outline = Outline()
    whole, ridden, _ = _followed(outline, 0, 15, 40)
    assert whole == ridden, "the box is the whole so far"
    whole, ridden, true = _followed(outline, 15, 40, 64)
    assert jaccard(whole, true) > 0.8 > jaccard(ridden, true) + 0.1
    outline.rest()
    assert outline.around(ridden) == whole, "out of sight it is as large as it was"
    whole, ridden, _ = _followed(outline, 40, 58, 40, 4.0)
    assert jaccard(whole, ridden) > 0.9, "the side has turned away again"


def test_a_box_drawn_within_a_thing_is_the_whole_where_little_reaches_beyond_it_on_any_side() -> None:
    outline = Outline()
    for number in range(40):
        x, shown = 20 + 5 * number, 40 if number < 15 else 64
        picture = GROUND.copy()
        picture[90:140, x : x + shown] = _turned(shown)
        ridden: Box = (x + 5.0, 97.0, 30.0, 36.0)
        whole = outline.whole(picture, number * 50_000_000, STILL, ridden)
    true = (float(x), 90.0, 64.0, 50.0)
    assert jaccard(whole, true) > 0.7 > jaccard(ridden, true) + 0.3


def test_what_moves_along_beside_a_thing_that_looks_as_at_first_is_another_thing() -> None:
    outline = Outline()
    _followed(outline, 0, 15, 40)
    for number in range(15, 40):
        x = 20 + 5 * number
        picture = GROUND.copy()
        picture[90:140, x : x + 64] = THING[:, :64]
        ridden: Box = (float(x), 90.0, 40.0, 50.0)
        assert outline.whole(picture, number * 50_000_000, STILL, ridden) == ridden


def test_of_a_part_that_never_moved_alone_the_motion_tells_nothing() -> None:
    outline = Outline()
    for number in range(40):
        x = 20 + 5 * number
        picture = GROUND.copy()
        picture[90:140, x : x + 80] = THING if number < 15 else THING[:, ::-1]
        ridden: Box = (float(x), 90.0, 40.0, 50.0)
        assert outline.whole(picture, number * 50_000_000, STILL, ridden) == ridden


def test_what_stands_still_tells_nothing() -> None:
    outline = Outline()
    _followed(outline, 0, 15, 40)
    whole, ridden, _ = _followed(outline, 15, 40, 64, 0.0)
    assert whole == ridden


def test_what_covers_a_part_is_no_reason_to_shrink() -> None:
    outline = Outline()
    _followed(outline, 0, 15, 40)
    cover = _texture(240, 30)
    for number in range(15, 30):
        x = 20 + 5 * number
        picture = GROUND.copy()
        picture[90:140, x : x + 40] = THING[:, :40]
        picture[:, 120:150] = cover
        ridden: Box = (float(x), 90.0, 40.0, 50.0)
        assert jaccard(outline.whole(picture, number * 50_000_000, STILL, ridden), ridden) > 0.8


def test_a_moving_camera_is_taken_into_account() -> None:
    outline, wide = Outline(), _texture(240, 900)
    for number in range(40):
        shift, shown = 8 * number, 40 if number < 15 else 64
        picture = np.ascontiguousarray(wide[:, 400 - shift : 820 - shift])  # the camera turns left
        picture[90:140, 180 : 180 + shown] = _turned(shown)
        whole = outline.whole(picture, number * 50_000_000, np.array([shift, 0.0]), (180.0, 90.0, 40.0, 50.0))
    assert jaccard(whole, (180.0, 90.0, 64.0, 50.0)) > 0.8
