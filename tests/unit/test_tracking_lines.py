"""The angle of a target's own lines: exact on what is drawn, silent where there are none, and without a bias."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.painted_scene import CAR_PX, Pose, Scene, car_picture, ground_picture, paint
from common.tracking.config import ParticleFilterConfig
from common.tracking.lines import OwnLines, lines_turn
from common.tracking.particle_filter import ParticleFilterTracker

ASPECT = CAR_PX[1] / CAR_PX[0]
REACH_RAD = 0.25


def _state(pose: Pose, off_rad: float = 0.0) -> np.ndarray:
    size_px = math.sqrt(CAR_PX[0] * CAR_PX[1]) * pose.scale
    return np.array([pose.x_px - 0.5, pose.y_px - 0.5, pose.angle_rad + off_rad, 1.0 / size_px])


def _picture(pose: Pose) -> np.ndarray:
    """The car as a renderer shows it: drawn four times as large and shrunk, so that its edges are no staircase."""
    ground = cv2.resize(ground_picture(np.random.default_rng(4)), None, fx=4.0, fy=4.0)
    paint(ground, car_picture(), Pose(4.0 * pose.x_px, 4.0 * pose.y_px, pose.angle_rad, 4.0 * pose.scale))
    return cv2.resize(ground, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)


@settings(max_examples=8)
@given(
    angle_rad=st.floats(-math.pi, math.pi),
    off_rad=st.floats(-REACH_RAD, REACH_RAD),
    scale=st.floats(0.9, 2.0),
)
def test_lines_give_the_angle_within_half_a_degree(angle_rad: float, off_rad: float, scale: float) -> None:
    pose = Pose(320.0, 240.0, angle_rad, scale)
    turn, coherence = lines_turn(_picture(pose), _state(pose, off_rad), ASPECT)
    assert math.degrees(abs(turn + off_rad)) < 0.5
    assert 0.5 < coherence <= 1.0


def test_ground_and_a_plain_picture_have_no_lines() -> None:
    ground = ground_picture(np.random.default_rng(4))
    for x, y in ((100.0, 100.0), (500.0, 120.0), (320.0, 380.0)):
        assert lines_turn(ground, _state(Pose(x, y, 0.3)), ASPECT)[1] < 0.2
    assert lines_turn(np.full((64, 64, 3), 90, np.uint8), _state(Pose(32.0, 32.0)), ASPECT) == (0.0, 0.0)


def test_lines_count_only_along_the_rectangle_that_the_target_was_chosen_by() -> None:
    pose = Pose(320.0, 240.0, 0.4)
    picture = _picture(pose)
    assert OwnLines(picture, _state(pose, 0.1), ASPECT, REACH_RAD).usable
    assert not OwnLines(picture, _state(pose, 0.35), ASPECT, REACH_RAD).usable, "lines across the chosen rectangle"
    assert not OwnLines(picture, _state(pose), ASPECT, 0.0).usable, "unread without a reach"
    meadow = OwnLines(ground_picture(np.random.default_rng(4)), _state(pose), ASPECT, REACH_RAD)
    assert not meadow.usable
    assert meadow.turn(picture, _state(pose, 0.1)) is None


def test_a_covered_target_is_not_turned_along_its_occluder() -> None:
    pose = Pose(320.0, 240.0, 0.4)
    picture = _picture(pose)
    lines = OwnLines(picture, _state(pose), ASPECT, REACH_RAD)
    assert lines.turn(picture, _state(pose, 0.2)) == pytest.approx(-0.2, abs=0.01)
    block = cv2.boxPoints(((pose.x_px, pose.y_px), (70.0, 200.0), math.degrees(pose.angle_rad) + 20.0))
    cv2.fillPoly(picture, [block.astype(np.int32)], (200, 200, 200))
    assert lines.turn(picture, _state(pose)) is None


def test_a_target_first_seen_from_the_side_is_not_seen_turned_from_above() -> None:
    """What shows of its far side when it is chosen is gone later, and the best fit of its colours lies turned."""
    pose = Pose(320.0, 240.0, -1.2, 1.6)

    def side(frame: np.ndarray, t_s: float) -> None:
        if t_s == 0.0:
            wedge = np.array([[-48.0, -24.0], [48.0, -24.0], [48.0, -8.0], [-48.0, -18.0]]) * pose.scale
            cosine, sine = math.cos(pose.angle_rad), math.sin(pose.angle_rad)
            corners = wedge @ np.array([[cosine, sine], [-sine, cosine]]) + (pose.x_px, pose.y_px)
            cv2.fillPoly(frame, [corners.astype(np.int32)], (140, 60, 30))

    bias_deg = {}
    for reach_rad in (0.0, REACH_RAD):
        config = ParticleFilterConfig(turn_sweep_rad=0.4, limit_floor=0.48, line_reach_rad=reach_rad)
        tracker = ParticleFilterTracker(config, np.random.default_rng(2))
        angles = []
        for t_ns, frame, _ in Scene(lambda _t_s: pose, seed=3, decorate=side).frames(1.5):
            if t_ns == 0:
                tracker.init(frame, pose.box(), pose.angle_rad, t_ns)
            else:
                angles.append(tracker.update(frame, t_ns).angle_rad - pose.angle_rad)
        bias_deg[reach_rad] = math.degrees(abs(float(np.mean(angles[5:]))))
    assert bias_deg[REACH_RAD] < 0.5
    assert bias_deg[0.0] > 2.0 * bias_deg[REACH_RAD]
