"""Following a person through a hall with the simulated quadrotor: pictures in, helm's setpoints out, one process."""

from __future__ import annotations

import copy
import math
from functools import cache
from types import SimpleNamespace

import cv2
import msgspec
import numpy as np

from benchmarks.follow_course import RATE_HZ, Course
from benchmarks.follow_depth import DepthEye
from benchmarks.follow_scene import Lens, camera, hidden_share
from benchmarks.follow_score import Score, box_of
from common.geometry.camera import Camera
from common.geometry.rotation import euler_from_quat
from common.tracking.base import Box, Tracker
from onboard.follow.config import FollowConfig
from onboard.follow.law import Vehicle
from onboard.follow.mount import Mount
from onboard.follow.steering import Steering
from onboard.fusion.center import SEVERAL
from onboard.fusion.config import DepthConfig
from onboard.fusion.tracker import HabDfTracker
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

_SIZE_PX, _FIELD_RAD = (320, 240), math.radians(70.0)
_EYE_M = 1.5
"""Height of the camera in the hall, m."""
_DOWN_RAD = math.radians(10.0)
"""By how much it looks below the nose, rad: a person 4 m ahead has as much room below his feet as above his head."""
_HEADROOM_M = 60.0
"""Greatest height over home that the pilot allows, m: the hall is up in the air, where the vehicle hovers."""


def depth_eye(seed: int) -> DepthEye:
    """Its depth camera.

    Args:
        seed: of the sensor's noise.
    """
    return DepthEye(_SIZE_PX, _FIELD_RAD, _DOWN_RAD, seed)


@cache
def _hovering(seed: int) -> SimulatedVehicle:
    """A vehicle that hovers; taking off takes a second."""
    return hovering(configured(0.1, seed))


class Quadrotor:
    """The simulated autopilot under helm's pilot, hovering in the hall.

    Args:
        seed: of its estimate's errors.
    """

    def __init__(self, seed: int):
        self._vehicle = copy.deepcopy(_hovering(seed))
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

    def lens(self, eye: Camera) -> Lens:
        """Where its camera truly is."""
        truth = self._vehicle.truth
        return Lens(eye, np.array(truth.ned_p_m) - self._origin, np.array(truth.ned_q_body))

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


def follow(course: Course, tracker: Tracker, quadrotor: Quadrotor, depth: DepthEye | None) -> Score:
    """Follow the person until he is lost, or to the end.

    Each picture's request reaches the vehicle one picture later.

    Args:
        course: the person's way, and what happens on it.
        tracker: what finds him.
        quadrotor: what follows him.
        depth: its depth camera; None: it has none.
    """
    cv2.setNumThreads(1)
    eye = camera(*_SIZE_PX, _FIELD_RAD, RATE_HZ, _DOWN_RAD)
    score, steering = Score(eye, RATE_HZ), Steering(FollowConfig(camera="front"), DepthConfig(), eye)
    verdict, begun_ns, mount = HOVER, quadrotor.t_ns, Mount(eye)
    for index in range(course.frames):
        t_ns = quadrotor.t_ns
        truly = quadrotor.lens(eye)
        lens = truly._replace(ned_q_body=course.shaken(index, truly.ned_q_body))
        known, vehicle = quadrotor.known()
        target, others = course.target(index), course.others(index, lens.ned_p_m)
        frame = course.hall.picture(lens, [target, *others], course.light(index, quadrotor.turn_rad_s))
        depth_m = None if depth is None else depth.picture(course.hall, lens, [target, *others])
        truth = lens.show(target)
        pose = mount.pose(frame, t_ns, known, depth_m)
        if index == 0:
            if truth is None:
                raise RuntimeError("follow: the person is not in the first picture")
            tracker.init(frame, truth.box, 0.0, t_ns)
            box: Box | None = truth.box
            sure = True
        else:
            if isinstance(tracker, HabDfTracker):
                tracker.foresee(steering.expected(t_ns, pose, depth_m))
            result = tracker.update(frame, t_ns)
            box, sure = box_of(result), isinstance(tracker, HabDfTracker) and result.score > SEVERAL
        request = steering.step(t_ns, box, pose, vehicle, depth_m, sure=sure)
        asked = HOVER if request is None else Verdict("follow", request.vector, request.yaw_rate_rad_s, 0.0)
        stick_rad_s = course.operators_turn_rad_s(index)
        if stick_rad_s is not None:
            asked = Verdict("operator", (0.0, 0.0, 0.0), stick_rad_s, 0.0)
            steering.restart()
        quadrotor.fly(verdict, begun_ns + round((index + 1) * 1e9 / RATE_HZ))
        verdict = asked
        score.note(None if truth is None else truth.box, hidden_share(lens, target, others), box)
        if score.lost:
            break
    return score
