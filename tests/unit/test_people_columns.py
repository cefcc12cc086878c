"""People who stand are told apart over the floor, from each other and from what lies at their feet."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from onboard.people.columns import Column, columns

GRAIN_M = 0.05
AREA_M2 = GRAIN_M**2


def _disc(place: tuple[float, float], radius_m: float, height_m: float) -> np.ndarray:
    """(N, 3) of place and height, as far apart as a cloud's points."""
    side = np.arange(-radius_m, radius_m + 1e-6, GRAIN_M)
    grid = np.array([(x, y, height_m) for x in side for y in side if x * x + y * y <= radius_m**2])
    return grid + np.array([*place, 0.0])


def _person(place: tuple[float, float], top_m: float = 1.75) -> np.ndarray:
    """Head, shoulders, thighs and feet of somebody who stands, one above the other."""
    discs = ((0.1, 1.0), (0.24, 0.82), (0.18, 0.45), (0.22, 0.05))
    return np.vstack([_disc(place, radius, share * top_m) for radius, share in discs])


def _box(low: tuple[float, float], high: tuple[float, float], height_m: float) -> np.ndarray:
    axes = (np.arange(a, b, GRAIN_M) for a, b in zip(low, high, strict=True))
    return np.array([(x, y, height_m) for x in next(axes) for y in np.arange(low[1], high[1], GRAIN_M)])


def _columns(points: np.ndarray) -> list[Column]:
    flat, heights = points[:, :2].astype(np.float32), points[:, 2].astype(np.float32)
    return columns(flat, heights, np.full(len(points), AREA_M2), np.zeros(len(points), np.int32))


def test_two_who_are_one_cluster_in_the_picture_are_two_columns():
    one, two = _person((0.0, 0.0)), _person((0.8, 0.1))
    found = _columns(np.vstack((one, two)))
    assert sorted(len(column.rows) for column in found) == sorted((len(one), len(two)))
    for column in found:
        assert (column.rows < len(one)).all() or (column.rows >= len(one)).all()


def test_a_plank_at_the_feet_is_not_theirs_and_arms_held_out_are():
    person = _person((0.0, 0.0))
    arms = np.vstack([_box((x, -0.05), (x + 0.55, 0.05), 1.6) for x in (0.25, -0.8)])
    plank = _box((0.3, 0.3), (1.8, 0.5), 0.2)
    (column,) = _columns(np.vstack((person, arms, plank)))
    mine = np.zeros(len(person) + len(arms) + len(plank), bool)
    mine[column.rows] = True
    assert mine[: len(person) + len(arms)].all() and mine[len(person) + len(arms) :].mean() < 0.1
    core = np.vstack((person, arms, plank))[column.core]
    assert np.linalg.norm(core[:, :2].mean(axis=0)) < 0.05


def test_an_arm_that_floats_hangs_on_whom_it_points_at_and_not_on_who_passes():
    waves, passes = _person((0.0, 0.0)), _person((1.1, 0.35))
    arm, board = _box((0.4, -0.05), (0.85, 0.05), 1.6), _box((0.4, -0.05), (0.85, 0.05), 0.6)
    for piece, owned in ((arm, True), (board, False)):
        points = np.vstack((waves, passes, piece))
        labels = np.repeat(np.arange(3, dtype=np.int32), [len(waves), len(passes), len(piece)])
        flat, heights = points[:, :2].astype(np.float32), points[:, 2].astype(np.float32)
        found = columns(flat, heights, np.full(len(points), AREA_M2), labels)
        sizes = sorted(len(column.rows) for column in found)
        assert sizes == [len(passes), len(waves) + owned * len(piece)], "a thing so low stands on the ground"
        assert all(len(np.unique(labels[column.rows] == 1)) == 1 for column in found)


@pytest.mark.parametrize(
    "points",
    [
        pytest.param(_disc((0.0, 0.0), 0.3, 0.9), id="a barrel"),
        pytest.param(_box((0.0, 0.0), (4.0, 1.8), 1.45), id="a car's roof"),
        pytest.param(_box((0.0, 0.0), (0.1, 0.1), 1.8), id="a post"),
        pytest.param(_box((0.0, 0.0), (0.5, 1.7), 0.25), id="who lies"),
        pytest.param(np.empty((0, 3)), id="nothing"),
    ],
)
def test_what_is_low_broad_or_thin_is_no_column(points: np.ndarray):
    assert _columns(points) == []


@settings(max_examples=20, deadline=None)
@given(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(0.0, 6.28), st.randoms(use_true_random=False))
def test_where_and_in_which_order_points_lie_changes_nothing(x: float, y: float, turn: float, random):
    points = np.vstack((_person((0.0, 0.0)), _person((0.9, 0.0)), _box((0.3, 0.5), (1.2, 0.7), 0.2)))
    order = list(range(len(points)))
    random.shuffle(order)
    moved = points.copy()
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    moved[:, :2] = points[:, :2] @ rotation.T + (x, y)
    found = _columns(moved[order])
    assert len(found) == 2
    first = len(_person((0.0, 0.0)))
    for column in found:
        people = np.array(order)[column.rows]
        people = people[people < 2 * first]
        assert (people < first).all() or (people >= first).all()
