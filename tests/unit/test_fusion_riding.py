"""Whether what is in the box of a tracker moves with it over the ground."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from common.tracking.base import Box
from onboard.fusion.riding import Riding, Stretch

STEP_NS = 50_000_000
RNG = np.random.default_rng(1)
GROUND, THING = (
    cv2.GaussianBlur(RNG.integers(0, 255, shape, np.uint8), (0, 0), 2.0) for shape in ((240, 640), (40, 40))
)


def look(riding: Riding, number: int, speed: float, boxes: dict[str, Box], pan: float = 0.0) -> dict[str, Stretch]:
    """One picture: a thing that has moved so many px a picture, and a camera that has panned over the ground."""
    shift = round(pan * number)
    grey = GROUND[:, 100 + shift : 420 + shift].copy()
    left = 100 + round((speed - pan) * number)
    grey[100:140, left : left + 40] = THING
    return riding.look(grey, number * STEP_NS, np.array([-float(shift), 0.0]), boxes)


def followed(speed: float, box_speed: float, pan: float = 0.0) -> dict[str, Stretch]:
    """What is said of a box that moves so many px a picture over the ground, after twelve pictures."""
    riding, said = Riding(), {}
    for number in range(12):
        riding.hear("a", number * STEP_NS, sees=True)
        box: Box = (100.0 + (box_speed - pan) * number, 100.0, 40.0, 40.0)
        said = look(riding, number, speed, {"a": box}, pan)
    return said


@pytest.mark.parametrize("pan", [0.0, 3.0], ids=["still", "panned"])
def test_a_box_on_a_thing_that_moves_rides_and_one_that_slides_over_the_ground_does_not(pan: float) -> None:
    assert followed(4.0, 4.0, pan) == {"a": (0, True)}
    assert followed(0.0, 4.0, pan) == {"a": (0, False)}
    assert followed(4.0, 0.0, pan) == {"a": (0, False)}, "of a box that stands nothing is said"


def test_each_counts_since_it_last_lost_it() -> None:
    riding = Riding()
    for number in range(6):
        riding.hear("a", number * STEP_NS, sees=number != 2)
        boxes: dict[str, Box] = {"a": (100.0 + 4 * number, 100.0, 40.0, 40.0)} if number != 2 else {}
        said = look(riding, number, 4.0, boxes)
    assert said == {"a": (3 * STEP_NS, True)}
    both: dict[str, Box] = {"a": (124.0, 100.0, 40.0, 40.0), "b": (224.0, 100.0, 40.0, 40.0)}
    riding.hear("b", 6 * STEP_NS, sees=True)
    assert look(riding, 6, 4.0, both) == {"a": (3 * STEP_NS, True), "b": (6 * STEP_NS, False)}, (
        "the other one has just begun"
    )
    riding.moved("a")
    assert look(riding, 7, 4.0, {"a": (128.0, 100.0, 40.0, 40.0)}) == {}, "it was put there"
