"""Following a person through a hall with the simulated quadrotor: pictures in, helm's setpoints out, one process.

The person walks about, stops, turns round, and meets others: one in the same colours who crosses between, one who goes
along; the light changes. What is hard comes from all sides in turn, so that each kind of tracker meets what it is bad
at.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace

import cv2
import msgspec
import numpy as np

from benchmarks.follow_scene import Hall, Lens, Light, Thing, camera, hidden_share
from benchmarks.follow_score import Score, box_of
from benchmarks.follow_solids import person, pillar
from common.geometry.rotation import euler_from_quat
from common.tracking.base import Box, Tracker
from onboard.follow.config import FollowConfig
from onboard.follow.law import FollowLaw, Vehicle
from onboard.follow.sight import Sight, TargetPlace
from onboard.fusion.depth import DepthConfig
from onboard.helm.arbiter import HOVER, Verdict
from onboard.helm.config import HelmConfig
from onboard.helm.dialect.px4 import PX4
from onboard.helm.pilot import Pilot
from onboard.helm.telemetry import AttitudeSample, PositionSample, Telemetry
from onboard.limiter.config import LimiterConfig
from onboard.limiter.map import NOTHING_KNOWN
from onboard.proximity.pose import Pose
from simulation.autopilot.motion import heading
from simulation.autopilot.response import configured, hovering
from simulation.autopilot.setpoints import decode
from simulation.autopilot.vehicle import SimulatedVehicle

RATE_HZ = 30.0
_SIZE_PX, _FIELD_RAD = (320, 240), math.radians(70.0)
_HALF_M = (16.0, 16.0)
_START_M = 4.0
_EYE_M = 1.5
_HEADROOM_M = 60.0


class Walk:
    """Where somebody is at a time: way points walked at a speed, with stops at which he turns round.

    Args:
        rng: draws it.
        start: place, (2,), m.
        duration_s: how long, s.
    """

    def __init__(self, rng: np.random.Generator, start: tuple[float, float], duration_s: float):
        dt = 1.0 / RATE_HZ
        count = int(duration_s * RATE_HZ) + 2
        place, course, facing = np.array(start), 0.0, 0.0
        speed = wanted = 0.0
        self.places, self.headings = np.empty((count, 2)), np.empty(count)
        goal, until_s, spin = _goal(rng, place), 2.0, 0.0
        for index in range(count):
            t = index * dt
            self.places[index], self.headings[index] = place, facing
            if np.linalg.norm(goal - place) < 1.0:
                goal = _goal(rng, place)
            if t >= until_s:
                if wanted > 0.0 and rng.random() < 0.6:  # stops, looks round
                    wanted, until_s, spin = (
                        0.0,
                        t + rng.uniform(2.0, 4.0),
                        float(rng.choice((-1.0, 1.0))) * float(rng.uniform(1.2, 2.6)),
                    )
                else:
                    wanted, until_s, spin = rng.uniform(0.6, 1.4), t + rng.uniform(3.0, 8.0), 0.0
            speed += np.clip(wanted - speed, -0.8 * dt, 0.8 * dt)
            off = math.remainder(math.atan2(*(goal - place)[::-1]) - course, 2 * math.pi)
            course += float(np.clip(off, -0.7 * dt, 0.7 * dt)) * (speed > 0.05)
            place = place + speed * dt * np.array([math.cos(course), math.sin(course)])
            turn = math.remainder(course - facing, 2 * math.pi) * 3.0 if spin == 0.0 else spin
            facing += float(np.clip(turn, -2.0, 2.0)) * dt

    def thing(self, solid: object, index: int) -> Thing:
        """Him at a frame."""
        index = min(index, len(self.headings) - 1)
        return Thing(solid, np.array([*self.places[index], 0.0]), float(self.headings[index]))  # type: ignore[arg-type]


def _goal(rng: np.random.Generator, place: np.ndarray) -> np.ndarray:
    while True:
        goal = rng.uniform(-1.0, 1.0, 2) * (np.array(_HALF_M) - 6.0)
        if np.linalg.norm(goal - place) > 5.0:
            return goal


@dataclass(frozen=True)
class Event:
    """Something that makes it hard for a while."""

    kind: str
    """`crossing`, `companion`, `light`, `screen`, `lean`."""
    begin_s: float
    """When it begins, s."""
    length_s: float
    """How long it lasts, s."""
    side: float
    """From which side: -1 or 1."""
    gain: tuple[float, float, float]
    """Light, blue, green and red."""
    lean_rad: float
    """How far the person leans over, rad."""

    def share(self, index: int) -> float:
        """How much of it has passed at a frame, 0 to 1; -1 when it is not on."""
        share = (index / RATE_HZ - self.begin_s) / self.length_s
        return share if 0.0 <= share < 1.0 else -1.0


_KINDS = {"crossing": 5.0, "companion": 6.0, "light": 7.0, "screen": 4.0, "lean": 5.0}
_PAUSE_S, _QUICK_PAUSE_S = 2.0, 0.5


class Course:
    """Person, others, light and screens of one seed; the same for whoever follows.

    Args:
        seed: draws all of it.
        frames: how long.
        dense: with hardly a pause between what is hard, for a short run.
    """

    def __init__(self, seed: int, frames: int, dense: bool = False):
        rng = np.random.default_rng((seed, 71))
        self.frames = frames
        duration_s = frames / RATE_HZ
        self.hall = Hall(_HALF_M, seed, noise=7.0)
        self._solid, paint = person(rng)
        self._twin, _ = person(rng, paint)
        self._screen = pillar(rng, 1.3, 2.2)
        self._walk = Walk(rng, (_START_M, 0.0), duration_s)
        self._events = _events(rng, duration_s, _QUICK_PAUSE_S if dense else _PAUSE_S)

    def target(self, index: int) -> Thing:
        """The person at a frame."""
        thing = self._walk.thing(self._solid, index)
        for event in self._events:
            if event.kind == "lean" and (share := event.share(index)) >= 0.0:
                thing.lean_rad = event.side * event.lean_rad * min(1.0, 5.0 * min(share, 1.0 - share))
        return thing

    def others(self, index: int, eye: np.ndarray) -> list[Thing]:
        """Who and what else is there, seen from a place (3,)."""
        things = []
        for event in self._events:
            share = event.share(index)
            if share < 0.0 or event.kind in ("light", "lean"):
                continue
            target = self.target(index)
            if event.kind == "companion":
                aside = 0.75 + 2.5 * (2 * share - 1) ** 4
                course = target.heading_rad + event.side * math.pi / 2
                offset = aside * np.array([math.cos(course), math.sin(course), 0.0])
                things.append(Thing(self._twin, target.ned_p_m + offset, target.heading_rad))
                continue
            # Both cross the line of sight as it is; what is nearer hides the person for a while.
            towards = (eye - target.ned_p_m) * np.array([1.0, 1.0, 0.0])
            away = towards / max(float(np.linalg.norm(towards)), 1e-6)
            across = np.array([-away[1], away[0], 0.0]) * event.side
            lateral, near = (3.2, 1.0) if event.kind == "crossing" else (2.0, 1.4)
            place = target.ned_p_m + near * away + across * lateral * (2 * share - 1)
            facing = math.atan2(across[1], across[0])
            things.append(Thing(self._twin if event.kind == "crossing" else self._screen, place, facing))
        return things

    def light(self, index: int) -> tuple[float, float, float]:
        """Gain of the light at a frame."""
        for event in self._events:
            if event.kind == "light" and (share := event.share(index)) >= 0.0:
                ramp = min(1.0, 8.0 * min(share, 1.0 - share))
                blue, green, red = (1.0 + ramp * (g - 1.0) for g in event.gain)
                return blue, green, red
        return 1.0, 1.0, 1.0


def _events(rng: np.random.Generator, duration_s: float, pause_s: float) -> list[Event]:
    """One after the other, each kind once before any comes again."""
    events, t = [], 3.0
    while t < duration_s:
        for kind in rng.permutation(list(_KINDS)).tolist():
            dark = float(rng.uniform(0.45, 0.75))
            tint = rng.uniform(0.8, 1.25, 3)
            blue, green, red = (dark * tint).tolist()
            side, lean_rad = float(rng.choice((-1.0, 1.0))), float(rng.uniform(0.8, 1.5))
            events.append(Event(kind, t, _KINDS[kind], side, (blue, green, red), lean_rad))
            t += _KINDS[kind] + pause_s * float(rng.uniform(0.5, 1.5))
    return events


class Quadrotor:
    """The simulated autopilot under helm's pilot, hovering in the hall.

    Args:
        seed: of its estimate's errors.
    """

    def __init__(self, seed: int):
        self._vehicle: SimulatedVehicle = hovering(configured(0.1, seed))
        p = self._vehicle.truth.ned_p_m
        self._origin = np.array([p[0], p[1], p[2] + _EYE_M])
        helm = HelmConfig()
        bounds = msgspec.structs.replace(helm.containment, height_max_m=_HEADROOM_M, acceleration_m_s2=4.0)
        self._pilot = Pilot(msgspec.structs.replace(helm, containment=bounds), LimiterConfig())
        self._begun = False

    @property
    def t_ns(self) -> int:
        """Its clock, ns."""
        return round(self._vehicle.t_s * 1e9)

    def lens(self, camera_: object) -> Lens:
        """Where its camera truly is."""
        truth = self._vehicle.truth
        return Lens(camera_, np.array(truth.ned_p_m) - self._origin, np.array(truth.ned_q_body))  # type: ignore[arg-type]

    @property
    def turn_rad_s(self) -> float:
        """True turn rate, rad/s."""
        return float(self._vehicle.truth.body_rates_rad_s[2])

    def known(self) -> tuple[Pose, Vehicle]:
        """What it knows of itself."""
        e = self._vehicle.estimate
        place = np.array(e.ned_p_m) - self._origin
        yaw_rad = euler_from_quat(np.array(e.ned_q_body))[2]
        pose = Pose(place, np.array(e.ned_q_body))
        return pose, Vehicle(place, np.array(e.ned_v_m_s), yaw_rad, float(e.body_rates_rad_s[2]))

    def fly(self, verdict: Verdict, until_ns: int) -> None:
        """One setpoint, and on to a time."""
        e, t_ns = self._vehicle.estimate, self.t_ns
        telemetry = Telemetry(
            found=True,
            attitude=AttitudeSample(t_ns, e.ned_q_body, e.body_rates_rad_s),
            position=PositionSample(t_ns, e.ned_p_m, e.ned_v_m_s),
            home_local_m=(float(self._origin[0]), float(self._origin[1]), 0.0),
            mode="OFFBOARD",
            armed=True,
            in_air=True,
        )
        if not self._begun:
            self._pilot.reset(telemetry, t_ns)
            self._begun = True
        flown = self._pilot.fly(verdict, telemetry, NOTHING_KNOWN, t_ns)
        if flown is not None:
            fields = SimpleNamespace(**PX4.setpoint(flown.local))
            self._vehicle.take_setpoint(decode(fields, heading(e.ned_q_body)))
        while self.t_ns < until_ns:
            self._vehicle.step()


def follow(
    course: Course, tracker: Tracker, quadrotor: Quadrotor, progress: Callable[[float], None] = lambda share: None
) -> Score:
    """Follow the person until he is lost, or to the end.

    Each picture's request reaches the vehicle one picture later.
    """
    cv2.setNumThreads(1)
    eye = camera(*_SIZE_PX, _FIELD_RAD, RATE_HZ)
    score, config = Score(eye, RATE_HZ), FollowConfig(camera="front")
    law, sight, place = FollowLaw(config, ahead=True), Sight(eye, config, DepthConfig()), TargetPlace(config)
    verdict, seen_ns, begun_ns = HOVER, 0, quadrotor.t_ns
    for index in range(course.frames):
        t_ns = quadrotor.t_ns
        lens = quadrotor.lens(eye)
        target, others = course.target(index), course.others(index, lens.ned_p_m)
        light = Light(course.light(index), quadrotor.turn_rad_s)
        frame = course.hall.picture(lens, [target, *others], light)
        truth = lens.show(target)
        if index == 0:
            if truth is None:
                raise RuntimeError("follow: the person is not in the first picture")
            tracker.init(frame, truth.box, 0.0, t_ns)
            box: Box | None = truth.box
        else:
            box = box_of(tracker.update(frame, t_ns))
        pose, vehicle = quadrotor.known()
        if box is not None and (found := sight.place(t_ns, box, pose)) is not None:
            place.measure(found, t_ns)
            seen_ns = t_ns
        ahead = place.at(t_ns)
        asked = HOVER
        if ahead is not None and t_ns - seen_ns <= config.coast_s * 1e9:
            request = law.ask(ahead, vehicle, t_ns)
            asked = Verdict("follow", request.vector, request.yaw_rate_rad_s, 0.0)
        quadrotor.fly(verdict, begun_ns + round((index + 1) * 1e9 / RATE_HZ))
        verdict = asked
        score.note(None if truth is None else truth.box, hidden_share(lens, target, others), box)
        progress((index + 1) / course.frames)
        if score.lost:
            break
    return score
