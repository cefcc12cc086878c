"""The simulated world as a MuJoCo model: painted ground, props, occluders, cars; and what hides the chased one.

MuJoCo's world frame here is north-west-up (x north, y west, z up); NED turns into it by (n, e, d) -> (n, -e, -d).
Cars and the vehicle's shadow are moved by placing them: nothing is simulated dynamically.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simulation.world.gl import mujoco
from simulation.world.ground import GroundPainter
from simulation.world.layout import SHADOW_NE_PER_M, House, Tree, lay_out
from simulation.world.meshes import CAR_BELT, Mesh, car_mesh, crown_mesh, gable_mesh
from simulation.world.path import CarPath, car_path
from simulation.world.scenario import CarConfig, OccluderConfig, ScenarioConfig, rgb
from simulation.world.textures import Picture, car_paint, leaves, planks, roof_tiles

Array = NDArray[np.float64]

NWU_FROM_NED = np.array([1.0, -1.0, -1.0])
"""Factors that turn a NED vector into MuJoCo's frame, and back."""
_GROUND_GROUP, _OCCLUDER_GROUP, _MOVING_GROUP = 0, 1, 2
_ONLY_OCCLUDERS = np.array([0, 1, 0, 0, 0, 0], np.uint8)
_HIDDEN_GROUP = 5
_FIELD_M = 200.0
# On a plane MuJoCo runs a picture's columns along x and its rows against y; the painter's columns run east, its rows
# south: a quarter turn.
_PLANE_QUAT = [0.5**0.5, 0.0, 0.0, -(0.5**0.5)]
_TREE_COLOURS = ((74, 110, 40), (96, 122, 44), (58, 96, 52))
_ROOF_COLOURS = ((164, 84, 58), (112, 104, 104))
_BARK, _WALL = (0.33, 0.26, 0.2, 1.0), (0.86, 0.83, 0.76, 1.0)


@dataclass(frozen=True)
class CarPose:
    """Where a car stands."""

    ned_p_m: tuple[float, float]
    """North and east of its centre, m."""
    heading_rad: float
    """Heading, rad from north, clockwise."""


