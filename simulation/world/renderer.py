"""Headless colour and depth pictures of a scene, through a calibrated camera."""

from __future__ import annotations

from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.geometry.camera import Camera
from common.geometry.rotation import quat_multiply, quat_rotate, quat_to_matrix
from simulation.world.gl import mujoco, open_context
from simulation.world.scene import NWU_FROM_NED

Array = NDArray[np.float64]
_Edges = tuple[float, float, float, float]
_Map = tuple[NDArray[np.float32], NDArray[np.float32]]

_NEAR_M, _FAR_M = 0.1, 120.0
# MuJoCo draws the sky on a box well within the far plane, before the ground that is farther: with the sky that plane
# lies beyond all ground.
_SKY_M = 2.0 * _FAR_M
_MAX_GEOMS = 2000
# A corner of the picture that looks less steeply down than this sees to the horizon.
_FLAT = 0.05
_MARGIN_M = 1.0
_UNUSED = (
    mujoco.mjtRndFlag.mjRND_SHADOW,
    mujoco.mjtRndFlag.mjRND_REFLECTION,
    mujoco.mjtRndFlag.mjRND_FOG,
    mujoco.mjtRndFlag.mjRND_HAZE,
)
_SKY = mujoco.mjtRndFlag.mjRND_SKYBOX


class Drawable(Protocol):
    """What the renderer needs of a scene."""

    model: Any
    """The `mujoco.MjModel`."""
    data: Any
    """The `mujoco.MjData`, with the kinematics computed."""

    def show_near(self, ned_m: ArrayLike, radius_m: float) -> None:
        """Told before each picture: nothing farther from the camera than this, horizontally, is in view."""


class Canvas:
    """The OpenGL context that a scene is drawn in, with its textures. Belongs to the thread that made it.

    Args:
        scene: what will be drawn; its model says how large a picture may be (`offwidth`, `offheight`).

    Raises:
        GlMissingError: no headless OpenGL; the text names the packages.
    """

    def __init__(self, scene: Drawable):
        size = scene.model.vis.global_
        self.scene = scene
        self._context = open_context(size.offwidth, size.offheight)
        self.gl = mujoco.MjrContext(scene.model, mujoco.mjtFontScale.mjFONTSCALE_50.value)
        """MuJoCo's handle of it."""
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self.gl)

    def close(self) -> None:
        """Free the OpenGL context."""
        self.gl.free()
        self._context.free()


