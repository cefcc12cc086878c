"""What stands where the target is foreseen, by a depth camera: found whatever its look, and only where it is clear."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from common.geometry.camera import Camera
from common.geometry.rotation import as_quat, quat_from_euler, quat_multiply
from common.tracking.base import Box
from onboard.follow.solid import Solid
from onboard.follow.things import DepthView, Thing
from onboard.fusion.foreseen import Foreseen
from onboard.proximity.pose import Pose

S = 1_000_000_000
EYE_M, FOCUS_PX = 1.5, 228.0
CAMERA = Camera(
    320,
    240,
    FOCUS_PX,
    FOCUS_PX,
    159.5,
    119.5,
    (0.0, 0.0, 0.0, 0.0, 0.0),
    as_quat((0.5, 0.5, 0.5, 0.5)),
    (0.0, 0.0, 0.0),
)
POSE = Pose(np.array([0.0, 0.0, -EYE_M]), quat_from_euler(0.0, 0.0, 0.0))
HALF = (160, 120)
"""Width and height of the depth picture."""


def depth_of(*people: tuple[float, float, float], lean: float = 0.0) -> np.ndarray:
    """Depth over a level floor of people 1.7 m tall, 0.5 m wide: (ahead, right, wider by) m; the first leans."""
    columns, rows = np.meshgrid(np.arange(HALF[0]), np.arange(HALF[1]))
    u, v = (2 * columns + 0.5 - 159.5) / FOCUS_PX, (2 * rows + 0.5 - 119.5) / FOCUS_PX
    depth = np.where(v > 0.0, EYE_M / np.maximum(v, 1e-6), 0.0)
    depth[depth > 8.0] = 0.0
    for number, (ahead_m, right_m, wider_m) in enumerate(people):
        right, up = u * ahead_m - right_m, EYE_M - v * ahead_m
        inside = (np.abs(right - lean * up * (number == 0)) < 0.25 + wider_m / 2) & (up > 0.0) & (up < 1.7)
        depth[inside & ((depth == 0.0) | (depth > ahead_m))] = ahead_m
    return depth


def box_at(ahead_m: float, right_m: float) -> Box:
    """What the picture shows of one of them, his hands and feet left out."""
    left, top = ((right_m - 0.2) / ahead_m, (EYE_M - 1.6) / ahead_m)
    width, height = 0.4 * FOCUS_PX / ahead_m, 1.5 * FOCUS_PX / ahead_m
    return 159.5 + left * FOCUS_PX, 119.5 + top * FOCUS_PX, width, height


def _foreseen(distance_m: float, depth_m: np.ndarray) -> Foreseen:
    return Foreseen(box_at(distance_m, 0.0), distance_m, 0.0, depth_m, (240, 320))


def _find(solid: Solid, foreseen: Foreseen, reach_m: float) -> Box | None:
    free = np.zeros((120, 160), bool) if foreseen.depth_m is None else DepthView(CAMERA).free(POSE, foreseen.depth_m)
    return solid.find(free, foreseen, reach_m)


def _things(pose: Pose, foreseen: Foreseen, camera: Camera = CAMERA) -> list[Thing]:
    view = DepthView(camera)
    assert foreseen.depth_m is not None
    return Solid(view).things(view.free(pose, foreseen.depth_m), foreseen)


def _learned(seconds: float = 1.0) -> Solid:
    solid, depth = Solid(DepthView(CAMERA)), depth_of((4.0, 0.0, 0.0))
    for k in range(round(30 * seconds) + 1):
        free = DepthView(CAMERA).free(POSE, depth)
        solid.learn(S + k * S // 30, box_at(4.0, 0.0), free, _foreseen(4.0, depth))
    return solid


@pytest.mark.parametrize(("ahead_m", "right_m"), [(4.0, 0.0), (4.3, 0.3), (3.2, -0.4), (6.0, 0.2)])
def test_the_box_is_the_part_of_the_thing_that_the_trackers_showed(ahead_m: float, right_m: float) -> None:
    foreseen = _foreseen(ahead_m + 0.2, depth_of((ahead_m, right_m, 0.0)))
    found = _find(_learned(), foreseen, 0.5)
    there = box_at(ahead_m, right_m)
    assert found is not None and found[2:] == pytest.approx(there[2:], rel=0.02)
    assert found[0] + found[2] / 2 == pytest.approx(there[0] + there[2] / 2, abs=3.0)
    assert found[1] + found[3] / 2 == pytest.approx(there[1] + there[3] / 2, abs=3.0)


def test_he_is_as_large_as_before_though_the_trackers_boxes_have_grown() -> None:
    x, y, width, height = box_at(4.0, 0.0)
    grown: Box = (x - 0.15 * width, y - 0.12 * height, 1.3 * width, 1.24 * height)
    foreseen = replace(_foreseen(4.0, depth_of((4.0, 0.1, 0.0))), box=grown)
    assert _find(_learned(), foreseen, 0.5) is not None
    assert _find(_learned(), replace(foreseen, depth_m=depth_of((4.0, 0.1, 0.5))), 0.5) is None, "wider than he is"


def test_who_stands_before_a_wall_is_a_thing_though_he_may_have_gone_as_far_as_the_wall() -> None:
    depth = depth_of((4.5, 0.0, 0.0))
    depth[(depth == 0.0) | (depth > 6.0)] = 6.0
    found = _find(_learned(), replace(_foreseen(4.0, depth), reach_m=2.5), 3.0)
    assert found == pytest.approx(box_at(4.5, 0.0), abs=3.0)


@pytest.mark.parametrize("others", [[], [(4.0, -0.8, 0.0)]])
def test_who_leans_stands_where_he_stood_also_beside_somebody_else(others: list[tuple[float, float, float]]) -> None:
    found = _find(_learned(), _foreseen(4.0, depth_of((4.0, 0.0, 0.0), *others, lean=0.4)), 0.5)
    assert found is not None
    u, v = found[0] + found[2] / 2, found[1] + found[3] / 2
    assert math.hypot(u - 159.5 - 0.8 * 0.4 * FOCUS_PX / 4.0, v - 119.5 - 0.65 * FOCUS_PX / 4.0) < 12.0


def test_nothing_is_said_before_anything_is_known_nor_where_it_is_not_clear() -> None:
    foreseen = _foreseen(4.0, depth_of((4.0, 0.1, 0.0)))
    solid = _learned()
    assert _find(solid, foreseen, 0.5) is not None
    assert _find(_learned(0.3), foreseen, 0.5) is None, "too little was seen yet"
    assert _find(solid, foreseen, 0.05) is None, "he cannot have come so far"
    two = replace(foreseen, depth_m=depth_of((4.0, -0.4, 0.0), (4.0, 0.5, 0.0)))
    assert _find(solid, two, 0.6) is None, "either may be he"
    beside = replace(foreseen, depth_m=depth_of((4.0, 0.0, 0.0), (4.0, 0.8, 0.0)))
    assert _find(solid, beside, 0.6) is not None, "one of them is where he was"
    for nobody in (depth_of(), depth_of((3.0, 0.0, 0.0)), depth_of((5.2, 0.0, 0.0)), np.zeros((120, 160))):
        assert _find(solid, replace(foreseen, depth_m=nobody), 0.5) is None
    assert _find(solid, replace(foreseen, depth_m=depth_of((4.0, 0.0, 1.0))), 0.5) is None, "a wall, or two"
    beyond: Box = (-25.0, *foreseen.box[1:])
    assert _find(solid, replace(foreseen, box=beyond), 5.0) is None, "the picture does not show his place"
    assert _find(solid, replace(foreseen, covered_m=4.0), 0.5) is None, "that is what has covered him"
    assert _find(solid, replace(foreseen, depth_m=None), 0.5) is None


def test_he_is_found_also_where_he_has_got_far_away_and_looks_small() -> None:
    foreseen = replace(_foreseen(2.5, depth_of((6.2, 0.8, 0.0))), reach_m=3.5)
    found = _find(_learned(), foreseen, 4.0)
    assert found is not None and found[2:] == pytest.approx(box_at(6.2, 0.8)[2:], rel=0.05)


def test_the_side_of_what_covers_him_is_not_he_though_he_may_have_come_as_near() -> None:
    depth = depth_of()
    depth[20:, 20:60] = 3.0
    depth[20:, 60:72] = np.linspace(3.02, 3.5, 12)  # the screen's side, into the distance
    foreseen = replace(_foreseen(3.9, depth), reach_m=0.5)
    assert len(_things(POSE, foreseen)) == 1, "without what has covered him"
    assert not _things(POSE, replace(foreseen, covered_m=3.1))


def test_a_floor_that_seems_to_rise_because_the_mount_shakes_is_nobody() -> None:
    tilted = Pose(POSE.ned_p_m, quat_from_euler(0.0, 0.06, 0.0))
    wide = replace(_foreseen(4.0, depth_of()), reach_m=1.5)
    assert not _things(tilted, wide)
    steep = Pose(POSE.ned_p_m, quat_from_euler(0.0, 0.2, 0.0))
    assert not _things(steep, wide), "it rises, but goes on into the distance"


def test_the_floor_at_his_feet_is_no_part_of_him_however_the_vehicle_tilts() -> None:
    things = _things(POSE, _foreseen(4.0, depth_of((4.0, 0.0, 0.0))))
    assert len(things) == 1
    assert things[0].box[1] + things[0].box[3] == pytest.approx(119.5 + (EYE_M - 0.3) / 4.0 * FOCUS_PX, abs=3.0)
    down = quat_from_euler(0.0, -0.3, 0.0)
    mount = as_quat(quat_multiply(down, CAMERA.body_q_camera))
    tilted = Pose(POSE.ned_p_m, quat_from_euler(0.0, 0.3, 0.0))
    same = _things(tilted, _foreseen(4.0, depth_of((4.0, 0.0, 0.0))), replace(CAMERA, body_q_camera=mount))
    assert same[0][:4] == things[0][:4], "the nose is up and the camera mounted down as much"
