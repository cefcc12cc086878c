"""The simulated people: bodies that stand on the ground and have the right size, and what a camera sees of them."""

from __future__ import annotations

import numpy as np
import pytest

from common.geometry.camera import Camera
from common.geometry.rotation import as_quat, matrix_to_quat, quat_from_euler
from simulation.world.body import PARTS, places, root_height, surface
from simulation.world.body_paint import Outfit, paint
from simulation.world.objects_config import PersonConfig, ThingConfig, WallConfig
from simulation.world.people_truth import SeenPerson, seen_people
from simulation.world.renderer import Canvas, Renderer, camera_pose
from simulation.world.scenario import CarConfig, GroundConfig, ScenarioConfig
from simulation.world.scene import CarPose, Scene
from simulation.world.stances import LYING, POSTURES, Posture, stance, walking

PLAIN = GroundConfig(size_m=12, texture_px=256, trees=0, houses=0, road=False)
NORTH_UP = as_quat(matrix_to_quat(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])))
DOWN = Camera(480, 270, 270.0, 270.0, 239.5, 134.5, (0.0, 0.0, 0.0, 0.0, 0.0), NORTH_UP, (0.0, 0.0, 0.0))


def _skin(posture: Posture, limbs: int, t_s: float = 0.0) -> np.ndarray:
    """All vertices (V, 3) of a body of height 1, its lowest point `lift` above z = 0."""
    held = stance(posture, limbs, t_s)
    found = places(held)
    points = [found[p.name][0] + surface(p, 1.0, 1.0).vertices_m @ found[p.name][1].T for p in PARTS]
    return np.concatenate(points) + np.array([0.0, 0.0, root_height(held, 1.0)])


@pytest.mark.parametrize("posture", POSTURES)
def test_every_body_rests_on_the_ground_and_is_as_large_as_it_says(posture: Posture):
    for limbs in range(4):
        points = _skin(posture, limbs)
        assert points[:, 2].min() == pytest.approx(0.0, abs=1e-9)
        top = float(np.ptp(points[:, 2]))
        if posture in LYING:
            assert top < 0.37 and 0.75 < np.ptp(points[:, 0]) < 1.35, "arms may reach beyond the head"
        elif posture == "sitting":
            assert 0.4 < top < 0.62
        elif posture == "standing":
            assert top == pytest.approx(1.0, abs=0.01)
        else:
            assert 0.95 < top < 1.35


def test_who_jumps_leaves_the_ground_and_comes_back():
    lowest = [_skin("jumping", 0, t_s)[:, 2].min() for t_s in np.linspace(0.0, 2.0, 41)]
    assert min(lowest) == pytest.approx(0.0, abs=1e-9) and 0.1 < max(lowest) < 0.25


def test_limbs_differ_by_their_number_and_steps_by_their_phase():
    assert not np.allclose(_skin("supine", 1), _skin("supine", 2))
    np.testing.assert_array_equal(_skin("supine", 3), _skin("supine", 3))
    left, right = (walking(0.5 * np.pi, 1.0).turns[f"thigh_{side}"][2] for side in ("l", "r"))
    assert left * right < 0


def test_surfaces_are_closed_and_hold_a_body():
    volume = 0.0
    for part in PARTS:
        mesh = surface(part, 1.75, 1.0)
        a, b, c = (mesh.vertices_m[mesh.faces[:, k]] for k in range(3))
        inside = float(np.einsum("ij,ij", a, np.cross(b, c))) / 6
        assert inside > 0, part.name
        volume += inside
    assert 0.055 < volume < 0.095  # 60 to 90 kg of about the density of water


def test_a_person_is_painted_in_their_colours():
    outfit = Outfit((200, 150, 120), (40, 30, 20), (20, 180, 30), (30, 40, 160), (10, 10, 10))
    picture = paint(np.random.default_rng(0), outfit).astype(float)
    shirt, trousers = picture[300:350, 400:500].mean(axis=(0, 1)), picture[280:360, 150:230].mean(axis=(0, 1))
    assert shirt.argmax() == 1 and trousers.argmax() == 2
    np.testing.assert_allclose(picture[60:80, 100:110].mean(axis=(0, 1)), (200, 150, 120), atol=25)


class _Look:
    """A scene, and who is seen in it from above."""

    def __init__(self, people: tuple[PersonConfig, ...], **rest: object):
        parked = CarConfig(north_m=-50.0, east_m=-50.0)
        self.scene = Scene(ScenarioConfig(ground=PLAIN, car=parked, people=people, **rest), 480, 270)  # pyright: ignore
        self.canvas = Canvas(self.scene)
        self.renderer = Renderer(self.canvas, DOWN)

    def seen(self, north_m: float, east_m: float, height_m: float = 5.0) -> dict[int, SeenPerson]:
        self.scene.place(CarPose((-50.0, -50.0), 0.0), [], (0.0, 0.0, -40.0))
        pose = camera_pose(DOWN, (north_m, east_m, -height_m), quat_from_euler(0.0, 0.0, 0.0))
        bodies = self.renderer.bodies(*pose)
        return {s.number: s for s in seen_people(self.scene, DOWN, *pose, bodies)}


def _seen(places_ne_m: list[tuple[float, float]], *args: object, **rest: object) -> list[dict[int, SeenPerson]]:
    look = _Look(*args, **rest)  # pyright: ignore
    try:
        return [look.seen(*place) for place in places_ne_m]
    finally:
        look.canvas.close()


def test_a_camera_sees_whole_and_half_people_and_no_things():
    supine = PersonConfig(posture="supine", heading_deg=0.0, limbs=3)
    standing = PersonConfig(north_m=0.5, east_m=-2.0, posture="standing")
    thing = ThingConfig(kind="dummy", north_m=0.5, east_m=2.5, size_m=1.7)
    # Moved to the south, the camera loses the head, which lies in the north; moved to the north, the feet.
    whole, headless, gone = _seen([(0.0, 0.0), (-2.8, 0.0), (2.6, 0.0)], (supine, standing), things=(thing,))
    assert set(whole) == {1, 2}
    assert whole[1].counts and whole[1].head > 0.95 and whole[1].body > 0.95
    x, y, w, h = whole[1].box_px
    assert abs(x + w / 2 - 239.5) < 20 and abs(y + h / 2 - 134.5) < 20
    assert h * 4.8 / 270 == pytest.approx(1.75, abs=0.35) and w < h
    np.testing.assert_allclose(whole[1].ned_p_m, (0.0, 0.0, -0.1), atol=0.12)
    assert whole[2].counts and whole[2].ned_p_m[2] == pytest.approx(-0.95, abs=0.15)
    assert 1 in headless and headless[1].head < 0.5 and not headless[1].counts
    assert gone[1].head == 1.0 and 0.2 < gone[1].body < 0.8
    board = WallConfig(start=(-0.45, 1.5), end=(-0.45, -0.9), height_m=0.6, thickness_m=0.9)
    (hidden,) = _seen([(0.0, 0.0)], (supine,), walls=(board,))
    assert hidden[1].head > 0.95 and 0.3 < hidden[1].body < 0.8