class Renderer:
    """Draws a scene as one camera sees it.

    Args:
        canvas: where to draw.
        camera: calibration; lens distortion is applied where there is any.
    """

    def __init__(self, canvas: Canvas, camera: Camera):
        self._scene, self._camera, self._gl = canvas.scene, camera, canvas.gl
        self._view = mujoco.MjvScene(self._scene.model, maxgeom=_MAX_GEOMS)
        for flag in _UNUSED:
            self._view.flags[flag] = 0
        self._option, self._untextured, self._free = mujoco.MjvOption(), mujoco.MjvOption(), mujoco.MjvCamera()
        self._untextured.flags[mujoco.mjtVisFlag.mjVIS_TEXTURE] = 0
        self._rect = mujoco.MjrRect(0, 0, camera.width, camera.height)
        self._rgb = np.empty((camera.height, camera.width, 3), np.uint8)
        self._z = np.empty((camera.height, camera.width), np.float32)
        self._frustum, self._remap = _frustum(camera)
        left, right, bottom, top = self._frustum
        self._corner_rays = np.array([(x, -y, 1.0) for x in (left, right) for y in (bottom, top)])

    def render(self, ned_p_camera_m: ArrayLike, ned_q_camera: ArrayLike) -> NDArray[np.uint8]:
        """Picture (height, width, 3), BGR, from a camera at a position (3,), NED, m, and an attitude (optical frame).

        The cars are where `Scene.place` put them last.
        """
        position, attitude = np.asarray(ned_p_camera_m, dtype=float), np.asarray(ned_q_camera, dtype=float)
        reach_m = self._reach(position, attitude)
        self._scene.show_near(position, reach_m)
        self._aim(position, attitude, self._option)
        self._show_sky(reach_m >= _FAR_M)  # where only ground is in view there is nothing to pay for
        mujoco.mjr_render(self._rect, self._view, self._gl)
        mujoco.mjr_readPixels(self._rgb, None, self._rect, self._gl)
        # OpenGL's rows run upwards.
        picture = cv2.flip(cv2.cvtColor(self._rgb, cv2.COLOR_RGB2BGR), 0)
        if self._remap is not None:
            picture = cv2.remap(picture, *self._remap, cv2.INTER_LINEAR)
        return picture.astype(np.uint8, copy=False)

    def depth(self, ned_p_camera_m: ArrayLike, ned_q_camera: ArrayLike, range_m: float) -> NDArray[np.float32]:
        """Depth (height, width), m along the optical axis, of the same view; NaN beyond a range, m.

        A pass of its own without textures: cheaper than reading it beside a larger colour picture.
        """
        position, attitude = np.asarray(ned_p_camera_m, dtype=float), np.asarray(ned_q_camera, dtype=float)
        farthest_m = range_m * float(np.linalg.norm(self._corner_rays, axis=1).max())
        self._scene.show_near(position, min(self._reach(position, attitude), farthest_m))
        self._aim(position, attitude, self._untextured)
        self._show_sky(False)
        mujoco.mjr_render(self._rect, self._view, self._gl)
        mujoco.mjr_readPixels(None, self._z, self._rect, self._gl)
        # The buffer holds d = f (z - n) / (z (f - n)), so z = n f / (f - d (f - n)); beyond the range it is cut off
        # before that division, where the buffer's steps are fine enough.
        n, f = _NEAR_M, _FAR_M
        within = self._z < f * (range_m - n) / (range_m * (f - n))
        depth = np.where(within, n * f / (f - self._z.astype(np.float64) * (f - n)), np.nan).astype(np.float32)
        depth = cv2.flip(depth, 0)
        if self._remap is not None:
            depth = cv2.remap(depth, *self._remap, cv2.INTER_NEAREST)
        return depth.astype(np.float32, copy=False)

    def bodies(self, ned_p_camera_m: ArrayLike, ned_q_camera: ArrayLike) -> NDArray[np.int32]:
        """What each pixel (height, width) of the same view shows: the number of the root body that it belongs to, 0 for
        the ground and everything else that is fixed to the world."""
        position, attitude = np.asarray(ned_p_camera_m, dtype=float), np.asarray(ned_q_camera, dtype=float)
        self._scene.show_near(position, self._reach(position, attitude))
        self._view.flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = self._view.flags[mujoco.mjtRndFlag.mjRND_IDCOLOR] = 1
        try:
            self._aim(position, attitude, self._untextured)
            mujoco.mjr_render(self._rect, self._view, self._gl)
        finally:
            self._view.flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = self._view.flags[mujoco.mjtRndFlag.mjRND_IDCOLOR] = 0
        mujoco.mjr_readPixels(self._rgb, None, self._rect, self._gl)
        # The colours count the drawn geoms from 1; 0 is where nothing was drawn.
        model, root_of = self._scene.model, np.zeros(self._view.ngeom + 1, np.int32)
        for geom in self._view.geoms[: self._view.ngeom]:
            if geom.segid >= 0 and geom.objtype == mujoco.mjtObj.mjOBJ_GEOM:
                root_of[geom.segid + 1] = model.body_rootid[model.geom_bodyid[geom.objid]]
        numbers = self._rgb.astype(np.int32) @ np.array([1, 256, 65536], np.int32)
        shown = cv2.flip(root_of[np.minimum(numbers, self._view.ngeom)], 0)
        if self._remap is not None:
            shown = cv2.remap(shown.astype(np.float32), *self._remap, cv2.INTER_NEAREST)
        return shown.astype(np.int32, copy=False)

    def _aim(self, ned_p_camera_m: Array, ned_q_camera: Array, option: Any) -> None:
        mujoco.mjv_updateScene(
            self._scene.model,
            self._scene.data,
            option,
            None,
            self._free,
            mujoco.mjtCatBit.mjCAT_ALL.value,
            self._view,
        )
        axes = quat_to_matrix(ned_q_camera)
        left, right, bottom, top = self._frustum
        for eye in self._view.camera:
            eye.pos = ned_p_camera_m * NWU_FROM_NED
            eye.forward = axes[:, 2] * NWU_FROM_NED
            eye.up = -axes[:, 1] * NWU_FROM_NED
            eye.orthographic = 0
            eye.frustum_near, eye.frustum_far = _NEAR_M, _FAR_M
            eye.frustum_center = _NEAR_M * (left + right) / 2
            eye.frustum_width = _NEAR_M * (right - left) / 2
            eye.frustum_bottom, eye.frustum_top = _NEAR_M * bottom, _NEAR_M * top

    def _show_sky(self, shown: bool) -> None:
        self._view.flags[_SKY] = shown
        if shown:
            for eye in self._view.camera:
                eye.frustum_far = _SKY_M

    def _reach(self, ned_p_camera_m: Array, ned_q_camera: Array) -> float:
        """Horizontal distance, m, up to which the ground is in view."""
        ned = self._corner_rays @ quat_to_matrix(ned_q_camera).T
        if (ned[:, 2] < _FLAT).any():
            return _FAR_M
        tangents = np.hypot(ned[:, 0], ned[:, 1]) / ned[:, 2]
        return float(max(-ned_p_camera_m[2], 0.0) * tangents.max()) + _MARGIN_M


