"""The camera's own motion from pictures: shifts, what moves alone, pictures without anything in common; who is told."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from common.processes import load_config
from common.tracking.registry import make_tracker
from onboard.fusion.camera_motion import CameraMotion, expectation, tell

RNG = np.random.default_rng(4)
GROUND = cv2.GaussianBlur(RNG.integers(0, 255, (700, 900), np.uint8), (0, 0), 3.0)
GROUND = cv2.normalize(GROUND, None, 0, 255, cv2.NORM_MINMAX)  # pyright: ignore[reportCallIssue, reportArgumentType]
THING = cv2.GaussianBlur(RNG.integers(0, 255, (60, 60), np.uint8), (0, 0), 2.0)


def _view(x: int, y: int, gain: float = 1.0) -> np.ndarray:
    return np.clip(GROUND[200 - y : 560 - y, 200 - x : 680 - x] * gain, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("gain", [1.0, 0.3])
def test_shifts_add_up_though_the_light_changes(gain: float) -> None:
    camera, places = CameraMotion(), [(0, 0), (31, -24), (-60, 13), (-60, 13)]
    for number, place in enumerate(places):
        seen = camera.see(_view(*place, gain if number % 2 else 1.0), number)
        np.testing.assert_allclose(seen, place, atol=2.0)
    np.testing.assert_allclose(camera.at(1), places[1], atol=2.0)
    np.testing.assert_array_equal(camera.at(100), camera.last)


def test_a_thing_that_moves_alone_is_no_motion_of_the_camera() -> None:
    camera = CameraMotion()
    for number in range(5):
        picture = _view(0, 0)
        picture[150:210, 100 + 15 * number : 160 + 15 * number] = THING
        assert np.abs(camera.see(picture, number)).max() < 1.0


def test_what_a_platform_knows_of_its_motion_is_taken_for_it() -> None:
    motion, dark = CameraMotion(), np.zeros((240, 320), np.uint8)
    for k in range(4):
        place = motion.see(dark, k, None if k == 2 else (3.0, -1.5))
    assert place == pytest.approx([9.0, -4.5]), "one was not known, and a dark picture tells none"
    assert motion.at(1) == pytest.approx([6.0, -3.0])


def test_pictures_with_nothing_in_common_tell_no_motion() -> None:
    camera = CameraMotion()
    camera.see(_view(0, 0), 0)
    other = cv2.GaussianBlur(RNG.integers(0, 255, (360, 480), np.uint8), (0, 0), 3.0)
    np.testing.assert_array_equal(camera.see(other, 1), np.zeros(2))
    np.testing.assert_array_equal(camera.see(np.full((360, 480), 90, np.uint8), 2), np.zeros(2))


@pytest.mark.parametrize("name", ["dsst", "cmt", "struck", "tld"])
def test_a_jolt_beyond_a_trackers_reach_is_followed_once_it_is_told(name: str) -> None:
    """130 px, twice the target's size."""
    assert _overlap_after_jolt(name, told=True) > 0.8
    assert _overlap_after_jolt(name, told=False) < 0.1


def _overlap_after_jolt(name: str, told: bool) -> float:
    box = (200.0, 150.0, 60.0, 60.0)

    def pictures(x: int) -> np.ndarray:
        grey = _view(x, 0)
        grey[150:210, 200 + x : 260 + x] = THING
        return cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)

    camera = CameraMotion()
    tracker = make_tracker(name, load_config(None), np.random.default_rng(0))
    for number, x in enumerate((0, 0, 0, 130)):
        frame = pictures(x)
        before, after = camera.last, camera.see(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY), number)
        if number == 0:
            tracker.init(frame, box, 0.0, 0)
            continue
        if told:
            tell(tracker, expectation(box, after - before))
        answer = tracker.update(frame, number * 50_000_000)
    return answer.overlap((330.0, 150.0, 60.0, 60.0)) if answer.state == "tracking" else 0.0
