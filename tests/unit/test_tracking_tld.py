"""TLD's parts: median flow, the compiled scan against its definition, the detector's learning, and what is learned."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from benchmarks.painted_scene import Pose, car_picture, ground_picture, paint
from common.evaluation import jaccard
from common.tracking.base import Box
from common.tracking.median_flow import median_flow
from common.tracking.tld import TldTracker, _clustered, _Found
from common.tracking.tld_compiled import overlaps, scan
from common.tracking.tld_config import TldConfig
from common.tracking.tld_detector import Detector

BOX: Box = (100.0, 80.0, 60.0, 40.0)


def _texture(seed: int) -> np.ndarray:
    noise = np.random.default_rng(seed).integers(0, 255, (240, 320), np.uint8)
    return cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 2.0), None, 0, 255, cv2.NORM_MINMAX)  # pyright: ignore[reportCallIssue, reportArgumentType]


def _warped(grey: np.ndarray, growth: float, offset: tuple[float, float]) -> np.ndarray:
    """The picture grown about the box's centre, then moved."""
    middle = np.array([BOX[0] + BOX[2] / 2, BOX[1] + BOX[3] / 2])
    shift = middle * (1.0 - growth) + offset
    matrix = np.array([[growth, 0.0, shift[0]], [0.0, growth, shift[1]]])
    return cv2.warpAffine(grey, matrix, grey.shape[::-1], borderMode=cv2.BORDER_REFLECT)


def test_median_flow_is_the_motion_and_the_growth_though_a_third_is_covered() -> None:
    before = _texture(1)
    after = _warped(before, 1.05, (6.0, -4.0))
    moved = median_flow(before, after, BOX)
    assert moved is not None
    np.testing.assert_allclose(moved.offset_px, (6.0, -4.0), atol=0.1)
    assert moved.grown == pytest.approx(1.05, abs=0.005)
    assert moved.error_px < 0.1
    assert moved.likeness > 0.95
    after[:, :126] = _texture(2)[:, :126]
    covered = median_flow(before, after, BOX)
    assert covered is not None
    np.testing.assert_allclose(covered.offset_px, (6.0, -4.0), atol=0.5)


def test_median_flow_says_nothing_of_a_plain_picture_and_little_of_another_one() -> None:
    plain = np.full((240, 320), 90, np.uint8)
    assert median_flow(plain, plain, (400.0, 300.0, 40.0, 40.0)) is None
    other = median_flow(_texture(1), _texture(5), BOX)
    assert other is None or other.error_px > 3.0 or other.likeness < 0.6


def test_scan_gives_the_codes_and_posteriors_of_its_definition() -> None:
    rng = np.random.default_rng(3)
    grey = rng.integers(0, 255, (40, 50), np.uint8)
    grey[:20, :20] = 100  # plain
    windows = np.array([[2, 3, 12, 10], [25, 21, 12, 10], [20, 15, 24, 20]], np.uint32)
    kinds = np.array([0, 0, 1], np.uint32)
    places = rng.uniform(0.0, 1.0, (3, 4, 2, 2))
    pixels = [np.floor(places * side).astype(np.uint32) for side in ((12, 10), (24, 20))]
    pairs = np.stack([p[..., 1] * 50 + p[..., 0] for p in pixels]).astype(np.uint32)
    posteriors = rng.uniform(0.0, 1.0, (3, 16)).astype(np.float32)
    sums, squares = cv2.integral2(grey, sdepth=cv2.CV_64F, sqdepth=cv2.CV_64F)
    codes, confidence = np.zeros((3, 3), np.int32), np.zeros(3, np.float32)
    scan(grey.ravel(), sums, squares, windows, kinds, pairs, posteriors, 50, 500.0, 0.0, codes, confidence)
    assert confidence[0] == -1.0
    for i in (1, 2):
        x, y, _, _ = windows[i]
        points = pixels[kinds[i]]
        values = grey[y + points[..., 1], x + points[..., 0]].astype(int)
        expected = ((values[..., 0] > values[..., 1]) * [8, 4, 2, 1]).sum(axis=1)
        np.testing.assert_array_equal(codes[i], expected)
        assert confidence[i] == pytest.approx(posteriors[np.arange(3), expected].mean())
    shared = np.empty(3, np.float32)
    overlaps(windows, 22.0, 20.0, 14.0, 9.0, shared)
    np.testing.assert_allclose(
        shared, [jaccard(tuple(w), (22.0, 20.0, 14.0, 9.0)) for w in windows.tolist()], rtol=1e-6
    )


def test_detector_finds_the_target_elsewhere_and_unlearns_what_is_like_it() -> None:
    frame = ground_picture(np.random.default_rng(4))
    paint(frame, car_picture(), Pose(150.0, 120.0))
    first = Pose(150.0, 120.0).box()
    grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
    detector = Detector((grey.shape[0], grey.shape[1]), first, TldConfig(), np.random.default_rng(1))
    detector.learn_first(grey, first)
    assert jaccard(detector.find(grey)[0], first) > 0.7
    both = frame.copy()
    second = Pose(450.0, 300.0, 0.0, 1.2)
    paint(both, car_picture(), second)
    grey = cv2.cvtColor(both, cv2.COLOR_BGR2GRAY)
    passed = detector.find(grey)
    assert max(jaccard(box, second.box()) for box in passed) > 0.6
    for _ in range(3):
        before = sum(jaccard(box, second.box()) > 0.5 for box in detector.find(grey))
        detector.learn(first)
    after = sum(jaccard(box, second.box()) > 0.5 for box in detector.find(grey))
    assert after < before or before == 0
    assert max(jaccard(box, first) for box in detector.find(grey)) > 0.7


def test_windows_that_overlap_are_one_answer() -> None:
    clusters = _clustered([
        _Found((10.0, 10.0, 20.0, 20.0), 0.7),
        _Found((100.0, 10.0, 20.0, 20.0), 0.8),
        _Found((14.0, 10.0, 20.0, 20.0), 0.9),
        _Found((12.0, 10.0, 20.0, 20.0), 0.6),
    ])  # fmt: skip
    assert sorted((one.box, one.similarity) for one in clusters) == [
        ((12.0, 10.0, 20.0, 20.0), 0.9),
        ((100.0, 10.0, 20.0, 20.0), 0.8),
    ]


def test_what_slides_over_the_target_is_not_learned() -> None:
    ground = ground_picture(np.random.default_rng(4))
    paint(ground, car_picture(), Pose(320.0, 240.0))
    tracker = TldTracker(TldConfig(), np.random.default_rng(0))
    tracker.init(ground, Pose(320.0, 240.0).box(), 0.0, 0)
    cover = ground_picture(np.random.default_rng(77))
    states = []
    for number in range(1, 30):
        frame = ground.copy()
        edge = 270 + 6 * number
        frame[180:300, 150:edge] = cover[180:300, 470 - edge : 320]
        states.append(tracker.update(frame, number * 50_000_000).state)
    assert states[-5:] == ["predicted"] * 5 or "lost" in states[-5:]
    result = tracker.update(ground, 31 * 50_000_000)
    assert result.state == "tracking"
    assert result.overlap(Pose(320.0, 240.0).box()) > 0.7
