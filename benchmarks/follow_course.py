"""A person's way through a hall, and what happens on it: the course that the UAV flies after him.

He walks round a loop before the vehicle, faster and slower. All along it comes what trackers are known to fail at, in
three rows that know nothing of each other: what he and the vehicle do (he turns about, bends over, hurries ahead or
steps back; the operator turns the vehicle away from him), who else is there (a screen or somebody in his uniform
passes before him; another in it walks beside him), and what the pictures suffer (the light changes; the
camera shakes). Only while the operator turns the vehicle away nobody else is there. So he may come out from behind
the screen with his back turned and in the dark. In a row one follows the other with hardly a pause, each kind once
before any comes again. The order, the sides and the strengths are drawn.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.follow_scene import Hall, Light, Thing
from benchmarks.follow_solids import person, pillar
from common.geometry.rotation import quat_from_euler, quat_multiply

RATE_HZ = 30.0
HALF_M = (16.0, 16.0)
"""From the middle of the hall to its walls north and east, m."""
START_M = 3.0
"""How far ahead of the vehicle he is at the start, m."""
OWN = {"turn": 4.0, "lean": 3.5, "size": 6.0, "aside": 4.0}
"""What he and the vehicle do, and how long it lasts, s."""
BESIDE = {"screen": 4.0, "crossing": 3.0, "companion": 6.0}
"""Who or what else is there, and for how long, s; not while the operator turns the vehicle away: of two alike who come
back into the picture nobody could say which is he."""
PICTURE = {"light": 6.0, "shake": 3.0}
"""What the pictures suffer, and how long it lasts, s."""
ROWS = (OWN, BESIDE, PICTURE)
KINDS = {**OWN, **BESIDE, **PICTURE}
"""All of it."""
_FIRST_S, _PAUSE_S = 3.0, 0.5
"""When the rows begin, and the mean pause between two of one, s."""
_ASIDE_S, _OPERATORS_TURN_RAD_S = 1.0, 0.8
"""How long and how fast the operator's stick turns the vehicle: he leaves a picture of 70 degrees."""
_SHAKE_RAD_S = 2.0 * math.pi * 5.0
"""Angular frequency of the shaking mount, rad/s."""


@dataclass(frozen=True)
class Event:
    """Something that makes it hard for a while."""

    kind: str
    """One of `KINDS`."""
    begin_s: float
    """When it begins, s."""
    side: float
    """From which side, or which way: -1 or 1."""
    strength: float
    """0 to 1."""
    tint: tuple[float, float, float]
    """Colour of a changed light, blue, green and red."""

    def share(self, t_s: float) -> float:
        """How much of it has passed at a time, 0 to 1; -1 when it is not on."""
        share = (t_s - self.begin_s) / KINDS[self.kind]
        return share if 0.0 <= share < 1.0 else -1.0


def events(rng: np.random.Generator, duration_s: float) -> list[Event]:
    """All rows until a time, s."""
    own, picture = _row(rng, OWN, duration_s), _row(rng, PICTURE, duration_s)
    return [*own, *_row(rng, BESIDE, duration_s, [event for event in own if event.kind == "aside"]), *picture]


def _row(
    rng: np.random.Generator, kinds: Mapping[str, float], duration_s: float, without: Sequence[Event] = ()
) -> list[Event]:
    """One after the other until a time, s, and none while any of others is on."""
    drawn, t = [], _FIRST_S
    while t < duration_s:
        for kind in rng.permutation(list(kinds)).tolist():
            for other in without:
                if other.begin_s < t + kinds[kind] and t < other.begin_s + KINDS[other.kind]:
                    t = other.begin_s + KINDS[other.kind]
            blue, green, red = rng.uniform(0.85, 1.2, 3).tolist()
            drawn.append(Event(kind, t, float(rng.choice((-1.0, 1.0))), float(rng.random()), (blue, green, red)))
            t += kinds[kind] + _PAUSE_S * float(rng.uniform(0.5, 1.5))
    return drawn


class Walk:
    """Where he is at each frame: round a loop, unless what happens makes him stop, hurry or step back.

    Args:
        rng: draws it.
        happens: what happens.
        frames: how long.
    """

    def __init__(self, rng: np.random.Generator, happens: Sequence[Event], frames: int):
        dt = 1.0 / RATE_HZ
        place, course, facing, speed, cruise = np.array([START_M, 0.0]), 0.0, 0.0, 0.0, 0.9
        round_, radius_m, until_s = float(rng.choice((-1.0, 1.0))), 9.0, 0.0
        self.places, self.headings, self.courses = np.empty((frames, 2)), np.empty(frames), np.empty(frames)
        for index in range(frames):
            t = index * dt
            self.places[index], self.headings[index], self.courses[index] = place, facing, course
            if t >= until_s:
                until_s = t + rng.uniform(5.0, 10.0)
                cruise, radius_m = rng.uniform(0.6, 1.2), rng.uniform(7.0, 10.5)
            wanted, spin_rad_s = _wanted(happens, t, cruise)
            quickness = 0.5 if wanted == cruise else 1.5  # nobody hurries without a reason
            speed += float(np.clip(wanted - speed, -quickness * dt, quickness * dt))
            along = math.atan2(place[1], place[0]) + round_ * math.pi / 2
            inwards = math.atan(0.5 * (float(np.linalg.norm(place)) - radius_m))
            off = math.remainder(along + round_ * inwards - course, 2 * math.pi)
            course += float(np.clip(off, -0.5 * dt, 0.5 * dt)) * (speed > 0.05)
            place = place + speed * dt * np.array([math.cos(course), math.sin(course)])
            turn = 3.0 * math.remainder(course - facing, 2 * math.pi) if spin_rad_s == 0.0 else spin_rad_s
            facing += float(np.clip(turn, -3.0, 3.0)) * dt


