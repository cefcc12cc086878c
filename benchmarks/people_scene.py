"""Depth pictures of people and things on a floor, ray by ray, with a range camera's faults and the truth beside them.

Bodies are capsules (a segment with a radius), things are capsules, spheres and boxes. This scene is for the stages that
need depth alone; it has no colour.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from common.geometry.camera import Camera
from onboard.people.depth import Floats, Ints, RayTable

Array = NDArray[np.float64]

KINECT_2 = Camera(
    512, 424, 365.0, 365.0, 255.5, 211.5, (0.0, 0.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
)
"""Intrinsics of a Kinect v2's depth camera, rounded, without distortion."""


@dataclass(frozen=True)
class Capsule:
    """All points within a radius of a segment; a sphere when its ends are the same."""

    start_m: Array
    """(3,) in the floor's frame: x, y along the floor, z up."""
    end_m: Array
    """(3,)."""
    radius_m: float
    """Of both ends."""


@dataclass(frozen=True)
class Box:
    """Axis-aligned in the floor's frame."""

    low_m: Array
    """(3,)."""
    high_m: Array
    """(3,)."""


@dataclass(frozen=True)
class Thing:
    """One object of the scene."""

    kind: str
    """`person`, or what else it is."""
    shapes: tuple[Capsule | Box, ...]
    """What it is made of."""


@dataclass(frozen=True)
class DepthScene:
    """A floor, things on it and a camera above."""

    things: tuple[Thing, ...]
    """What stands on the floor."""
    height_m: float
    """Of the camera above the floor along its normal."""
    tilt_rad: tuple[float, float] = (0.0, 0.0)
    """Turn of the floor about the picture's x and y axes."""
    camera: Camera = field(default_factory=lambda: KINECT_2)
    """The depth camera."""

    @property
    def camera_R_floor(self) -> Array:
        """(3, 3) turns floor axes (x, y along it, z up) into the optical frame."""
        a, b = self.tilt_rad
        level = np.diag([1.0, -1.0, -1.0])
        about_x = np.array([[1, 0, 0], [0, math.cos(a), -math.sin(a)], [0, math.sin(a), math.cos(a)]])
        about_y = np.array([[math.cos(b), 0, math.sin(b)], [0, 1, 0], [-math.sin(b), 0, math.cos(b)]])
        return about_y @ about_x @ level

    def render(self, rng: np.random.Generator | None = None) -> tuple[Floats, Ints]:
        """Depth (H, W), m, 0 where there is none, and the thing (H, W) that each pixel shows, -1 for the floor.

        Args:
            rng: of noise, holes and flying pixels; None for an ideal camera.
        """
        table = RayTable.of(self.camera).rays
        rays = np.concatenate((table, np.ones_like(table[..., :1])), axis=2) @ self.camera_R_floor
        origin = np.array([0.0, 0.0, self.height_m])
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = np.where(rays[..., 2] < 0, -origin[2] / rays[..., 2], np.inf)
        shown = np.full(depth.shape, -1, np.int32)
        for number, thing in enumerate(self.things):
            for shape in thing.shapes:
                window = self._window(shape)
                hit = _hit(origin, rays[window], shape)
                nearer = hit < depth[window]
                depth[window][nearer] = hit[nearer]
                shown[window][nearer] = number
        depth = np.where(np.isfinite(depth), depth, 0.0)
        if rng is not None:
            depth = _faults(depth, rng)
        return depth.astype(np.float32), shown

    def _window(self, shape: Capsule | Box) -> tuple[slice, slice]:
        """Rows and columns that a shape can touch."""
        if isinstance(shape, Capsule):
            corners = np.vstack([p + shape.radius_m * _CUBE for p in (shape.start_m, shape.end_m)])
        else:
            corners = np.where(_CUBE > 0, shape.high_m, shape.low_m)
        camera = (corners - [0.0, 0.0, self.height_m]) @ self.camera_R_floor.T
        pixels = self.camera.project(np.where(camera[:, 2:] > 0.05, camera, np.nan))
        if np.isnan(pixels).any():
            return slice(0, self.camera.height), slice(0, self.camera.width)
        low, high = np.floor(pixels.min(axis=0)).astype(int), np.ceil(pixels.max(axis=0)).astype(int) + 1
        clip = (self.camera.width, self.camera.height)
        low, high = np.clip(low, 0, clip), np.clip(high, 0, clip)
        return slice(low[1], high[1]), slice(low[0], high[0])


_CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)


def _hit(origin: Array, rays: Array, shape: Capsule | Box) -> Array:
    if isinstance(shape, Capsule):
        return _hit_capsule(origin, rays, shape)
    return _hit_box(origin, rays, shape)


def _hit_capsule(origin: Array, rays: Array, capsule: Capsule) -> Array:
    """Depth along the rays at which they enter, inf where they miss: the cylinder's wall, or one of its ends."""
    axis = capsule.end_m - capsule.start_m
    best = np.minimum(
        _hit_sphere(origin, rays, capsule.start_m, capsule.radius_m),
        _hit_sphere(origin, rays, capsule.end_m, capsule.radius_m),
    )
    length = float(np.linalg.norm(axis))
    if length < 1e-6:
        return best
    axis = axis / length
    offset = origin - capsule.start_m
    along_ray, along_offset = rays @ axis, float(offset @ axis)
    a = np.einsum("...i,...i", rays, rays) - along_ray**2
    b = rays @ offset - along_ray * along_offset
    c = float(offset @ offset) - along_offset**2 - capsule.radius_m**2
    depth = _nearer_root(a, b, c)
    place = along_offset + depth * along_ray
    return np.minimum(best, np.where((place >= 0) & (place <= length), depth, np.inf))


def _hit_sphere(origin: Array, rays: Array, centre: Array, radius: float) -> Array:
    offset = origin - centre
    return _nearer_root(np.einsum("...i,...i", rays, rays), rays @ offset, float(offset @ offset) - radius**2)


def _nearer_root(a: Array, b: Array, c: float) -> Array:
    """Smaller root of a t² + 2 b t + c, inf where there is none in front."""
    square = b * b - a * c
    with np.errstate(divide="ignore", invalid="ignore"):
        root = (-b - np.sqrt(square)) / a
    return np.where((square >= 0) & (root > 0), root, np.inf)


def _hit_box(origin: Array, rays: Array, box: Box) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        t0, t1 = (box.low_m - origin) / rays, (box.high_m - origin) / rays
    enter, leave = np.minimum(t0, t1).max(axis=-1), np.maximum(t0, t1).min(axis=-1)
    return np.where((enter <= leave) & (enter > 0), enter, np.inf)


def _faults(depth: Array, rng: np.random.Generator) -> Array:
    """Noise that grows with the range (Kinect v2: some mm at 2 m, 2 to 3 cm at 8 m), flying pixels, holes."""
    noisy = depth + rng.normal(size=depth.shape) * (0.002 + 0.0004 * depth**2)
    step = np.abs(np.diff(depth, axis=1, append=depth[:, -1:])) > 0.1
    flying = step & (rng.random(depth.shape) < 0.5)
    following = np.roll(depth, -1, axis=1)
    noisy = np.where(flying, depth + rng.random(depth.shape) * (following - depth), noisy)
    noisy[rng.random(depth.shape) < 0.01] = 0.0
    noisy[step & (rng.random(depth.shape) < 0.3)] = 0.0
    return noisy


