"""The 3-D view: vehicle, flown path, home, what the camera sees, target, commanded velocity, obstacles, ring.

The scene's frame is NED itself (x north, y east, z down), with up set to -z.
"""

from __future__ import annotations

import math
from collections import deque

import cv2
import numpy as np
import viser

from common.geometry.camera import Camera
from common.geometry.rotation import Array, euler_from_quat
from common.messages import VehicleState
from ground.console.collector import Collector
from ground.console.config import ConsoleConfig
from ground.console.overlay import BLUE, GREEN, ORANGE, RED, decode
from ground.console.people_map import PeopleMap
from ground.console.ring import Ring
from ground.console.snapshot import APPROACH, LIMITER, PURSUIT_CAMERA, SETPOINT, STATE, Snapshot
from ground.console.target import aimed_at, ground_point_m

_PERIOD_NS = 100_000_000
_SLOW_PERIOD_NS = 500_000_000
_TRAIL_STEP_NS = 250_000_000
_TRAIL_STEP_M = 0.05
_GREY = (139, 148, 158)
_PALE = (200, 208, 216)


class Trail:
    """Points that something passed through, over the last seconds.

    Args:
        span_s: how far back, s.
    """

    def __init__(self, span_s: float):
        self._span_ns = round(span_s * 1e9)
        self._points: deque[tuple[int, Array]] = deque()

    def add(self, t_ns: int, point_m: Array) -> None:
        """Note a point (3,), unless it is near the last one in time and place."""
        while self._points and self._points[0][0] < t_ns - self._span_ns:
            self._points.popleft()
        if self._points:
            last_ns, last = self._points[-1]
            if t_ns - last_ns < _TRAIL_STEP_NS or float(np.linalg.norm(point_m - last)) < _TRAIL_STEP_M:
                return
        self._points.append((t_ns, point_m))

    def segments(self) -> Array:
        """Line segments (N, 2, 3) between the points, m; at least one, of no length when there is no path yet."""
        points = np.array([point for _, point in self._points], dtype=float).reshape(-1, 3)
        if len(points) < 2:
            point = points[0] if len(points) else np.zeros(3)
            return np.array([[point, point]])
        return np.stack((points[:-1], points[1:]), axis=1)


