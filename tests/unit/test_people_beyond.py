"""What of somebody lies beyond the depth picture is found by the colours, and only where these tell."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from benchmarks.people_scene import KINECT_2
from onboard.people.beyond import one_beyond, whole
from onboard.people.findings import Found
from onboard.people.pose import Pose
from onboard.people.regions import Box, Region, Registration
from onboard.people.sights import Sight

DEPTH_M = 5.0
COLOUR = replace(KINECT_2, width=760, cx_px=KINECT_2.cx_px + 124.0)
"""Sees 124 px more on either side."""
REGISTRATION = Registration.of(KINECT_2, COLOUR)
END_PX = 124 + KINECT_2.width
TRUNK: Box = (590, 180, 90, 40)
LEGS: Box = (520, 188, 70, 24)
FLOOR, SHIRT, TROUSERS = (90, 120, 110), (40, 40, 190), (150, 60, 30)


def picture(floor: tuple[int, int, int] = FLOOR, *more: tuple[Box, tuple[int, int, int]]) -> np.ndarray:
    """Somebody who lies across the depth picture's right end, on a floor with grain; and other boxes."""
    rng = np.random.default_rng(3)
    drawn = np.full((COLOUR.height, COLOUR.width, 3), floor, float)
    for (x, y, width, height), colour in (*more, (LEGS, TROUSERS), (TRUNK, SHIRT)):
        drawn[y : y + height, x : x + width] = colour
    return np.clip(drawn + rng.normal(0.0, 8.0, drawn.shape), 0, 255).astype(np.uint8)


def seen(cut: bool = True, end_px: int = END_PX) -> Region:
    """The region that the depth picture shows of them."""
    mask = np.zeros((COLOUR.height, end_px), np.uint8)
    for x, y, width, height in (LEGS, TRUNK):
        mask[y : y + height, x : x + width] = 1
    x, y, width, height = cv2.boundingRect(mask)
    box = (int(x), int(y), int(width), int(height))
    return Region(box, mask[y : y + height, x : x + width] > 0, (0.0, 0.0, DEPTH_M), 1.0, 0.4, 0.3, None, cut, True)


@pytest.mark.parametrize("cut", [True, False])
def test_the_limbs_that_are_known_count_where_the_depth_picture_ends(cut: bool):
    region = replace(seen(cut), height_m=1.7)
    joints = np.tile((600.0, 200.0), (15, 1))
    joints[4] = (700.0, 190.0)
    found = Found(1, Sight(region), Pose(joints, np.full(15, 0.9), 1.0), False, (COLOUR.width, COLOUR.height))
    right = found.box_px[0] + found.box_px[2]
    assert right == (700 if cut else region.box_px[0] + region.box_px[2]), "who is seen whole has moved their arms"


def test_what_hangs_on_a_region_beyond_the_depth_picture_is_part_of_it():
    half = seen()
    full = whole(picture(), half, REGISTRATION)
    assert half.box_px[2] < 120
    np.testing.assert_allclose(full.box_px, (520, 180, 160, 40), atol=4)
    assert full.mask.shape == (full.box_px[3], full.box_px[2])
    x, y = full.box_px[:2]
    assert full.mask[200 - y, 660 - x] and not full.mask[184 - y, 530 - x]
    assert replace(full, box_px=half.box_px, mask=half.mask) == half, "metres are of what the depth shows"


@pytest.mark.parametrize("shirt", [(60, 180, 220), (215, 215, 210)])
def test_a_colour_that_the_depth_picture_did_not_show_is_theirs_if_it_is_not_the_floors(shirt: tuple[int, int, int]):
    sleeve = ((660, 150, 14, 60), shirt)
    box = whole(picture(FLOOR, sleeve), seen(), REGISTRATION).box_px
    np.testing.assert_allclose(box, (520, 150, 160, 70), atol=5)


def test_regions_stay_where_colours_do_not_tell():
    region = seen(cut=False)
    assert whole(picture(), region, REGISTRATION) is region, "nothing is missing"
    region = seen()
    assert whole(picture(SHIRT), region, REGISTRATION).box_px == region.box_px, "a floor as red as the shirt"
    assert whole(picture(FLOOR, ((640, 20, 120, 380), SHIRT)), region, REGISTRATION) is region, "a carpet is no body"
    far = ((720, 300, 20, 60), SHIRT)
    np.testing.assert_allclose(whole(picture(FLOOR, far), region, REGISTRATION).box_px, (520, 180, 160, 40), atol=4)
    without = replace(region, camera_p_m=None)
    assert whole(picture(), without, REGISTRATION) is without


def test_two_regions_that_are_one_beyond_are_one():
    full = whole(picture(), seen(), REGISTRATION)
    arm = replace(full, box_px=(600, 185, 80, 30), mask=np.ones((30, 80), bool))
    assert one_beyond(full, arm) and one_beyond(arm, full)
    assert not one_beyond(full, replace(arm, cut=False))
    assert not one_beyond(full, replace(arm, box_px=(600, 260, 80, 30)))
    assert not one_beyond(full, replace(arm, box_px=(640, 205, 80, 30))), "people side by side touch"
