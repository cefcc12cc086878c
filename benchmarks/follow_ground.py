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
from benchmarks.tof_sensor import RANGE_M, read_depths
from common.geometry.rotation import quat_from_euler
from common.tracking.base import Box, Tracker
from onboard.follow.robot import RobotFollower
from onboard.follow.unicycle import UnicycleConfig
from onboard.fusion.config import DepthConfig
from onboard.fusion.tracker import HabDfTracker

RATE_HZ = 30.0
_SIZE_PX, _FIELD_RAD = (320, 240), math.radians(60.0)
_EYE_M, _START_M = 0.35, 0.8
"""Height of the camera, and distance of the bin at the start, m."""
_PATCH, _FAR_M = 14, 6.0
"""Side of the depth picture inside a box, and depth of what lies behind everything, m."""
_WHEELS_S = 0.25
"""Lag of the wheels behind what is asked, s."""
_SLIP, _SLIP_M_S, _SLIP_RAD_S = 0.03, 0.01, 0.02
"""Standard deviations of what the wheels tell: a share that stays, and noise, m/s and rad/s."""
_CRUISE_M_S, _DASH_M_S, _DASH_S = (0.32, 0.42), 0.9, 1.8
"""Speed of the bin, and for how long and how fast it runs ahead at times."""
_HIDDEN_EVERY_M, _HIDING_S = 20.0, 2.2
"""Way on which something is pushed between once, m, and how long that takes, s."""
_LIGHTER, _LIGHT_EVERY_M = (0.6, 1.25), (4.0, 12.0)
"""Light against that of the first picture, and ways on which it goes over to another, m."""


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
        count = max(1, int(length_m / _HIDDEN_EVERY_M))
        begin = rng.uniform(0.25, 0.75, count) + np.arange(count)
        self._hidden_from = (begin / count * self.frames).astype(int)

    def things(self, index: int, eye: np.ndarray) -> tuple[Thing, list[Thing]]:
        """The bin, and the trash bin that is pushed between at times, seen from a place (3,)."""
        target = Thing(self.solid, np.array([*self.places[index], 0.0]), math.pi + float(self.courses[index]))
        others = []
        for first in self._hidden_from:
            share = (index - first) / (_HIDING_S * RATE_HZ)
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
    depth = np.full((_PATCH, _PATCH), _FAR_M)
    for _, shown in sorted(things, key=lambda pair: -pair[1].depth_m):
        x, y, width, height = shown.box
        inside = ((u > x) & (u < x + width))[None, :] & ((v > y) & (v < y + height))[:, None]
        depth[inside] = shown.depth_m
    rows = (v[:, None] - lens.camera.cy_px) / lens.camera.fy_px
    floor = np.where(rows > 0.02, _EYE_M / np.maximum(rows, 0.02), _FAR_M)
    depth = np.minimum(depth, np.broadcast_to(floor, depth.shape))
    return read_depths(rng, depth)


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


class _Wheels:
    """The robot that rolls on them, and what they tell of it.

    Args:
        rng: draws by how much they slip.
    """

    def __init__(self, rng: np.random.Generator):
        self.place, self.yaw_rad, self.turn_rad_s = np.zeros(2), 0.0, 0.0
        """Where it is over ground, (2,), m, where it looks, and how fast that turns."""
        self.travelled_m = 0.0
        """Its way so far, m."""
        self._rng, self._speed_m_s = rng, 0.0
        self._slip = 1.0 + _SLIP * rng.standard_normal(2)

    def told(self) -> tuple[float, float]:
        """Speed, m/s, and turn, rad/s, by their own word."""
        noise = np.array([_SLIP_M_S, _SLIP_RAD_S]) * self._rng.standard_normal(2)
        speed_m_s, turn_rad_s = (np.array([self._speed_m_s, self.turn_rad_s]) * self._slip + noise).tolist()
        return speed_m_s, turn_rad_s

    def roll(self, asked: tuple[float, float], dt_s: float) -> None:
        """Follow a speed, m/s, and a turn, rad/s, for a time, s."""
        share = -math.expm1(-dt_s / _WHEELS_S)
        self._speed_m_s += share * (asked[0] - self._speed_m_s)
        self.turn_rad_s += share * (asked[1] - self.turn_rad_s)
        self.yaw_rad += self.turn_rad_s * dt_s
        ahead = np.array([math.cos(self.yaw_rad), math.sin(self.yaw_rad)])
        self.place = self.place + self._speed_m_s * dt_s * ahead
        self.travelled_m += abs(self._speed_m_s) * dt_s


def follow(course: Course, tracker: Tracker, seed: int) -> Driven:
    """Follow until the bin is lost, or to the end; each command reaches the wheels a picture later."""
    cv2.setNumThreads(1)
    rng = np.random.default_rng((seed, 80))
    eye = camera(*_SIZE_PX, _FIELD_RAD, RATE_HZ)
    score, wheels = Score(eye, RATE_HZ), _Wheels(rng)
    robot = RobotFollower(UnicycleConfig(), DepthConfig(), eye)
    asked, errors, estimates = (0.0, 0.0), [], []
    for index in range(course.frames):
        t_ns = round(index * 1e9 / RATE_HZ)
        lens = Lens(eye, np.array([*wheels.place, -_EYE_M]), quat_from_euler(0.0, 0.0, wheels.yaw_rad))
        target, others = course.things(index, lens.ned_p_m)
        frame = course.hall.picture(lens, [target, *others], course.light(index, wheels.turn_rad_s))
        truth = lens.show(target)
        robot.roll(t_ns, *wheels.told())
        if index == 0 and truth is not None:
            tracker.init(frame, truth.box, 0.0, t_ns)
            box: Box | None = truth.box
        else:
            if isinstance(tracker, HabDfTracker):
                tracker.foresee(robot.expected())
            box = box_of(tracker.update(frame, t_ns))
        shown = [(t, s) for t in (target, *others) if (s := lens.show(t)) is not None]
        drive = robot.step(box, None if box is None else depth_patch(rng, lens, box, shown))
        if box is not None and truth is not None:
            estimates.append(abs(robot.distance_m - truth.depth_m))
        wheels.roll(asked, 1.0 / RATE_HZ)
        asked = drive.speed_m_s, drive.turn_rad_s
        errors.append(float(np.linalg.norm(target.ned_p_m[:2] - wheels.place)) - _START_M)
        score.note(None if truth is None else truth.box, hidden_share(lens, target, others), box)
        if score.lost:
            break
    away = np.array(errors)
    return Driven(
        score,
        float(np.abs(away).mean()),
        float(np.mean(estimates)) if estimates else math.nan,
        float((away + _START_M > RANGE_M).mean()),
        wheels.travelled_m,
    )
