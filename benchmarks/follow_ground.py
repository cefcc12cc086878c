"""A unicycle with a time-of-flight camera after a bin that is pulled along (Echeverri 2016, 3.6).

The course is as long as the thesis's, with a full occlusion, stretches in which the bin runs out of the sensor's range
of a metre, and moves to the side.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from benchmarks.follow_scene import Hall, Lens, Light, Shown, Thing, camera, hidden_share
from benchmarks.follow_score import Score, box_of
from benchmarks.follow_solids import bin_, pillar
from common.geometry.rotation import quat_from_euler
from common.tracking.base import Box, Tracker
from onboard.follow.robot import RobotFollower
from onboard.follow.unicycle import UnicycleConfig
from onboard.fusion.config import DepthConfig
from onboard.fusion.tracker import HabDfTracker

RATE_HZ = 30.0
_SIZE_PX, _FIELD_RAD = (320, 240), math.radians(60.0)
_EYE_M, _START_M = 0.35, 0.8
_RANGE_M, _FADE_M = 1.0, 0.06
_PATCH = 14
_WHEELS_S = 0.25
_SLIP, _SLIP_M_S, _SLIP_RAD_S = 0.03, 0.01, 0.02
"""Standard deviations of what the wheels tell: a share that stays, and noise, m/s and rad/s."""
_CRUISE_M_S, _DASH_M_S, _DASH_S = (0.32, 0.42), 0.9, 1.8
_LIGHTER = (0.6, 1.25)
_LIGHT_EVERY_M = (4.0, 12.0)


class Course:
    """Where the bin is at each frame, on a course of a given length with what is hard drawn along it.

    Args:
        seed: draws it.
        length_m: way of the bin, m.
    """

    def __init__(self, seed: int, length_m: float):
        rng = np.random.default_rng((seed, 79))
        self.hall = Hall((60.0, 60.0), seed, 3.0)
        self.solid = bin_(rng)
        self._trash = pillar(rng, 0.5, 1.0)
        dt = 1.0 / RATE_HZ
        place, course, speed = np.array([_START_M, 0.0]), 0.0, 0.0
        cruise, until_m, bend, left_rad, dash_s = 0.3, 1.0, 0.0, 0.0, 0.0
        places, courses, ways, travelled = [], [], [], 0.0
        while travelled < length_m:
            places.append(place.copy())
            courses.append(course)
            ways.append(travelled)
            if travelled >= until_m:
                until_m = travelled + rng.uniform(1.5, 4.0)
                corner = rng.random() < 0.4  # round which it goes as a robot does that it stands on; else a gentle bend
                bend = float(rng.choice((-0.9, 0.9)) if corner else rng.uniform(-0.35, 0.35))
                left_rad = float(rng.uniform(0.7, 1.6) if corner else rng.uniform(0.2, 1.0))
                cruise = rng.uniform(*_CRUISE_M_S)
                dash_s = _DASH_S if rng.random() < 0.4 else 0.0  # runs ahead, beyond the sensor's range
            dash_s -= dt
            wanted = _DASH_M_S if dash_s > 0.0 else cruise
            speed += float(np.clip(wanted - speed, -0.6 * dt, 0.6 * dt))
            left_rad -= abs(bend) * dt
            course += bend * dt if left_rad > 0.0 else 0.0
            place = place + speed * dt * np.array([math.cos(course), math.sin(course)])
            travelled += speed * dt
        self.places, self.courses = np.array(places), np.array(courses)
        self.frames = len(places)
        self._gains = _light(rng, np.array(ways))
        count = max(1, int(length_m / 20.0))
        begin = rng.uniform(0.25, 0.75, count) + np.arange(count)
        self._hidden_from = (begin / count * self.frames).astype(int)

    def things(self, index: int, eye: np.ndarray) -> tuple[Thing, list[Thing]]:
        """The bin, and the trash bin that is pushed between at times, seen from a place (3,)."""
        target = Thing(self.solid, np.array([*self.places[index], 0.0]), math.pi + float(self.courses[index]))
        others = []
        for first in self._hidden_from:
            share = (index - first) / (2.2 * RATE_HZ)
            if 0.0 <= share < 1.0:
                towards = (target.ned_p_m - eye) * np.array([1.0, 1.0, 0.0])
                across = np.array([-towards[1], towards[0], 0.0]) / max(float(np.linalg.norm(towards)), 1e-6)
                between = eye * np.array([1.0, 1.0, 0.0]) + 0.6 * towards
                others.append(Thing(self._trash, between + across * 0.9 * (2 * share - 1)))
        return target, others

    def light(self, index: int, turn_rad_s: float) -> Light:
        """Of a frame, with the camera's turn rate, rad/s."""
        gain = float(self._gains[index])
        return Light((gain, gain, gain), turn_rad_s)


def _light(rng: np.random.Generator, way_m: np.ndarray) -> np.ndarray:
    """Gain of the light at each place of a way (n,), m: lamps, windows and dark corners (figure 3.5)."""
    at, gain = [0.0, 2.0], [1.0, 1.0]
    while at[-1] < way_m[-1]:
        at.append(at[-1] + float(rng.uniform(*_LIGHT_EVERY_M)))
        gain.append(float(rng.uniform(*_LIGHTER)))
    return np.interp(way_m, at, gain)