class Scene:
    """Model and state of the world of one scenario.

    Args:
        scenario: what to build.
        width: columns of the largest picture, px.
        height: rows of the largest picture, px.
    """

    def __init__(self, scenario: ScenarioConfig, width: int, height: int):
        self.scenario = scenario
        self.path: CarPath = car_path(scenario.car)
        self.distractor_paths: tuple[CarPath, ...] = tuple(car_path(c) for c in scenario.distractors)
        builder = _Builder(scenario, self.path, width, height)
        self.model = builder.spec.compile()
        self.data = mujoco.MjData(self.model)
        self._props = np.flatnonzero(self.model.geom_group == _OCCLUDER_GROUP)
        self._samples_m = _samples(scenario.car)
        self._ray_geom, self._ray_m = np.zeros(len(self._samples_m), np.int32), np.zeros(len(self._samples_m))
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)
        self._prop_xy_m = self.data.geom_xpos[self._props, :2].copy()
        self._prop_reach_m = self.model.geom_rbound[self._props]

    def place(self, car: CarPose, distractors: list[CarPose], ned_vehicle_m: ArrayLike) -> None:
        """Move the cars, and the vehicle's shadow to where its position (3,), NED, m, throws it."""
        vehicle = np.asarray(ned_vehicle_m, dtype=float)
        height = max(-float(vehicle[2]), 0.0)
        shadow = vehicle[:2] + height * np.array(SHADOW_NE_PER_M)
        for index, pose in enumerate([car, *distractors]):
            self._put(index, pose.ned_p_m, pose.heading_rad)
        self._put(1 + len(distractors), (float(shadow[0]), float(shadow[1])), np.pi / 4)
        mujoco.mj_kinematics(self.model, self.data)

    def _put(self, mocap: int, ne_m: tuple[float, float], heading_rad: float) -> None:
        self.data.mocap_pos[mocap] = (ne_m[0], -ne_m[1], 0.0)
        self.data.mocap_quat[mocap] = (np.cos(heading_rad / 2), 0.0, 0.0, -np.sin(heading_rad / 2))

    def show_near(self, ned_m: ArrayLike, radius_m: float) -> None:
        """Keep only the props within a horizontal distance of a place (north, east, …), m: drawing the rest costs time.

        `occluded` knows only the props that are kept: take at least what the camera sees.
        """
        place = np.asarray(ned_m, dtype=float)[:2] * NWU_FROM_NED[:2]
        distance = np.hypot(*(self._prop_xy_m - place).T) - self._prop_reach_m
        self.model.geom_group[self._props] = np.where(distance < radius_m, _OCCLUDER_GROUP, _HIDDEN_GROUP)

    def outline(self, car: CarPose) -> Array:
        """Corners (4, 3), NED, m, of the chased car's outline as seen from above, at the height of its bonnet:
        front right, front left, rear left, rear right."""
        half_l, half_w = self.scenario.car.length_m / 2, self.scenario.car.width_m / 2
        corners = np.array([(half_l, half_w), (half_l, -half_w), (-half_l, -half_w), (-half_l, half_w)])
        return _car_to_ned(car, np.column_stack((corners, np.full(4, -CAR_BELT * self.scenario.car.height_m))))

    def samples(self, car: CarPose) -> Array:
        """Points (S, 3), NED, m, spread over the chased car's top, for `occluded`."""
        return _car_to_ned(car, self._samples_m)

    def occluded(self, ned_eye_m: ArrayLike, ned_points_m: Array) -> NDArray[np.bool_]:
        """Which of the points (S, 3), S as in `samples`, something hides from an eye (3,); all NED, m."""
        eye = np.asarray(ned_eye_m, dtype=float) * NWU_FROM_NED
        rays = ned_points_m * NWU_FROM_NED - eye
        lengths = np.linalg.norm(rays, axis=1)
        directions = rays / np.maximum(lengths, 1e-9)[:, None]
        mujoco.mj_multiRay(
            self.model,
            self.data,
            eye,
            np.ascontiguousarray(directions).ravel(),
            _ONLY_OCCLUDERS,
            True,
            -1,
            self._ray_geom,
            self._ray_m,
            None,
            len(rays),
            float(lengths.max()) + 1.0,
        )
        return (self._ray_geom >= 0) & (self._ray_m < lengths - 1e-3)


def _samples(car: CarConfig) -> Array:
    """Points of the car's top in its own frame (forward, right, down), (15, 3), m."""
    forward, right = np.meshgrid(np.linspace(-0.4, 0.4, 5), np.linspace(-0.4, 0.4, 3), indexing="ij")
    down = np.full(forward.size, -CAR_BELT * car.height_m)
    return np.column_stack((forward.ravel() * car.length_m, right.ravel() * car.width_m, down))


def _car_to_ned(car: CarPose, points_m: Array) -> Array:
    """Points (N, 3) of the car's frame (forward, right, down) in NED."""
    c, s = np.cos(car.heading_rad), np.sin(car.heading_rad)
    north = car.ned_p_m[0] + c * points_m[:, 0] - s * points_m[:, 1]
    east = car.ned_p_m[1] + s * points_m[:, 0] + c * points_m[:, 1]
    return np.column_stack((north, east, points_m[:, 2]))


