"""The simulated world as a MuJoCo model: where everything is, what hides the chased car, how near things are.

MuJoCo's world frame here is north-west-up (x north, y west, z up); NED turns into it by (n, e, d) -> (n, -e, -d).
Cars, people and the vehicle's shadow are moved by placing them: nothing is simulated dynamically.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.geometry.rotation import as_vec3
from common.messages import Vec3
from common.truth import TruthObstacle
from simulation.world.builder import HIDDEN_GROUP, OCCLUDER_GROUP, SceneBuilder
from simulation.world.gl import mujoco
from simulation.world.layout import SHADOW_NE_PER_M
from simulation.world.meshes import CAR_BELT
from simulation.world.objects import VEHICLE_POINT, StandingObject, standing_objects
from simulation.world.path import CarPath, car_path
from simulation.world.people import Person
from simulation.world.scenario import CarConfig, ScenarioConfig

Array = NDArray[np.float64]

NWU_FROM_NED = np.array([1.0, -1.0, -1.0])
"""Factors that turn a NED vector into MuJoCo's frame, and back."""
_ONLY_OCCLUDERS = np.array([0, 1, 0, 0, 0, 0], np.uint8)


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
        self.model = SceneBuilder(scenario, self.path, width, height).spec.compile()
        self.data = mujoco.MjData(self.model)
        self.people = tuple(Person(self.model, f"person {i}", p) for i, p in enumerate(scenario.people, 1))
        """The people, in the scenario's order."""
        self._objects = standing_objects(self.model, scenario)
        self._props = np.flatnonzero(self.model.geom_group == OCCLUDER_GROUP)
        self._samples_m = _samples(scenario.car)
        self._ray_geom, self._ray_m = np.zeros(len(self._samples_m), np.int32), np.zeros(len(self._samples_m))
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)
        self._prop_xy_m = self.data.geom_xpos[self._props, :2].copy()
        self._prop_reach_m = self.model.geom_rbound[self._props]
        self._vehicle_point = self.data.mocap_pos[self.model.body(VEHICLE_POINT).mocapid[0]]

    def place(self, car: CarPose, distractors: list[CarPose], ned_vehicle_m: ArrayLike, walked_s: float = -1.0) -> None:
        """Move the cars, the vehicle's shadow to where its position (3,), NED, m, throws it, and the people to where
        they are at a time since they set off, s."""
        vehicle = np.asarray(ned_vehicle_m, dtype=float)
        height = max(-float(vehicle[2]), 0.0)
        shadow = vehicle[:2] + height * np.array(SHADOW_NE_PER_M)
        for index, pose in enumerate([car, *distractors]):
            self._put(index, pose.ned_p_m, pose.heading_rad)
        self._put(1 + len(distractors), (float(shadow[0]), float(shadow[1])), np.pi / 4)
        for person in self.people:
            person.place(self.data, walked_s)
        self._vehicle_point[:] = vehicle * NWU_FROM_NED
        mujoco.mj_kinematics(self.model, self.data)

    def _put(self, mocap: int, ne_m: tuple[float, float], heading_rad: float) -> None:
        self.data.mocap_pos[mocap] = (ne_m[0], -ne_m[1], 0.0)
        self.data.mocap_quat[mocap] = (np.cos(heading_rad / 2), 0.0, 0.0, -np.sin(heading_rad / 2))

    def obstacles(self, walked_s: float) -> tuple[TruthObstacle, ...]:
        """Every barrel, wall, thing and person, and how near its surface is to the vehicle, as they were placed last.

        Args:
            walked_s: time since the people set off, s, for their velocity.
        """
        velocities = {person.label: person.ned_v_m_s(walked_s) for person in self.people}
        return tuple(
            self._truth(obstacle, velocities.get(obstacle.label, (0.0, 0.0, 0.0))) for obstacle in self._objects
        )

    def _truth(self, obstacle: StandingObject, ned_v_m_s: Vec3) -> TruthObstacle:
        distance_m, nearest = obstacle.nearest(self.model, self.data)
        return TruthObstacle(
            label=obstacle.label,
            ned_p_m=as_vec3(self.data.xipos[obstacle.body] * NWU_FROM_NED),
            ned_v_m_s=ned_v_m_s,
            distance_m=distance_m,
            ned_nearest_m=as_vec3(nearest * NWU_FROM_NED),
        )

    def show_near(self, ned_m: ArrayLike, radius_m: float) -> None:
        """Keep only the props within a horizontal distance of a place (north, east, …), m: drawing the rest costs time.

        `occluded` knows only the props that are kept: take at least what the camera sees.
        """
        place = np.asarray(ned_m, dtype=float)[:2] * NWU_FROM_NED[:2]
        distance = np.hypot(*(self._prop_xy_m - place).T) - self._prop_reach_m
        self.model.geom_group[self._props] = np.where(distance < radius_m, OCCLUDER_GROUP, HIDDEN_GROUP)

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
