"""Writes the specification of a scenario's MuJoCo model: light, ground, props, occluders, cars, objects.

MuJoCo's world frame here is north-west-up (x north, y west, z up).
"""

from __future__ import annotations

import numpy as np

from simulation.world.body_paint import paint
from simulation.world.debris import add_thing
from simulation.world.gl import mujoco
from simulation.world.ground import GroundPainter
from simulation.world.layout import SHADOW_NE_PER_M, House, Tree, lay_out
from simulation.world.meshes import Mesh, car_mesh, crown_mesh, gable_mesh
from simulation.world.objects import add_barrel, add_vehicle_point, add_wall, yaw_quat
from simulation.world.objects_config import rgb
from simulation.world.path import CarPath
from simulation.world.people import add_person, outfit_of
from simulation.world.scenario import CarConfig, OccluderConfig, ScenarioConfig
from simulation.world.textures import Picture, car_paint, leaves, planks, roof_tiles

GROUND_GROUP, OCCLUDER_GROUP, MOVING_GROUP, HIDDEN_GROUP = 0, 1, 2, 5
"""Groups of geoms: what lies, what stands and may hide the car, what moves, what is not drawn."""
_FIELD_M = 200.0
# On a plane MuJoCo runs a picture's columns along x and its rows against y; the painter's columns run east, its rows
# south: a quarter turn.
_PLANE_QUAT = [0.5**0.5, 0.0, 0.0, -(0.5**0.5)]
_TREE_COLOURS = ((74, 110, 40), (96, 122, 44), (58, 96, 52))
_ROOF_COLOURS = ((164, 84, 58), (112, 104, 104))
_ZENITH, _HORIZON, _SKY_PX = (0.36, 0.56, 0.83), (0.80, 0.87, 0.92), 128
_BARK, _WALL = (0.33, 0.26, 0.2, 1.0), (0.86, 0.83, 0.76, 1.0)


