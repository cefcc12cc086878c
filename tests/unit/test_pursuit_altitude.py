"""The height from the target's size: geometry, a disturbance that is undone, limits, what freezes it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest

from benchmarks.painted_scene import Pose as Drawn
from benchmarks.painted_scene import Scene
from common.config import ConfigError, build
from common.geometry.config import CameraConfig
from common.geometry.rotation import quat_from_euler, quat_rotate
from common.tracking.base import TrackResult
from common.tracking.config import ParticleFilterConfig
from common.tracking.particle_filter import ParticleFilterTracker
from ground.pursuit.altitude import AltitudeLaw, height_over_size, is_cut
from ground.pursuit.config import PursuitConfig
from ground.pursuit.pursuer import Pursued, Pursuer
from ground.pursuit.view import Pose, look, pixel_of

CAMERA = CameraConfig().camera()
PERIOD_NS = 50_000_000
SIZE_M = 0.6


def _result(x: float = 319.5, y: float = 239.5, size_px: float = 60.0) -> TrackResult:
    return TrackResult((x, y), (size_px, size_px), 0.0, 0.9, 0.5, "tracking", 0.05)


@pytest.mark.parametrize("attitude", [(0.0, 0.0, 0.3), (0.25, -0.2, 0.0), (-0.1, 0.3, 2.0)])
@pytest.mark.parametrize(("place", "height_m"), [((0.0, 0.0), 5.0), ((0.9, -0.6), 3.0)])
def test_neither_tilt_nor_place_passes_for_a_height(
    attitude: tuple[float, float, float], place: tuple[float, float], height_m: float
) -> None:
    """Against the area of a small square on the ground, projected corner by corner."""
    pose = Pose(np.array([0.0, 0.0, -height_m]), np.zeros(3), quat_from_euler(*attitude))
    side_m = 0.02
    around = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * side_m / 2 + np.array([*place, 0.0])
    corners = [pixel_of(CAMERA, pose, corner) for corner in around]
    middle = pixel_of(CAMERA, pose, np.array([*place, 0.0]))
    assert middle is not None
    area_px = cv2.contourArea(np.array(corners, np.float32))
    view = look(CAMERA, pose, middle, 0.0, 0.0)
    assert view is not None
    result = replace(_result(*middle), size_px=(math.sqrt(area_px), math.sqrt(area_px)))
    camera_m = height_m - quat_rotate(pose.ned_q_body, CAMERA.body_p_camera_m)[2]
    assert height_over_size(CAMERA, view.tangents, result) == pytest.approx(camera_m / side_m, rel=0.01)


def _flown(config: PursuitConfig, height_m: float, disturbed_by: float, seed: int = 1) -> tuple[float, list[float]]:
    """Height, m, after 20 s on a vehicle that answers within 0.5 s, disturbed at 2 s; and all that was asked."""
    law, rng = AltitudeLaw(config), np.random.default_rng(seed)
    climb_m_s, asked = 0.0, []
    for index in range(400):
        if index == 40:
            height_m *= disturbed_by
        noise = math.exp(0.04 * rng.normal())
        wanted = law.climb(noise * height_m / SIZE_M, height_m, index * PERIOD_NS)
        climb_m_s += (wanted - climb_m_s) * 0.05 / 0.5
        height_m += 0.05 * climb_m_s
        asked.append(wanted)
    return height_m, asked


@pytest.mark.parametrize("factor", [1.5, 1 / 1.5])
def test_a_disturbed_height_returns_to_the_size_at_the_start(factor: float) -> None:
    config = PursuitConfig(altitude="scale")
    height_m, asked = _flown(config, 4.0, factor)
    assert height_m == pytest.approx(4.0, rel=0.05)
    assert -config.sink_m_s <= min(asked) and max(asked) <= config.climb_m_s
    assert max(abs(a) for a in asked[:11]) == 0.0, "nothing is asked before the size at the start is known"


def test_a_known_size_leads_to_a_height_in_metres() -> None:
    config = PursuitConfig(altitude="scale", altitude_m=3.0, target_size_m=SIZE_M)
    assert _flown(config, 4.5, 1.0)[0] == pytest.approx(3.0, rel=0.05)


def test_the_size_at_the_start_is_kept_through_a_gap_and_forgotten_with_the_target() -> None:
    law = AltitudeLaw(PursuitConfig(altitude="scale"))
    for index in range(20):
        assert law.climb(10.0, 5.0, index * PERIOD_NS) == pytest.approx(0.0)
    assert law.freeze() == 0.0
    assert law.climb(15.0, 7.5, 30 * PERIOD_NS) < -0.3
    law.reset()
    assert law.climb(15.0, 7.5, 31 * PERIOD_NS) == 0.0


def test_one_of_height_and_size_alone_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"altitude_m: got 4.0 with target_size_m 0.0; expected both"):
        build(PursuitConfig, {"altitude": "scale", "altitude_m": 4.0}, "test")


@pytest.mark.parametrize(("x", "y", "cut"), [(320.0, 240.0, False), (25.0, 240.0, True), (320.0, 460.0, True)])
def test_a_rectangle_over_the_edge_is_cut(x: float, y: float, cut: bool) -> None:
    assert is_cut(CAMERA, _result(x, y)) == cut


def _chased(x_px: float, shown: Any = lambda t_s: True, **settings: Any) -> list[Pursued]:
    """A car that stands and shrinks to two thirds within a second from t = 1 s on, seen by a level vehicle at 5 m."""

    def path(t_s: float) -> Drawn:
        return Drawn(x_px if shown(t_s) else 2000.0, 240.0, 0.0, 1.0 - min(max(t_s - 1.0, 0.0), 1.0) / 3)

    config = PursuitConfig(altitude="scale", **settings)
    tracker = ParticleFilterConfig(size_prior=1.0)
    pursuer = Pursuer(config, lambda: ParticleFilterTracker(tracker, np.random.default_rng(1)))
    pose = Pose(np.array([0.0, 0.0, -5.0]), np.zeros(3), quat_from_euler(0.0, 0.0, 0.0))
    pursued = []
    for index, (t_ns, frame, drawn) in enumerate(Scene(path, seed=2).frames(2.5)):
        if index == 0:
            pursuer.select(frame, drawn.box(), 0.0, t_ns)
        elif (step := pursuer.step(frame, t_ns, CAMERA, pose)) is not None:
            pursued.append(step)
    return pursued


def _climbs(pursued: list[Pursued]) -> list[float]:
    return [p.wish.climb_m_s for p in pursued if p.wish is not None]


def test_a_target_that_shrinks_is_sunk_to() -> None:
    climbs = _climbs(_chased(320.0))
    assert np.abs(climbs[:18]).max() < 0.15
    assert np.mean(climbs[-5:]) < -0.2  # the fastest descent is 0.4 m/s


def test_nothing_is_asked_for_a_target_that_is_lost_or_cut() -> None:
    hidden = _chased(320.0, lambda t_s: t_s < 1.5)
    lost = [p.wish.climb_m_s for p in hidden if p.wish is not None and not p.seen]
    assert len(lost) > 5 and set(lost) == {0.0}, "lost: it neither sinks nor climbs to search"
    cut = [p.wish.climb_m_s for p in _chased(28.0) if p.wish is not None and is_cut(CAMERA, p.result)]
    assert len(cut) > 20 and set(cut) == {0.0}