def person(posture: str, x_m: float, y_m: float, yaw_rad: float, size_m: float = 1.75) -> Thing:
    """A body at a place.

    Args:
        posture: `lying`, `sitting`, `standing` or `jumping`.
        x_m: place on the floor.
        y_m: place on the floor.
        yaw_rad: where it faces, or where the head lies.
        size_m: body height.
    """
    forward, left, up = np.eye(3)
    # Joints in units of the body height: along the body (feet to head), across it, and out of the chest.
    if posture == "lying":
        along, across, out, base = forward, left, up, np.array([-0.5, 0.0, 0.065])
    else:
        along, across, out, base = up, left, forward, np.array([0.0, 0.0, 0.02 + (posture == "jumping") * 0.25])
    hip, neck = 0.5, 0.82
    segments = [((0.93, 0, 0), (0.93, 0, 0), 0.065)]  # head
    segments += [((hip, s * 0.04, 0), (neck - 0.04, s * 0.06, 0), 0.075) for s in (-1, 1)]  # torso
    if posture == "jumping":
        segments += [((neck - 0.02, s * 0.11, 0), (neck + 0.1, s * 0.3, 0), 0.027) for s in (-1, 1)]
    else:
        segments += [((neck - 0.02, s * 0.12, 0), (hip - 0.04, s * 0.17, 0.02), 0.027) for s in (-1, 1)]
    if posture == "sitting":
        segments = [(tuple(np.array(a) - (0.45, 0, 0)), tuple(np.array(b) - (0.45, 0, 0)), r) for a, b, r in segments]
        segments += [((0.06, s * 0.06, 0), (0.06, s * 0.08, 0.26), 0.05) for s in (-1, 1)]
        segments += [((0.06, s * 0.08, 0.26), (0.035, s * 0.08, 0.5), 0.035) for s in (-1, 1)]
    else:
        segments += [((hip, s * 0.055, 0), (0.27, s * 0.06, 0), 0.05) for s in (-1, 1)]
        segments += [((0.27, s * 0.06, 0), (0.03, s * 0.07, 0), 0.036) for s in (-1, 1)]
    turn = np.array([[math.cos(yaw_rad), -math.sin(yaw_rad), 0], [math.sin(yaw_rad), math.cos(yaw_rad), 0], [0, 0, 1]])
    place = np.array([x_m, y_m, 0.0])

    def at(joint: tuple[float, float, float]) -> Array:
        return place + turn @ (size_m * (base + joint[0] * along + joint[1] * across + joint[2] * out))

    return Thing("person", tuple(Capsule(at(a), at(b), size_m * r) for a, b, r in segments))


def barrel(x_m: float, y_m: float) -> Thing:
    """An oil barrel."""
    return Thing("barrel", (Capsule(np.array([x_m, y_m, 0.3]), np.array([x_m, y_m, 0.6]), 0.29),))


def rock(x_m: float, y_m: float, radius_m: float) -> Thing:
    """Half a ball."""
    return Thing("rock", (Capsule(np.array([x_m, y_m, 0.0]), np.array([x_m, y_m, 0.0]), radius_m),))


def wall(x_m: float, y_m: float, length_m: float, height_m: float) -> Thing:
    """A piece of wall along x."""
    low = np.array([x_m - length_m / 2, y_m - 0.15, 0.0])
    return Thing("wall", (Box(low, low + np.array([length_m, 0.3, height_m])),))


def crowd(rng: np.random.Generator, height_m: float, camera: Camera = KINECT_2) -> DepthScene:
    """Five people in various postures among barrels, rocks and a wall, none touching, on a tilted floor."""
    half = np.array([camera.width / camera.fx_px, camera.height / camera.fy_px]) / 2 * height_m
    places: list[Array] = []
    for _ in range(2000):
        place = rng.uniform(-0.85, 0.85, 2) * half
        if all(np.linalg.norm(place - other) > min(2.4, 0.45 * height_m) for other in places):
            places.append(place)
        if len(places) == 9:
            break
    postures = ("lying", "lying", "sitting", "standing", "jumping")
    things = [person(p, place[0], place[1], rng.uniform(-3.1, 3.1)) for p, place in zip(postures, places, strict=False)]
    rest = places[5:]
    makers = (
        lambda p: barrel(p[0], p[1]),
        lambda p: rock(p[0], p[1], 0.25),
        lambda p: barrel(p[0], p[1]),
        lambda p: wall(p[0], p[1], 1.2, 0.5),
    )
    things += [make(place) for make, place in zip(makers, rest, strict=False)]
    tilt = tuple(np.radians(rng.uniform(-9, 9, 2)))
    return DepthScene(tuple(things), height_m, (float(tilt[0]), float(tilt[1])), camera)