class SceneBuilder:
    """The model's specification, in `spec`, part by part.

    Args:
        scenario: what to build.
        path: way of the chased car, which the road follows.
        width: columns of the largest picture, px.
        height: rows of the largest picture, px.
    """

    def __init__(self, scenario: ScenarioConfig, path: CarPath, width: int, height: int):
        self.spec = mujoco.MjSpec()
        self._rng = np.random.default_rng(scenario.seed)
        self._materials = 0
        quality = self.spec.visual.quality
        quality.offsamples, quality.shadowsize, quality.numslices, quality.numstacks, quality.numquads = 0, 0, 10, 6, 1
        self.spec.visual.global_.offwidth, self.spec.visual.global_.offheight = width, height
        self._light()
        self._sky()
        layout = lay_out(scenario, path, self._rng)
        painter = GroundPainter(scenario.ground, layout, scenario.occluders, self._rng)
        self._ground(painter, scenario.ground.size_m)
        crowns = [self.material(leaves(self._rng, 384, colour)) for colour in _TREE_COLOURS]
        for tree in layout.trees:
            self._tree(tree, crowns[tree.shade])
        roofs = [self.material(roof_tiles(self._rng, 256, colour)) for colour in _ROOF_COLOURS]
        for house in layout.houses:
            self._house(house, roofs[house.shade])
        for occluder in scenario.occluders:
            if occluder.kind == "bridge":
                self._bridge(occluder)
        for car in (scenario.car, *scenario.distractors):
            self._car(car)
        self._vehicle_shadow()
        world = self.spec.worldbody
        for number, barrel in enumerate(scenario.barrels, 1):
            add_barrel(world, f"barrel {number}", barrel, OCCLUDER_GROUP)
        for number, wall in enumerate(scenario.walls, 1):
            add_wall(world, f"wall {number}", wall, OCCLUDER_GROUP)
        for number, thing in enumerate(scenario.things, 1):
            add_thing(self, f"thing {number}", thing, np.random.default_rng((scenario.seed, number, 6)), OCCLUDER_GROUP)
        for number, person in enumerate(scenario.people, 1):
            rng = np.random.default_rng((scenario.seed, number, 5))
            add_person(self, f"person {number}", person, self.material(paint(rng, outfit_of(person))), MOVING_GROUP)
        add_vehicle_point(world, HIDDEN_GROUP)

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

    def _sky(self) -> None:
        """What the cameras see where nothing stands: blue overhead, paling towards the horizon."""
        self.spec.add_texture(
            name="sky",
            type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
            builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
            rgb1=_ZENITH,
            rgb2=_HORIZON,
            width=_SKY_PX,
            height=6 * _SKY_PX,
        )

    def material(
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

    def mesh(self, mesh: Mesh) -> str:
        """Name of a new mesh."""
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
            group=GROUND_GROUP,
            material=self.material(picture),
            quat=_PLANE_QUAT,
        )
        world.add_geom(
            type=mujoco.mjtGeom.mjGEOM_PLANE,
            size=[_FIELD_M, _FIELD_M, 1],
            pos=[0, 0, -0.02],
            group=GROUND_GROUP,
            material=self.material(painter.field_tile(), (0.14, 0.14), uniform=True),
        )

    def _tree(self, tree: Tree, material: str) -> None:
        n, e = tree.ne_m
        crown = self.mesh(crown_mesh(self._rng, tree.radius_m, 0.75))
        world = self.spec.worldbody
        world.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=crown,
            material=material,
            group=OCCLUDER_GROUP,
            pos=[n, -e, tree.height_m],
        )
        world.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CYLINDER,
            size=[0.09 * max(tree.radius_m, 0.4), tree.height_m / 2, 0],
            pos=[tree.ne_trunk_m[0], -tree.ne_trunk_m[1], tree.height_m / 2],
            rgba=_BARK,
            group=OCCLUDER_GROUP,
        )

    def _house(self, house: House, material: str) -> None:
        n, e = house.ne_m
        body = self.spec.worldbody.add_body(pos=[n, -e, 0], quat=yaw_quat(house.heading_rad))
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[house.length_m / 2, house.width_m / 2, house.wall_m / 2],
            pos=[0, 0, house.wall_m / 2],
            rgba=_WALL,
            group=OCCLUDER_GROUP,
        )
        roof = self.mesh(gable_mesh(house.length_m, house.width_m, house.rise_m))
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=roof,
            material=material,
            pos=[0, 0, house.wall_m],
            group=OCCLUDER_GROUP,
        )
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[0.12, 0.12, 0.3],
            rgba=[0.55, 0.35, 0.3, 1],
            pos=[0.3 * house.length_m, 0.15, house.wall_m + house.rise_m],
            group=OCCLUDER_GROUP,
        )

    def _bridge(self, bridge: OccluderConfig) -> None:
        body = self.spec.worldbody.add_body(
            pos=[bridge.north_m, -bridge.east_m, 0], quat=yaw_quat(np.deg2rad(bridge.heading_deg))
        )
        half_l, half_w, top = bridge.span_m / 2, bridge.width_m / 2, bridge.height_m
        # Boards lie across the deck: the picture's boards run along its columns, which are the deck's y axis.
        wood = self.material(planks(self._rng, 512, (150, 112, 74), 24))
        box = mujoco.mjtGeom.mjGEOM_BOX
        body.add_geom(
            type=box, size=[half_l, half_w, 0.04], pos=[0, 0, top - 0.04], material=wood, group=OCCLUDER_GROUP
        )
        for side in (-1, 1):
            body.add_geom(
                type=box,
                size=[half_l, 0.03, 0.03],
                pos=[0, side * (half_w - 0.03), top + 0.22],
                rgba=[0.36, 0.27, 0.19, 1],
                group=OCCLUDER_GROUP,
            )
            for x in np.linspace(-half_l + 0.05, half_l - 0.05, 5):
                body.add_geom(
                    type=box,
                    size=[0.025, 0.025, 0.12],
                    pos=[x, side * (half_w - 0.03), top + 0.1],
                    rgba=[0.36, 0.27, 0.19, 1],
                    group=OCCLUDER_GROUP,
                )
            body.add_geom(
                type=box,
                size=[0.12, half_w * 0.9, (top - 0.08) / 2],
                group=OCCLUDER_GROUP,
                pos=[side * (half_l - 0.15), 0, (top - 0.08) / 2],
                rgba=[0.5, 0.49, 0.47, 1],
            )

    def _car(self, car: CarConfig) -> None:
        body = self.spec.worldbody.add_body(mocap=True)
        paint = car_paint(self._rng, rgb(car.bonnet), rgb(car.roof), rgb(car.boot), rgb(car.stripe))
        shell = self.mesh(car_mesh(car.length_m, car.width_m, car.height_m))
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=shell,
            material=self.material(paint, shine=0.3),
            group=MOVING_GROUP,
        )
        wheel = 0.2 * car.height_m
        for x in (-0.3, 0.3):
            for y in (-1, 1):
                body.add_geom(
                    type=mujoco.mjtGeom.mjGEOM_BOX,
                    size=[wheel, 0.035 * car.width_m, wheel],
                    pos=[x * car.length_m, y * 0.475 * car.width_m, wheel],
                    rgba=[0.07, 0.07, 0.08, 1],
                    group=MOVING_GROUP,
                )
        for grow, alpha in ((0.02, 0.22), (0.05, 0.16), (0.085, 0.12)):
            body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_BOX,
                pos=[0, 0, 0.002 + 0.02 * grow],
                rgba=[0, 0, 0, alpha],
                size=[car.length_m / 2 + grow, car.width_m / 2 + grow, 0.0004],
                group=MOVING_GROUP,
            )

    def _vehicle_shadow(self) -> None:
        body = self.spec.worldbody.add_body(mocap=True)
        disc, box = mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_BOX
        dark = [0, 0, 0, 0.4]
        body.add_geom(type=disc, size=[0.09, 0.0004, 0], pos=[0, 0, 0.006], rgba=dark, group=MOVING_GROUP)
        for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            body.add_geom(
                type=disc,
                size=[0.1, 0.0004, 0],
                pos=[0.25 * x, 0.25 * y, 0.006],
                rgba=[0, 0, 0, 0.28],
                group=MOVING_GROUP,
            )
            body.add_geom(
                type=box,
                size=[0.03 if x else 0.012, 0.03 if y else 0.012, 0.0004],
                pos=[0.12 * x, 0.12 * y, 0.006],
                rgba=dark,
                group=MOVING_GROUP,
            )
