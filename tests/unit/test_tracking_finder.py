"""The target found in a whole picture by its colours: back-projection, windows, verification, light, look-alikes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.painted_scene import CAR_PX, Pose, Scene, car_picture, paint
from common.tracking.colour import binned
from common.tracking.finder import Found, Nearby, back_projection, search, windows
from common.tracking.histogram import LAYOUTS, HistogramModel, learn_model

SIZE_PX = math.sqrt(CAR_PX[0] * CAR_PX[1])
LIT = np.ones(3)


def _frame(pose: Pose, others: tuple[Pose, ...] = (), seed: int = 1, gain: float = 1.0) -> np.ndarray:
    def park(frame: np.ndarray, _t_s: float) -> None:
        for other in others:
            paint(frame, car_picture(), other)

    return next(Scene(lambda _: pose, seed=seed, decorate=park, gain=lambda _: gain).frames(0.05))[1]


@pytest.fixture(scope="module")
def model() -> HistogramModel:
    """What the car looks like, learnt from a picture of it alone."""
    state = np.array([(CAR_PX[0] - 1) / 2, (CAR_PX[1] - 1) / 2, 0.0, 1 / SIZE_PX])
    return learn_model(car_picture(), state, CAR_PX[1] / CAR_PX[0], LAYOUTS["five"])


def _search(frame: np.ndarray, model: HistogramModel, **more: object) -> Found:
    found = search(frame, model, LIT, np.random.default_rng(3), **more)  # type: ignore[arg-type]
    assert found is not None
    return found


def test_back_projection_is_bright_on_the_target_and_dark_on_the_ground(model: HistogramModel) -> None:
    likely = back_projection(_frame(Pose(400.0, 300.0)), model)
    on_target = np.zeros(likely.shape, bool)
    on_target[300 - 20 : 300 + 20, 400 - 44 : 400 + 44] = True

    assert likely[on_target].mean() > 60
    assert likely[~on_target].mean() < 2


def test_back_projection_of_a_picture_without_the_colours_is_empty(model: HistogramModel) -> None:
    assert not back_projection(np.full((48, 64, 3), (0, 255, 0), np.uint8), model).any()


@pytest.mark.parametrize("pose", [Pose(150.0, 240.0, 0.7), Pose(200.0, 100.0, 2.0), Pose(100.0, 400.0, -1.0)])
def test_a_large_roof_in_one_of_its_colours_does_not_hide_the_target(model: HistogramModel, pose: Pose) -> None:
    frame, car = _frame(pose), car_picture()
    frame[20:150, 320:630] = car[car.shape[0] // 2, car.shape[1] // 10]
    found = _search(frame, model, size_px=SIZE_PX)

    assert math.dist(found.state[:2], (pose.x_px, pose.y_px)) < 5.0


def test_windows_lie_where_it_looks_like_the_target_and_not_on_each_other(model: HistogramModel) -> None:
    frame = _frame(Pose(400.0, 300.0), others=(Pose(120.0, 100.0, 1.0),))
    bins = binned(frame, model.bins.table(LIT))
    found = windows(back_projection(frame, model), bins, model, SIZE_PX, 10)

    middles = [np.array([x + w / 2, y + h / 2]) for x, y, w, h in found]
    for car in ((400.0, 300.0), (120.0, 100.0)):
        assert min(math.dist(middle, car) for middle in middles[:4]) < 0.6 * SIZE_PX
    apart = [np.abs(a - b).max() for i, a in enumerate(middles) for b in middles[:i]]
    assert len(found) > 2 and min(apart) >= round(SIZE_PX)
    assert windows(np.zeros((480, 640), np.uint8), bins, model, SIZE_PX, 3) == []


@pytest.mark.parametrize("angle_deg", [0, 50, 135, -110])
@pytest.mark.parametrize("scale", [0.7, 1.0, 1.4])
def test_place_heading_and_size_are_recovered_without_an_expectation(
    model: HistogramModel, angle_deg: float, scale: float
) -> None:
    pose = Pose(200.0 + angle_deg, 240.0, math.radians(angle_deg), scale)
    found = _search(_frame(pose), model)

    assert math.dist(found.state[:2], (pose.x_px, pose.y_px)) < 12
    assert abs(math.remainder(found.state[2] - pose.angle_rad, 2 * math.pi)) < 0.2
    assert 1 / found.state[3] == pytest.approx(SIZE_PX * scale, rel=0.2)


def test_the_same_colours_otherwise_arranged_do_not_pass() -> None:
    halves, striped = (np.full((CAR_PX[1], CAR_PX[0], 3), (40, 40, 190), np.uint8) for _ in range(2))
    halves[:, 48:] = (190, 60, 40)
    for left in range(0, 96, 16):
        striped[:, left : left + 8] = (190, 60, 40)
    frame, other = _frame(Pose(-200.0, -200.0)), _frame(Pose(-200.0, -200.0), seed=2)
    paint(frame, halves, Pose(450.0, 330.0, 1.0))
    paint(other, striped, Pose(150.0, 120.0))
    state = np.array([450.0, 330.0, 1.0, 1 / SIZE_PX])
    learnt = learn_model(frame, state, CAR_PX[1] / CAR_PX[0], LAYOUTS["five"])

    assert _search(other, learnt, size_px=SIZE_PX).distance > 0.36, "found, and not like it"
    paint(other, halves, Pose(450.0, 330.0, -2.0))
    found = _search(other, learnt, size_px=SIZE_PX)
    assert found.distance < 0.25
    assert math.dist(found.state[:2], (450.0, 330.0)) < 6


def test_of_two_that_look_alike_the_one_near_the_expected_place_is_taken(model: HistogramModel) -> None:
    frame = _frame(Pose(150.0, 120.0), (Pose(480.0, 350.0),))
    for place in ((170.0, 130.0), (450.0, 330.0)):
        found = _search(frame, model, size_px=SIZE_PX, nearby=Nearby(place, 100.0, 0.0))
        assert math.dist(found.state[:2], place) < 60
        assert found.cost >= found.distance


def test_a_heading_long_out_of_sight_costs_nothing(model: HistogramModel) -> None:
    frame = _frame(Pose(320.0, 240.0, math.pi))
    near = (320.0, 240.0)
    just_lost = _search(frame, model, size_px=SIZE_PX, nearby=Nearby(near, 100.0, 0.0))
    long_lost = _search(frame, model, size_px=SIZE_PX, nearby=Nearby(near, 100.0, 0.0, heading_known=0.0))

    assert just_lost.cost > just_lost.distance + 0.04
    assert long_lost.cost < long_lost.distance + 0.01
    assert abs(math.remainder(long_lost.state[2] - math.pi, 2 * math.pi)) < 0.2


def test_the_gain_undoes_the_light(model: HistogramModel) -> None:
    frame = _frame(Pose(320.0, 240.0), gain=0.6)
    relit = search(frame, model, LIT / 0.6, np.random.default_rng(3), SIZE_PX)

    assert relit is not None
    assert relit.distance < 0.6 * _search(frame, model, size_px=SIZE_PX).distance
    assert math.dist(relit.state[:2], (320.0, 240.0)) < 10


def test_same_seed_same_place(model: HistogramModel) -> None:
    frame = _frame(Pose(320.0, 240.0, 0.3))

    np.testing.assert_array_equal(_search(frame, model).state, _search(frame, model).state)


def test_nothing_of_its_colours_nothing_found(model: HistogramModel) -> None:
    assert search(np.full((240, 320, 3), (0, 255, 0), np.uint8), model, LIT, np.random.default_rng(3)) is None