def depth_patch(rng: np.random.Generator, lens: Lens, box: Box, things: list[tuple[Thing, Shown]]) -> np.ndarray:
    """Depth that the sensor reads inside a box, (14, 14), m, 0 for none: false ones beyond its range (3.4)."""
    u = box[0] + box[2] * (np.arange(_PATCH) + 0.5) / _PATCH
    v = box[1] + box[3] * (np.arange(_PATCH) + 0.5) / _PATCH
    depth = np.full((_PATCH, _PATCH), 6.0)
    for _, shown in sorted(things, key=lambda pair: -pair[1].depth_m):
        x, y, width, height = shown.box
        inside = ((u > x) & (u < x + width))[None, :] & ((v > y) & (v < y + height))[:, None]
        depth[inside] = shown.depth_m
    rows = (v[:, None] - lens.camera.cy_px) / lens.camera.fy_px
    floor = np.where(rows > 0.02, _EYE_M / np.maximum(rows, 0.02), 6.0)
    depth = np.minimum(depth, np.broadcast_to(floor, depth.shape))
    noise = 0.01 + 0.04 * np.minimum(depth / _RANGE_M, 2.0) ** 4
    read = depth + noise * rng.standard_normal(depth.shape)
    far = np.clip((depth - _RANGE_M) / (_FADE_M / 2), -40.0, 40.0)
    valid = rng.random(depth.shape) < 0.03 + 0.93 / (1.0 + np.exp(far))
    false = rng.random(depth.shape) < 0.5 / (1.0 + np.exp(-far))
    read = np.where(false, rng.uniform(0.3, 1.2, depth.shape), read)
    return np.where(valid, np.maximum(read, 0.05), 0.0)


@dataclass(frozen=True)
class Driven:
    """One run."""

    score: Score
    """Of the pictures."""
    distance_error_m: float
    """Mean of the true distance less the set-point, as an absolute value, m."""
    estimate_error_m: float
    """The same of the fused distance less the true one, m."""
    beyond: float
    """Share of the frames in which the bin is beyond the sensor's range."""
    travelled_m: float
    """Way of the robot, m."""


def follow(course: Course, tracker: Tracker, seed: int) -> Driven:
    """Follow until the bin is lost, or to the end; each command reaches the wheels a picture later."""
    cv2.setNumThreads(1)
    rng = np.random.default_rng((seed, 80))
    eye = camera(*_SIZE_PX, _FIELD_RAD, RATE_HZ)
    score = Score(eye, RATE_HZ)
    robot = RobotFollower(UnicycleConfig(), DepthConfig(), eye)
    place, yaw, speed, turn = np.zeros(2), 0.0, 0.0, 0.0
    asked, dt, travelled = (0.0, 0.0), 1.0 / RATE_HZ, 0.0
    errors, estimates = [], []
    share = -math.expm1(-dt / _WHEELS_S)
    slip, slips = 1.0 + _SLIP * rng.standard_normal(2), np.array([_SLIP_M_S, _SLIP_RAD_S])
    for index in range(course.frames):
        t_ns = round(index * 1e9 / RATE_HZ)
        lens = Lens(eye, np.array([*place, -_EYE_M]), quat_from_euler(0.0, 0.0, yaw))
        target, others = course.things(index, lens.ned_p_m)
        frame = course.hall.picture(lens, [target, *others], course.light(index, turn))
        truth = lens.show(target)
        told = np.array([speed, turn]) * slip + slips * rng.standard_normal(2)
        robot.roll(t_ns, *told.tolist())
        if index == 0 and truth is not None:
            tracker.init(frame, truth.box, 0.0, t_ns)
            box: Box | None = truth.box
        else:
            if isinstance(tracker, HabDfTracker):
                tracker.foresee(robot.expected())
            box = box_of(tracker.update(frame, t_ns))
        patch = None
        if box is not None:
            shown = [(t, s) for t in (target, *others) if (s := lens.show(t)) is not None]
            patch = depth_patch(rng, lens, box, shown)
        drive = robot.step(box, patch)
        if box is not None and truth is not None:
            estimates.append(abs(robot.distance_m - truth.depth_m))
        speed += share * (asked[0] - speed)
        turn += share * (asked[1] - turn)
        yaw += turn * dt
        place = place + speed * dt * np.array([math.cos(yaw), math.sin(yaw)])
        travelled += abs(speed) * dt
        asked = drive.speed_m_s, drive.turn_rad_s
        errors.append(float(np.linalg.norm(target.ned_p_m[:2] - place)) - _START_M)
        score.note(None if truth is None else truth.box, hidden_share(lens, target, others), box)
        if score.lost:
            break
    away = np.array(errors)
    return Driven(
        score,
        float(np.abs(away).mean()),
        float(np.mean(estimates)) if estimates else math.nan,
        float((away + _START_M > _RANGE_M).mean()),
        travelled,
    )