class _Builder:
    """Writes the model's specification, part by part."""

    def __init__(self, scenario: ScenarioConfig, path: CarPath, width: int, height: int):
        self.spec = mujoco.MjSpec()
        self._rng = np.random.default_rng(scenario.seed)
        self._materials = 0
        quality = self.spec.visual.quality
        quality.offsamples, quality.shadowsize, quality.numslices, quality.numstacks, quality.numquads = 0, 0, 10, 6, 1
        self.spec.visual.global_.offwidth, self.spec.visual.global_.offheight = width, height
        self._light()
        layout = lay_out(scenario, path, self._rng)
        painter = GroundPainter(scenario.ground, layout, scenario.occluders, self._rng)
        self._ground(painter, scenario.ground.size_m)
        crowns = [self._material(leaves(self._rng, 384, colour)) for colour in _TREE_COLOURS]
        for tree in layout.trees:
            self._tree(tree, crowns[tree.shade])
        roofs = [self._material(roof_tiles(self._rng, 256, colour)) for colour in _ROOF_COLOURS]
        for house in layout.houses:
            self._house(house, roofs[house.shade])
        for occluder in scenario.occluders:
            if occluder.kind == "bridge":
                self._bridge(occluder)
        for car in (scenario.car, *scenario.distractors):
            self._car(car)
        self._vehicle_shadow()

    def _light(self) -> None:
        self.spec.visual.headlight.active = True
        self.spec.visual.headlight.ambient = [0.45, 0.46, 0.5]
        self.spec.visual.headlight.diffuse = [0.0, 0.0, 0.0]
        self.spec.visual.headlight.specular = [0.0, 0.0, 0.0]
        direction = [SHADOW_NE_PER_M[0], -SHADOW_NE_PER_M[1], -1.0]
        self.spec.worldbody.add_light(
            type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
            dir=direction,
            castshadow=False,
            diffuse=[0.64, 0.62, 0.57],
            specular=[0.15, 0.15, 0.15],
            ambient=[0, 0, 0],
        )

    def _material(
        self, picture: Picture, repeat: tuple[float, float] = (1.0, 1.0), uniform: bool = False, shine: float = 0.0
    ) -> str:
        """Name of a new material that shows a picture."""
        name = f"m{self._materials}"
        self._materials += 1
        texture = self.spec.add_texture(
            name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, width=picture.shape[1], height=picture.shape[0], nchannel=3
        )
        texture.data = picture.tobytes()
        material = self.spec.add_material(
            name=name, texrepeat=list(repeat), texuniform=uniform, specular=shine, shininess=0.6 if shine else 0.0
        )
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
        return name

    def _mesh(self, mesh: Mesh) -> str:
        name = f"g{len(self.spec.meshes)}"
        self.spec.add_mesh(
            name=name,
            uservert=mesh.vertices_m.ravel(),
            userface=mesh.faces.ravel(),
            usertexcoord=mesh.uv.ravel(),
            userfacetexcoord=mesh.faces.ravel(),
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
        )
        return name

    def _ground(self, painter: GroundPainter, size_m: float) -> None:
        picture = painter.paint()
        world = self.spec.worldbody
        world.add_geom(
            type=mujoco.mjtGeom.mjGEOM_PLANE,
            size=[size_m / 2, size_m / 2, 1],
            group=_GROUND_GROUP,
            material=self._material(picture),
            quat=_PLANE_QUAT,
        )
        world.add_geom(
            type=mujoco.mjtGeom.mjGEOM_PLANE,
            size=[_FIELD_M, _FIELD_M, 1],
            pos=[0, 0, -0.02],
            group=_GROUND_GROUP,
            material=self._material(painter.field_tile(), (0.14, 0.14), uniform=True),
        )

    def _tree(self, tree: Tree, material: str) -> None:
        n, e = tree.ne_m
        crown = self._mesh(crown_mesh(self._rng, tree.radius_m, 0.75))
        world = self.spec.worldbody
        world.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=crown,
            material=material,
            group=_OCCLUDER_GROUP,
            pos=[n, -e, tree.height_m],
        )
        world.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CYLINDER,
            size=[0.09 * max(tree.radius_m, 0.4), tree.height_m / 2, 0],
            pos=[tree.ne_trunk_m[0], -tree.ne_trunk_m[1], tree.height_m / 2],
            rgba=_BARK,
            group=_OCCLUDER_GROUP,
        )

    def _house(self, house: House, material: str) -> None:
        n, e = house.ne_m
        body = self.spec.worldbody.add_body(pos=[n, -e, 0], quat=_yaw_quat(house.heading_rad))
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[house.length_m / 2, house.width_m / 2, house.wall_m / 2],
            pos=[0, 0, house.wall_m / 2],
            rgba=_WALL,
            group=_OCCLUDER_GROUP,
        )
        roof = self._mesh(gable_mesh(house.length_m, house.width_m, house.rise_m))
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=roof,
            material=material,
            pos=[0, 0, house.wall_m],
            group=_OCCLUDER_GROUP,
        )
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[0.12, 0.12, 0.3],
            rgba=[0.55, 0.35, 0.3, 1],
            pos=[0.3 * house.length_m, 0.15, house.wall_m + house.rise_m],
            group=_OCCLUDER_GROUP,
        )

    def _bridge(self, bridge: OccluderConfig) -> None:
        body = self.spec.worldbody.add_body(
            pos=[bridge.north_m, -bridge.east_m, 0], quat=_yaw_quat(np.deg2rad(bridge.heading_deg))
        )
        half_l, half_w, top = bridge.span_m / 2, bridge.width_m / 2, bridge.height_m
        # Boards lie across the deck: the picture's boards run along its columns, which are the deck's y axis.
        wood = self._material(planks(self._rng, 512, (150, 112, 74), 24))
        box = mujoco.mjtGeom.mjGEOM_BOX
        body.add_geom(
            type=box, size=[half_l, half_w, 0.04], pos=[0, 0, top - 0.04], material=wood, group=_OCCLUDER_GROUP
        )
        for side in (-1, 1):
            body.add_geom(
                type=box,
                size=[half_l, 0.03, 0.03],
                pos=[0, side * (half_w - 0.03), top + 0.22],
                rgba=[0.36, 0.27, 0.19, 1],
                group=_OCCLUDER_GROUP,
            )
            for x in np.linspace(-half_l + 0.05, half_l - 0.05, 5):
                body.add_geom(
                    type=box,
                    size=[0.025, 0.025, 0.12],
                    pos=[x, side * (half_w - 0.03), top + 0.1],
                    rgba=[0.36, 0.27, 0.19, 1],
                    group=_OCCLUDER_GROUP,
                )
            body.add_geom(
                type=box,
                size=[0.12, half_w * 0.9, (top - 0.08) / 2],
                group=_OCCLUDER_GROUP,
                pos=[side * (half_l - 0.15), 0, (top - 0.08) / 2],
                rgba=[0.5, 0.49, 0.47, 1],
            )

    def _car(self, car: CarConfig) -> None:
        body = self.spec.worldbody.add_body(mocap=True)
        paint = car_paint(self._rng, rgb(car.bonnet), rgb(car.roof), rgb(car.boot), rgb(car.stripe))
        shell = self._mesh(car_mesh(car.length_m, car.width_m, car.height_m))
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=shell,
            material=self._material(paint, shine=0.3),
            group=_MOVING_GROUP,
        )
        wheel = 0.2 * car.height_m
        for x in (-0.3, 0.3):
            for y in (-1, 1):
                body.add_geom(
                    type=mujoco.mjtGeom.mjGEOM_BOX,
                    size=[wheel, 0.035 * car.width_m, wheel],
                    pos=[x * car.length_m, y * 0.475 * car.width_m, wheel],
                    rgba=[0.07, 0.07, 0.08, 1],
                    group=_MOVING_GROUP,
                )
        for grow, alpha in ((0.02, 0.22), (0.05, 0.16), (0.085, 0.12)):
            body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_BOX,
                pos=[0, 0, 0.002 + 0.02 * grow],
                rgba=[0, 0, 0, alpha],
                size=[car.length_m / 2 + grow, car.width_m / 2 + grow, 0.0004],
                group=_MOVING_GROUP,
            )

    def _vehicle_shadow(self) -> None:
        body = self.spec.worldbody.add_body(mocap=True)
        disc, box = mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_BOX
        dark = [0, 0, 0, 0.4]
        body.add_geom(type=disc, size=[0.09, 0.0004, 0], pos=[0, 0, 0.006], rgba=dark, group=_MOVING_GROUP)
        for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            body.add_geom(
                type=disc,
                size=[0.1, 0.0004, 0],
                pos=[0.25 * x, 0.25 * y, 0.006],
                rgba=[0, 0, 0, 0.28],
                group=_MOVING_GROUP,
            )
            body.add_geom(
                type=box,
                size=[0.03 if x else 0.012, 0.03 if y else 0.012, 0.0004],
                pos=[0.12 * x, 0.12 * y, 0.006],
                rgba=dark,
                group=_MOVING_GROUP,
            )


def _yaw_quat(heading_rad: float) -> list[float]:
    """Rotation in MuJoCo's frame of something that looks along a heading."""
    return [float(np.cos(heading_rad / 2)), 0.0, 0.0, float(-np.sin(heading_rad / 2))]