def _wanted(happens: Sequence[Event], t_s: float, cruise_m_s: float) -> tuple[float, float]:
    """Speed that he wants, m/s, and how fast he turns about, rad/s (0: he looks where he goes)."""
    for event in happens:
        share = event.share(t_s)
        if share < 0.0:
            continue
        if event.kind == "turn":  # once round, after he has stopped
            begin, length_s = 0.2, 0.75 - 0.25 * event.strength
            spinning = begin <= share < begin + length_s
            return 0.0, event.side * 2 * math.pi / (length_s * KINDS["turn"]) if spinning else 0.0
        if event.kind == "size" and share < 0.5:
            return (3.0 + event.strength) if event.side > 0 else -0.7 - 0.3 * event.strength, 0.0
    return cruise_m_s, 0.0


class Course:
    """All of it, of one seed; the same for whoever follows.

    Args:
        seed: draws it.
        frames: how long.
    """

    def __init__(self, seed: int, frames: int):
        rng = np.random.default_rng((seed, 71))
        self.frames = frames
        self.hall = Hall(HALF_M, seed)
        self._solid, paint = person(rng)
        self._twin, _ = person(rng, paint)
        self._companion, _ = person(rng, paint)
        self._screen = pillar(rng, 1.3, 2.2)
        self.events = events(rng, frames / RATE_HZ)
        self._walk = Walk(rng, self.events, frames)

    def on(self, index: int) -> list[tuple[Event, float]]:
        """What happens at a frame, and how much of it has passed, 0 to 1."""
        return [(e, share) for e in self.events if (share := e.share(index / RATE_HZ)) >= 0.0]

    def target(self, index: int) -> Thing:
        """The person at a frame."""
        place, heading = self._walk.places[index], float(self._walk.headings[index])
        thing = Thing(self._solid, np.array([*place, 0.0]), heading)
        for event, share in self.on(index):
            if event.kind == "lean":
                thing.lean_rad = event.side * (0.3 + 0.25 * event.strength) * min(1.0, 4.0 * min(share, 1.0 - share))
        return thing

    def others(self, index: int, eye: np.ndarray) -> list[Thing]:
        """Who and what else is there, seen from a place (3,)."""
        return [
            self._other(event, share, index, eye)
            for event, share in self.on(index)
            if event.kind in ("screen", "crossing", "companion")
        ]

    def _other(self, event: Event, share: float, index: int, eye: np.ndarray) -> Thing:
        target = self.target(index)
        if event.kind == "companion":  # beside his way: she does not go round him while he turns about
            aside = 0.7 + 0.2 * event.strength + 2.5 * (2 * share - 1) ** 4
            course = float(self._walk.courses[index])
            across = course + event.side * math.pi / 2
            offset = aside * np.array([math.cos(across), math.sin(across), 0.0])
            return Thing(self._companion, target.ned_p_m + offset, course)
        # Either crosses the line of sight as it is; what is nearer hides the person for a while.
        towards = (eye - target.ned_p_m) * np.array([1.0, 1.0, 0.0])
        away = towards / max(float(np.linalg.norm(towards)), 1e-6)
        across = np.array([-away[1], away[0], 0.0]) * event.side
        place = target.ned_p_m + (0.8 + 0.3 * event.strength) * away + across * 2.4 * (2 * share - 1)
        solid = self._twin if event.kind == "crossing" else self._screen
        return Thing(solid, place, math.atan2(across[1], across[0]))

    def light(self, index: int, turn_rad_s: float) -> Light:
        """Light at a frame, and blur of a camera that turns by itself at a rate, rad/s."""
        gain = np.ones(3)
        for event, share in self.on(index):
            if event.kind == "light":
                ramp = min(1.0, 10.0 * min(share, 1.0 - share))
                gain += ramp * ((0.75 - 0.3 * event.strength) * np.array(event.tint) - 1.0)
        blue, green, red = gain.tolist()
        return Light((blue, green, red), abs(turn_rad_s) + abs(self._shake(index)[1]))

    def shaken(self, index: int, ned_q_body: np.ndarray) -> np.ndarray:
        """Attitude (4,) of the camera's mount, which is as the vehicle's unless it shakes."""
        angle_rad, _ = self._shake(index)
        return quat_multiply(ned_q_body, quat_from_euler(0.0, 0.7 * angle_rad, angle_rad)) if angle_rad else ned_q_body

    def _shake(self, index: int) -> tuple[float, float]:
        """Angle, rad, and rate, rad/s, of the shaking mount."""
        for event, share in self.on(index):
            if event.kind == "shake":
                phase = _SHAKE_RAD_S * (index / RATE_HZ - event.begin_s)
                size = (0.03 + 0.03 * event.strength) * min(1.0, 4.0 * min(share, 1.0 - share))
                return size * math.sin(phase), size * _SHAKE_RAD_S * math.cos(phase)
        return 0.0, 0.0

    def operators_turn_rad_s(self, index: int) -> float | None:
        """How fast the operator's stick turns the vehicle, rad/s; None while he leaves it to the follower."""
        for event, _ in self.on(index):
            if event.kind == "aside" and index / RATE_HZ - event.begin_s < _ASIDE_S:
                return event.side * _OPERATORS_TURN_RAD_S
        return None