def camera_pose(camera: Camera, ned_p_body_m: ArrayLike, ned_q_body: ArrayLike) -> tuple[Array, Array]:
    """Position (3,), NED, m, and attitude (4,) of a camera on a body at a pose."""
    position = np.asarray(ned_p_body_m, dtype=float) + quat_rotate(ned_q_body, camera.body_p_camera_m)
    return position, quat_multiply(ned_q_body, camera.body_q_camera)


def ned_to_pixels(camera: Camera, ned_p_camera_m: ArrayLike, ned_q_camera: ArrayLike, ned_points_m: ArrayLike) -> Array:
    """Pixels (N, 2) of points (N, 3), NED, m; NaN for those behind the camera."""
    offsets = np.asarray(ned_points_m, dtype=float) - np.asarray(ned_p_camera_m, dtype=float)
    return camera.project(offsets @ quat_to_matrix(ned_q_camera))


def _frustum(camera: Camera) -> tuple[_Edges, _Map | None]:
    """Edges of the pinhole picture as tangents (left, right, bottom, top), and the map from the real picture into it.

    A pixel's centre has whole coordinates (OpenCV), so the picture reaches from -0.5 to width - 0.5. The map is None
    for a lens without distortion: then the pinhole picture is the picture.
    """
    width, height = camera.width, camera.height
    if not any(camera.distortion):
        return (
            (-0.5 - camera.cx_px) / camera.fx_px,
            (width - 0.5 - camera.cx_px) / camera.fx_px,
            -(height - 0.5 - camera.cy_px) / camera.fy_px,
            (camera.cy_px + 0.5) / camera.fy_px,
        ), None
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    rays = camera.rays(np.column_stack((columns.ravel(), rows.ravel())))
    x, y = rays[:, 0], rays[:, 1]
    left, right, down, up = float(x.min()), float(x.max()), float(y.max()), float(y.min())
    u, v = (x - left) / (right - left) * width - 0.5, (y - up) / (down - up) * height - 0.5
    shape = (height, width)
    return (left, right, -down, -up), (u.reshape(shape).astype(np.float32), v.reshape(shape).astype(np.float32))