class SceneView:
    """The scene, shared by all browsers that look at it.

    Args:
        server: where it is built.
        config: span of the paths.
    """

    def __init__(self, server: viser.ViserServer, config: ConsoleConfig):
        self._server = server
        self._path = Trail(config.trail_s)
        self._target_path = Trail(config.trail_s)
        self._frustum: tuple[Camera, viser.CameraFrustumHandle] | None = None
        self._due_ns = 0
        self._slow_due_ns = 0
        scene = server.scene
        scene.set_up_direction("-z")
        scene.configure_default_lights(cast_shadow=False)  # a tablet has better things to do
        server.initial_camera.position = (-9.0, -5.0, -8.0)
        server.initial_camera.look_at = (0.0, 0.0, -1.5)
        scene.add_grid(
            "/ground",
            60.0,
            60.0,
            plane="xy",
            cell_size=1.0,
            section_size=5.0,
            cell_color=(54, 61, 70),
            section_color=(92, 102, 114),
            infinite_grid=True,
            fade_distance=60.0,
        )
        scene.add_cylinder("/home", 0.45, 0.02, GREEN, opacity=0.8, cast_shadow=False)
        scene.add_label("/home/name", "home", position=(0.6, 0.0, 0.0))
        scene.add_arrows(
            "/north",
            np.array([[[0.0, 0.0, 0.0], [1.5, 0.0, 0.0]]]),
            RED,
            shaft_radius=0.025,
            head_radius=0.08,
            head_length=0.2,
        )
        scene.add_label("/north/name", "N", position=(1.7, 0.0, 0.0))
        self._vehicle = scene.add_frame("/vehicle", axes_length=0.8, axes_radius=0.02, visible=False)
        _add_airframe(scene)
        start = np.zeros((1, 2, 3))
        self._path_lines = scene.add_line_segments("/path", start, BLUE, thickness=2.5, thickness_units="screen")
        self._target_lines = scene.add_line_segments(
            "/target_path", start, ORANGE, thickness=2.0, thickness_units="screen"
        )
        self._target = scene.add_icosphere("/target", 0.18, GREEN, visible=False)
        self._target_name = scene.add_label("/target/name", "target", position=(0.0, 0.3, 0.0), visible=False)
        self._ray = scene.add_line_segments(
            "/ray", start, GREEN, thickness=1.5, thickness_units="screen", visible=False
        )
        self._velocity = scene.add_arrows(
            "/velocity",
            np.array([[[0.0, 0, 0], [0.01, 0, 0]]] * 2),
            np.array([_GREY, BLUE]),
            shaft_radius=0.03,
            head_radius=0.08,
            head_length=0.18,
            visible=False,
        )
        self._obstacles = scene.add_point_cloud(
            "/obstacles", np.zeros((1, 3)), RED, point_size=0.25, point_shape="circle", visible=False
        )

        self._ring = Ring(scene)
        self._people = PeopleMap(scene)
        self._goal = scene.add_icosphere("/approach", 0.16, BLUE, visible=False)
        self._goal_name = scene.add_label("/approach/name", "", position=(0.0, 0.0, -0.4), visible=False)

    def note(self, view: Snapshot, collector: Collector) -> None:
        """Remember the paths; cheap, runs whether anyone looks or not."""
        if view.state is not None and view.fresh(STATE):
            self._path.add(view.t_ns, np.asarray(view.state.ned_p_m, dtype=float))
        aim, point = aimed_at(view), self._target_point(view, collector)
        if aim is not None and point is not None and aim.track.state == "tracking":
            self._target_path.add(view.t_ns, point)

    def update(self, view: Snapshot, collector: Collector) -> None:
        """Bring the scene up to date, ten times a second, paths and picture twice."""
        if view.t_ns < self._due_ns:
            return
        self._due_ns = view.t_ns + _PERIOD_NS
        with self._server.atomic():
            state = view.state if view.fresh(STATE) else None
            self._vehicle.visible = state is not None
            if state is not None:
                self._vehicle.position = state.ned_p_m
                self._vehicle.wxyz = state.ned_q_body
            self._update_target(view, collector)
            self._update_velocity(view, state)
            self._update_obstacles(view, state)
            self._ring.update(view.limiter if view.fresh(LIMITER) else None, state.ned_p_m if state else None)
            self._update_approach(view)
            self._people.update(view)
            if view.t_ns >= self._slow_due_ns:
                self._slow_due_ns = view.t_ns + _SLOW_PERIOD_NS
                self._path_lines.points = self._path.segments().astype(np.float32)
                self._target_lines.points = self._target_path.segments().astype(np.float32)
                self._update_frustum(view)

    def look_from_behind(self, client: viser.ClientHandle, view: Snapshot | None) -> None:
        """Place a browser's viewpoint behind and above the vehicle."""
        if view is None or view.state is None:
            return
        north, east, down = view.state.ned_p_m
        yaw = euler_from_quat(view.state.ned_q_body)[2]
        with client.atomic():
            client.camera.position = (
                north - 6.0 * math.cos(yaw) + 3.5 * math.sin(yaw),
                east - 6.0 * math.sin(yaw) - 3.5 * math.cos(yaw),
                down - 3.5,
            )
            client.camera.look_at = (north, east, down * 0.6)

    def _target_point(self, view: Snapshot, collector: Collector) -> Array | None:
        camera, aim = view.cameras.get(PURSUIT_CAMERA), aimed_at(view)
        if aim is None or camera is None:
            return None
        state = collector.state_at(aim.capture_ns)
        return None if state is None else ground_point_m(aim.track, camera, state)

    def _update_target(self, view: Snapshot, collector: Collector) -> None:
        aim, point = aimed_at(view), self._target_point(view, collector)
        shown = point is not None and view.state is not None
        self._target.visible = self._target_name.visible = self._ray.visible = shown
        if aim is None or point is None or view.state is None:
            return
        colour = aim.seen_colour if aim.track.state == "tracking" else ORANGE
        self._target.position = point
        self._target.color = colour
        self._target_name.text = f"{aim.word} ({aim.track.state})"
        self._ray.points = np.array([[view.state.ned_p_m, point]], dtype=np.float32)

    def _update_velocity(self, view: Snapshot, state: VehicleState | None) -> None:
        setpoint = view.setpoint if view.fresh(SETPOINT) else None
        self._velocity.visible = setpoint is not None and state is not None
        if setpoint is None or state is None:
            return
        start = np.asarray(state.ned_p_m, dtype=float)
        # An arrow of no length has no direction to be drawn in.
        ends = [start + np.asarray(v) + (0.0, 0.0, 0.001) for v in (setpoint.asked_ned_v_m_s, setpoint.ned_v_m_s)]
        self._velocity.points = np.array([[start, end] for end in ends], dtype=np.float32)

    def _update_obstacles(self, view: Snapshot, state: VehicleState | None) -> None:
        self._obstacles.visible = bool(view.obstacles) and state is not None
        if not view.obstacles or state is None:
            return
        centre = np.asarray(state.ned_p_m, dtype=float)
        points = np.array([centre + o.distance_m * np.asarray(o.ned_direction) for o in view.obstacles])
        self._obstacles.points = points.astype(np.float32)
        self._obstacles.colors = np.tile(np.array(RED, np.uint8), (len(points), 1))

    def _update_approach(self, view: Snapshot) -> None:
        target = view.approach if view.fresh(APPROACH) else None
        shown = target is not None and target.state != "idle"
        self._goal.visible = self._goal_name.visible = shown
        if target is None or not shown:
            return
        self._goal.position = target.ned_p_m
        self._goal.color = BLUE if target.state == "tracking" else ORANGE
        word = "" if target.state == "tracking" else f" ({target.state})"
        self._goal_name.text = f"approach: {target.label or 'selected'}{word}"

    def _update_frustum(self, view: Snapshot) -> None:
        camera = view.camera
        if camera is None:
            return
        if self._frustum is None or self._frustum[0] != camera:
            handle = self._server.scene.add_camera_frustum(
                "/vehicle/camera",
                2 * math.atan(camera.height / (2 * camera.fy_px)),
                camera.width / camera.height,
                scale=0.8,
                thickness=1.5,
                thickness_units="screen",
                color=_PALE,
                wxyz=camera.body_q_camera,
                position=camera.body_p_camera_m,
                cast_shadow=False,
            )
            self._frustum = (camera, handle)  # the new one has taken the old one's name, and so its place
        pixels = decode(view.picture.jpeg) if view.picture is not None and view.picture_live else None
        self._frustum[1].image = None if pixels is None else np.asarray(cv2.resize(pixels, (240, 180)), np.uint8)


def _add_airframe(scene: viser.SceneApi) -> None:
    """A cross of two arms with four discs; the front ones are orange."""
    scene.add_box("/vehicle/hub", _PALE, (0.22, 0.16, 0.09))
    for name, forward, right in (("a", 0.24, 0.24), ("b", 0.24, -0.24), ("c", -0.24, 0.24), ("d", -0.24, -0.24)):
        angle = math.atan2(right, forward)
        scene.add_box(
            f"/vehicle/arm_{name}",
            _GREY,
            (0.36, 0.03, 0.03),
            position=(forward / 2, right / 2, 0.0),
            wxyz=(math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2)),
        )
        scene.add_cylinder(
            f"/vehicle/rotor_{name}",
            0.15,
            0.015,
            ORANGE if forward > 0 else _GREY,
            opacity=0.75,
            position=(forward, right, -0.04),
            cast_shadow=False,
        )
