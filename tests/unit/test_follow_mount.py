"""What pictures show of a mount that shakes, beside what the vehicle knows of its attitude."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from common.geometry.camera import Camera
from common.geometry.rotation import as_quat, quat_from_euler, quat_multiply
from onboard.follow.mount import Mount
from onboard.follow.sight import in_camera
from onboard.proximity.pose import Pose

S = 1_000_000_000
FOCUS_PX = 228.0
AHEAD = as_quat(quat_multiply(quat_from_euler(0.0, -0.17, 0.0), (0.5, 0.5, 0.5, 0.5)))
CAMERA = Camera(320, 240, FOCUS_PX, FOCUS_PX, 159.5, 119.5, (0.0, 0.0, 0.0, 0.0, 0.0), AHEAD, (0.0, 0.0, 0.0))
WALL = cv2.GaussianBlur(np.random.default_rng(1).integers(0, 255, (600, 900, 3), np.uint8), (0, 0), 2.0)
STANDS = Pose(np.array([0.0, 0.0, -1.5]), quat_from_euler(0.0, 0.0, 0.3))


def _picture(right_px: float, down_px: float) -> np.ndarray:
    """A far wall that the picture shows so far right and down, px."""
    moved = np.array([[1.0, 0.0, right_px - 290.0], [0.0, 1.0, down_px - 180.0]])
    return cv2.warpAffine(WALL, moved, (320, 240), flags=cv2.INTER_LINEAR)


def _seen_px(pose: Pose | None) -> np.ndarray:
    """Where the picture shows a place on the wall by a pose, (2,), px."""
    assert pose is not None
    far = np.array([20.0 * math.cos(0.3), 20.0 * math.sin(0.3), 1.0])
    return CAMERA.project(in_camera(CAMERA, pose, far)[None])[0]


def _swing_px(k: int) -> np.ndarray:
    """Of a mount that swings five times a second, (2,), px, at picture k of 30 a second."""
    return np.array([10.0, -6.0]) * math.sin(2 * math.pi * 5 * k / 30)


@pytest.mark.parametrize("even_px", [0.0, 1.5])
def test_a_swing_is_taken_out_and_what_goes_on_evenly_is_not(even_px: float) -> None:
    mount, off = Mount(CAMERA), []
    for k in range(90):
        right, down = _swing_px(k) + np.array([even_px * k, 0.0])
        pose = mount.pose(_picture(right, down), k * S // 30, STANDS, None)
        off.append(_seen_px(pose) - _seen_px(STANDS) - _swing_px(k))
    assert np.abs(off[45:]).max() < 3.0, "of 10 px"


def test_what_the_vehicle_knows_of_its_own_turn_is_no_swing_of_the_mount() -> None:
    mount = Mount(CAMERA)
    for k in range(60):
        turned = replace(STANDS, ned_q_body=quat_from_euler(0.0, 0.0, 0.3 + 0.4 * math.sin(k / 10)))
        right = -FOCUS_PX * math.tan(0.4 * math.sin(k / 10)) * math.cos(0.17)
        pose = mount.pose(_picture(right, 0.0), k * S // 30, turned, None)
        assert np.abs(_seen_px(pose) - _seen_px(turned)).max() < 3.0, "of up to 90 px"


def test_after_a_gap_without_a_pose_and_above_a_target_nothing_is_taken_out() -> None:
    mount = Mount(CAMERA)
    assert mount.pose(_picture(0.0, 0.0), 0, STANDS, None) is STANDS, "nothing is known yet"
    assert mount.pose(_picture(8.0, 0.0), S, STANDS, None) is STANDS, "it is too long ago"
    assert mount.pose(_picture(0.0, 0.0), S + S // 30, None, None) is None
    assert mount.pose(_picture(8.0, 0.0), S + S // 15, STANDS, None) is STANDS
    assert mount.pose(_picture(0.0, 0.0), S + S // 10, STANDS, None) is not STANDS
    mount.calibrate(replace(CAMERA, fx_px=200.0))
    assert mount.pose(_picture(8.0, 0.0), S + 2 * S // 15, STANDS, None) is STANDS
    down = Mount(replace(CAMERA, body_q_camera=as_quat((math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)))))
    for k in range(3):
        assert down.pose(_picture(8.0 * k, 0.0), k * S // 30, STANDS, None) is STANDS
