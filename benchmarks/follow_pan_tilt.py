"""A pan-tilt head that keeps a face or a bin in the middle of its picture (Echeverri 2016, 4.5.2)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from benchmarks.follow_scene import Hall, Lens, Light, Thing, camera, hidden_share
from benchmarks.follow_score import Score, box_of
from benchmarks.follow_solids import Solid, bin_, head, pillar
from common.geometry.rotation import quat_from_euler
from common.tracking.base import Box, Tracker
from onboard.follow.head import HeadFollower
from onboard.follow.pan_tilt import PanTiltConfig
from onboard.fusion.tracker import HabDfTracker

RATE_HZ = 30.0
TARGETS = ("face", "bin")
_SIZE_PX, _FIELD_RAD = (320, 240), math.radians(60.0)
_PLACE = np.array([0.0, 0.0, -1.2])
"""Where the camera is, NED, m."""
_SERVO_S = 0.06
"""Lag of the servos behind what is commanded, s."""
_STEP_RAD = 2 * math.pi / 4096
"""Step in which the servos tell their angles (Dynamixel MX-28)."""
_CALM_S = 3.0
"""How long it takes at the start until the target moves and turns as much as it does later."""
_TURN, _TURN_S = {"face": 1.1, "bin": 1.4}, {"face": (9.0, 3.0), "bin": (14.0, 7.0)}
"""How far each turns to either side, rad, and its slowest and fastest period, s: a head, and a bin that is turned."""
_NEAR_M, _FAR_M = {"face": (0.8, 1.0), "bin": (0.8, 1.0)}, {"face": (1.9, 2.5), "bin": (1.0, 1.5)}
"""Distance at the start and the end, m: the thesis's bin kept almost the same."""


@dataclass(frozen=True)
class Swing:
    """A sum of three sine waves."""

    amplitude: np.ndarray
    """(3,)."""
    rate: np.ndarray
    """(3,), rad/s."""
    phase: np.ndarray
    """(3,), rad."""

    @classmethod
    def draw(cls, rng: np.random.Generator, size: float, slowest_s: float, fastest_s: float) -> Swing:
        """One of about this size, with these periods."""
        rate = 2 * math.pi / rng.uniform(fastest_s, slowest_s, 3)
        return cls(size * rng.uniform(0.2, 0.6, 3), rate, rng.uniform(-math.pi, math.pi, 3))

    def at(self, t_s: float) -> float:
        """Its value at a time, against its value at 0, from which it sets out slowly."""
        gone_s = t_s - _CALM_S * -math.expm1(-t_s / _CALM_S)
        wave = np.sin(self.rate * gone_s + self.phase) - np.sin(self.phase)
        return float(self.amplitude @ wave)


class Course:
    """A target that moves sideways, a little up and down, turns, and goes further away; someone passes before it.

    Args:
        kind: `face` or `bin`.
        seed: draws it.
        frames: how long.
    """

    def __init__(self, kind: str, seed: int, frames: int):
        rng = np.random.default_rng((seed, TARGETS.index(kind), 73))
        self.frames = frames
        self.hall = Hall((5.0, 5.0), seed, 3.0)
        self._solid: Solid = head(rng) if kind == "face" else bin_(rng)
        self._passer = pillar(rng, 0.16, 1.4)
        self._aside, self._height = Swing.draw(rng, 0.9, 12.0, 5.0), Swing.draw(rng, 0.16, 6.0, 2.0)
        self._turn = Swing.draw(rng, _TURN[kind], *_TURN_S[kind])
        self._near, self._far = float(rng.uniform(*_NEAR_M[kind])), float(rng.uniform(*_FAR_M[kind]))
        count, whole_s = max(1, int(frames / RATE_HZ / 7)), frames / RATE_HZ - 2.0 - _CALM_S
        # Each has a stretch of its own, and comes in its middle half: no two at once.
        self._passes = _CALM_S + whole_s * (np.arange(count) + rng.uniform(0.25, 0.75, count)) / count

    def things(self, index: int) -> tuple[Thing, list[Thing]]:
        """The target, and what passes before it."""
        t = index / RATE_HZ
        share = index / max(1, self.frames - 1)
        distance, bearing = self._near + (self._far - self._near) * share, self._aside.at(t)
        middle = _PLACE[2] + self._height.at(t) * distance
        foot = np.array([distance * math.cos(bearing), distance * math.sin(bearing), middle + self._solid.height_m / 2])
        target = Thing(self._solid, foot, bearing + math.pi + self._turn.at(t))
        others = []
        for begin in self._passes:
            along = (t - begin) / 1.5
            if 0.0 <= along < 1.0:
                where = bearing + 0.8 * (2 * along - 1)
                others.append(
                    Thing(
                        self._passer,
                        np.array([0.6 * distance * math.cos(where), 0.6 * distance * math.sin(where), 0.0]),
                    )
                )
        return target, others


def follow(course: Course, tracker: Tracker) -> Score:
    """Keep the target in the middle until it is lost, or to the end; a command reaches the servos a picture later."""
    cv2.setNumThreads(1)
    eye = camera(*_SIZE_PX, _FIELD_RAD, RATE_HZ)
    score, head = Score(eye, RATE_HZ), HeadFollower(PanTiltConfig(), eye)
    pan = tilt = 0.0
    commanded = (0.0, 0.0)
    keep = math.exp(-1.0 / RATE_HZ / _SERVO_S)
    turned = 0.0
    for index in range(course.frames):
        t_ns = round(index * 1e9 / RATE_HZ)
        lens = Lens(eye, _PLACE, quat_from_euler(0.0, tilt, pan))
        target, others = course.things(index)
        frame = course.hall.picture(lens, [target, *others], Light(turn_rad_s=turned))
        truth = lens.show(target)
        head.turned(t_ns, *(round(angle / _STEP_RAD) * _STEP_RAD for angle in (pan, tilt)))
        expected = head.expected(frame)
        if index == 0 and truth is not None:
            tracker.init(frame, truth.box, 0.0, t_ns)
            box: Box | None = truth.box
        else:
            if isinstance(tracker, HabDfTracker):
                tracker.foresee(expected)
            box = box_of(tracker.update(frame, t_ns))
        asked = head.step(box)
        before = pan
        pan, tilt = commanded[0] + keep * (pan - commanded[0]), commanded[1] + keep * (tilt - commanded[1])
        turned, commanded = (pan - before) * RATE_HZ, asked
        score.note(None if truth is None else truth.box, hidden_share(lens, target, others), box)
        if score.lost:
            break
    return score
