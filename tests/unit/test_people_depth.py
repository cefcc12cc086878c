"""Depth pictures: units, holes, what is refused, and where the points of the cloud lie."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.people_scene import KINECT_2
from onboard.people.depth import RayTable, UnusableDepth, metres

SMALL = replace(KINECT_2, width=64, height=48, fx_px=50.0, fy_px=50.0, cx_px=31.5, cy_px=23.5)
TABLE = RayTable.of(SMALL)


def _flat(depth_m: float = 5.0) -> np.ndarray:
    return np.full((48, 64), depth_m, np.float32)


def test_millimetres_and_metres_are_the_same_picture():
    np.testing.assert_allclose(metres(np.full((48, 64), 5000, np.uint16), SMALL), _flat())


@pytest.mark.parametrize(
    ("depth", "said"),
    [
        (np.zeros((48, 64), np.float32), "every depth is zero or NaN"),
        (np.full((48, 64), np.nan, np.float32), "every depth is zero or NaN"),
        (np.zeros((48, 64), np.uint16), "every depth is zero or NaN"),
        (_flat(5000.0), "divide millimetres by 1000"),
        (_flat()[:40], r"got shape \(40, 64\), expected \(48, 64\)"),
        (np.ones((48, 64), np.int64), "got int64, expected uint16"),
        (np.ones((48, 64, 3), np.float32), r"got shape \(48, 64, 3\)"),
    ],
)
def test_what_cannot_be_depth_is_refused(depth: np.ndarray, said: str):
    with pytest.raises(UnusableDepth, match=said):
        metres(depth, SMALL)


def test_a_scene_out_of_range_is_refused():
    with pytest.raises(UnusableDepth, match="within the sensor's range"):
        TABLE.stride_for(_flat(30.0), 0.06, 0.4, 14.0)
    with pytest.raises(UnusableDepth, match=r"between 0\.4 and 14\.0 m"):
        TABLE.cloud(_flat(30.0), 1, 0.4, 14.0)


@pytest.mark.parametrize("stride", [1, 3])
def test_points_lie_where_the_pixels_look(stride: int):
    depth = _flat()
    depth[10, :] = 0.0
    depth[:, 20] = np.nan
    cloud = TABLE.cloud(depth, stride, 0.4, 14.0)
    assert len(cloud.points_m) > 600 // stride**2
    np.testing.assert_allclose(SMALL.project(cloud.points_m), cloud.pixels, atol=1e-3)
    np.testing.assert_array_equal(cloud.points_m[:, 2], 5.0)
    assert not (cloud.pixels[:, 0] == 20).any() and not (cloud.pixels[:, 1] == 10).any()


@pytest.mark.parametrize("height_m", [2.0, 5.0, 12.0])
def test_the_stride_keeps_the_distance_between_points(height_m: float):
    table = RayTable.of(KINECT_2)
    stride = table.stride_for(np.full((424, 512), height_m, np.float32), 0.06, 0.4, 14.0)
    assert stride * height_m / 365.0 == pytest.approx(0.06, rel=0.2)
