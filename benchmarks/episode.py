"""A chase in one process, without sockets or clocks: the same world, vehicle and algorithms, deterministic for a seed.

It leaves out what only processes have (scheduling, transport, restarts): their delay is one figure here. Pictures go
through the same JPEG, the request through helm's arbiter, containment and limiter, the setpoint into the same
simulated autopilot.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import cv2
import msgspec
import numpy as np

from common.config import Config
from common.geometry.config import CamerasConfig
from common.geometry.rotation import as_vec3, euler_from_quat, quat_rotate, wrap_angle
from common.messages import VehicleState
from common.tracking.base import Tracker
from common.tracking.registry import make_tracker
from common.truth import Truth
from ground.pursuit.config import PursuitConfig
from ground.pursuit.history import StateHistory
from ground.pursuit.horizon import Horizon
from ground.pursuit.node import request_of
from ground.pursuit.pursuer import Pursued, Pursuer
from onboard.camera.config import VideoConfig
from onboard.helm.arbiter import Candidate, arbitrate
from onboard.helm.config import HelmConfig
from onboard.helm.dialect.px4 import PX4
from onboard.helm.pilot import Pilot
from onboard.helm.setpoint import LocalSetpoint
from onboard.helm.telemetry import AttitudeSample, PositionSample, Telemetry
from onboard.limiter.config import LimiterConfig
from onboard.limiter.map import NOTHING_KNOWN
from simulation.autopilot.config import AutopilotSimConfig
from simulation.autopilot.control import heading
from simulation.autopilot.modes import Mode
from simulation.autopilot.setpoints import decode
from simulation.autopilot.vehicle import SimulatedVehicle
from simulation.demo.mission import box_of_corners
from simulation.demo.report import ChaseRecorder
from simulation.world.config import WorldConfig
from simulation.world.scenario import ScenarioConfig
from simulation.world.stage import Stage
from simulation.world.truth_filter import Motion

_SEC_NS = 1_000_000_000
_TO_SETPOINT_NS = 25_000_000
_TAKEOFF_S = 60.0
_SLOPE_S = 0.5
_COURSE_GAIN_1_S = 0.3
_CLIMB_GAIN_1_S = 0.8
"""The law's own, towards the height at which a lost target is looked for."""
_STATE_CYCLES = 5  # of the autopilot's between two states: 50 Hz
_GYRO_BIAS_RAD_S, _FORCE_BIAS_M_S2 = 0.0005, 0.03  # what an autopilot's own bias estimates leave, standard deviations


@dataclass
class Trace:
    """What happened, picture by picture."""

    rows: list[dict[str, Any]] = field(default_factory=list)

    def column(self, name: str) -> np.ndarray:
        """One figure of all pictures, (N,)."""
        return np.array([row[name] for row in self.rows])


class Episode:
    """One chase.

    Args:
        config: sections of all processes, as they would read them.
        scenario: what the world shows.
        seed: of world, vehicle and tracker.
        height_m: height of the chase, m; or its course, a function of the time since the chase began, s. A course is
            flown as an operator's climb and sink would be; the chase law then leaves the height alone. For a target
            out of sight the operator does what the law would: climbs, but not above `top_m`.
        top_m: greatest height of the course, m.
    """

    def __init__(
        self,
        config: Config,
        scenario: ScenarioConfig,
        seed: int,
        height_m: float | Callable[[float], float] = 5.0,
        top_m: float = 0.0,
    ):
        self.recorder = ChaseRecorder(selections=1)
        self.trace = Trace()
        self.watch: Callable[[int, np.ndarray, Pursued], None] = lambda number, frame, pursued: None
        """Called with the number of each picture from 0, the picture, and what it gave."""
        self.held_s = (math.inf, math.inf)
        """Between these times after the chase began the operator holds the vehicle, s."""
        self._camera = config.section(CamerasConfig).down.camera()
        world = msgspec.structs.replace(config.section(WorldConfig), seed=seed)
        self._stage = Stage(world, msgspec.structs.replace(scenario, seed=seed), config.section(CamerasConfig))
        autopilot = msgspec.structs.replace(config.section(AutopilotSimConfig), seed=seed, clock_rate=1.0)
        self._vehicle = SimulatedVehicle(autopilot)
        section = msgspec.structs.replace(config.section(PursuitConfig), seed=seed)
        if callable(height_m):
            section = msgspec.structs.replace(section, climb_m=0.0)
        rng = np.random.default_rng(seed)
        self._pursuit = section
        self._pursuer = Pursuer(section, lambda: make_tracker(section.tracker, config, rng))
        self._states = StateHistory(section.history_s, Horizon(section.attitude_doubt_rad, section.attitude_doubt_s))
        self._gyro = np.random.default_rng((seed, 414))
        self._gyro_bias_rad_s = self._gyro.normal(0.0, _GYRO_BIAS_RAD_S, 3)
        self._gyro_noise_rad_s = autopilot.gyro_noise_rad_s
        self._force = np.random.default_rng((seed, 416))
        self._force_bias_m_s2 = self._force.normal(0.0, _FORCE_BIAS_M_S2, 3)
        self._force_noise_m_s2 = autopilot.accel_noise_m_s2
        self._helm = config.section(HelmConfig)
        self._pilot = Pilot(self._helm, config.section(LimiterConfig))
        self._jpeg = [cv2.IMWRITE_JPEG_QUALITY, config.section(VideoConfig).jpeg_quality]
        self._period_ns = round(1e9 / self._camera.rate_hz)
        self._request: Candidate | None = None
        self._course = height_m if callable(height_m) else None
        self._top_m = top_m
        self._seen_ns = 0
        self._height_m = height_m(0.0) if callable(height_m) else height_m
        self._begun_ns = 0

    def use(self, tracker: Callable[[], Tracker]) -> None:
        """Chase with another tracker than the configured one."""
        self._pursuer = Pursuer(self._pursuit, tracker)

    def fly(self, duration_s: float, progress: Callable[[float], None] = lambda share: None) -> ChaseRecorder:
        """Take off, choose the car, chase it for a time; what `outrider demo` would report.

        Raises:
            RuntimeError: the car is not in the picture after the takeoff.
        """
        cv2.setNumThreads(1)
        try:
            self._take_off()
            start_ns = self._begun_ns = self._seen_ns = self._now_ns()
            selected = False
            for index in itertools.count():
                capture_ns = start_ns + index * self._period_ns
                if capture_ns - start_ns > duration_s * _SEC_NS:
                    break
                self._step_until(capture_ns)
                truth = self._stage.place(self._motion(capture_ns))
                data = self._stage.picture(capture_ns)
                pursued = None
                if data is not None:
                    frame = self._through_jpeg(data)
                    if not selected:
                        self._select(frame, truth, capture_ns)
                        selected = True
                    else:
                        pursued = self._pursuer.step(frame, capture_ns, self._camera, self._states.pose(capture_ns)[0])
                        if pursued is not None:
                            self.watch(index, frame, pursued)
                self._obey(pursued, capture_ns)
                self._note(truth, pursued, capture_ns)
                progress((capture_ns - start_ns) / (duration_s * _SEC_NS))
        finally:
            self._stage.close()
        return self.recorder

    def _take_off(self) -> None:
        vehicle = self._vehicle
        while not vehicle.situation.ready:
            vehicle.step()
        vehicle.arm()
        vehicle.command(Mode.TAKEOFF, self._height_m)
        while vehicle.modes.mode is Mode.TAKEOFF and vehicle.t_s < _TAKEOFF_S:
            vehicle.step()
            self._tell()
            if round(vehicle.t_s / vehicle.dt_s) % 12 == 0:
                self._stage.place(self._motion(self._now_ns()))  # cars set off once the vehicle is airborne
        self._send(LocalSetpoint(0.0, 0.0, -self._height_m, 0.0, 0.0))
        vehicle.step()
        vehicle.command(Mode.OFFBOARD)
        self._pilot.reset(self._telemetry(self._now_ns()), self._now_ns(), self._height_m)

    def _select(self, frame: np.ndarray, truth: Truth, capture_ns: int) -> None:
        if not truth.target_corners_px:
            raise RuntimeError("episode: the car is not in the picture after the takeoff; begin its path near home")
        box, angle_rad = box_of_corners(truth.target_corners_px, truth)
        self._pursuer.select(frame, box, angle_rad, capture_ns)

    def _obey(self, pursued: Pursued | None, capture_ns: int) -> None:
        """What helm does with the request, at the time when its setpoint would reach the autopilot."""
        if pursued is not None and pursued.seen:
            self._seen_ns = capture_ns
        held = self.held_s[0] <= (capture_ns - self._begun_ns) / 1e9 < self.held_s[1]
        if pursued is not None and pursued.wish is not None and not held:
            request = request_of(pursued.wish)
            north, east, down = request.vector
            request = msgspec.structs.replace(request, vector=(north, east, down - self._climb_of_course(capture_ns)))
            self._request = Candidate("pursuit", request, capture_ns, capture_ns + _TO_SETPOINT_NS)
        t_ns = capture_ns + _TO_SETPOINT_NS
        self._step_until(t_ns)
        telemetry = self._telemetry(t_ns)
        yaw_rad = telemetry.attitude.yaw_rad if telemetry.attitude else 0.0
        candidates = [self._request] if self._request is not None else []
        verdict = arbitrate(candidates, t_ns, yaw_rad, self._helm.freshness_s)
        flown = self._pilot.fly(verdict, telemetry, NOTHING_KNOWN, t_ns)
        if flown is not None:
            self._send(flown.local)

    def _climb_of_course(self, t_ns: int) -> float:
        """Upward velocity that keeps to the course of the height, or climbs for a lost target, m/s; 0 without one."""
        if self._course is None:
            return 0.0
        if t_ns - self._seen_ns > self._pursuit.climb_after_s * _SEC_NS:
            short_m = self._top_m + self._vehicle.estimate.ned_p_m[2]
            return min(max(_CLIMB_GAIN_1_S * short_m, -self._pursuit.sink_m_s), self._pursuit.climb_m_s)
        t_s = (t_ns - self._begun_ns) / 1e9
        slope_m_s = (self._course(t_s + _SLOPE_S) - self._course(t_s)) / _SLOPE_S
        return slope_m_s + _COURSE_GAIN_1_S * (self._course(t_s) + self._vehicle.estimate.ned_p_m[2])

    def _send(self, local: LocalSetpoint) -> None:
        """Hand a setpoint to the autopilot as it comes off the wire."""
        fields = PX4.setpoint(local)
        self._vehicle.take_setpoint(decode(SimpleNamespace(**fields), heading(self._vehicle.estimate.ned_q_body)))

    def _note(self, truth: Truth, pursued: Pursued | None, capture_ns: int) -> None:
        error_m = math.dist(truth.ned_p_m[:2], truth.target_ned_p_m[:2])
        yaw_rad = euler_from_quat(np.array(truth.ned_q_body))[2]
        self.recorder.errors_m.append(error_m)
        self.recorder.heights_m.append(-truth.ned_p_m[2])
        if pursued is not None:
            self.recorder.states.append((capture_ns, "tracking" if pursued.seen else "lost"))
        self.trace.rows.append(
            {
                "t_s": capture_ns / 1e9,
                "error_m": error_m,
                "axis_error_m": self._axis_error_m(truth),
                "yaw_error_rad": wrap_angle(truth.target_heading_rad - yaw_rad),
                "north_m": truth.ned_p_m[0],
                "east_m": truth.ned_p_m[1],
                "target_north_m": truth.target_ned_p_m[0],
                "target_east_m": truth.target_ned_p_m[1],
                "target_heading_rad": truth.target_heading_rad,
                "yaw_rad": yaw_rad,
                "covered": self._stage.covered,
                "in_picture": bool(truth.target_corners_px),
                "height_m": -truth.ned_p_m[2],
                "visible": truth.target_visible,
                "seen": pursued is not None and pursued.seen,
                "distance": 1.0 - pursued.result.score if pursued is not None else math.nan,
                "limit": 1.0 - pursued.result.score_limit if pursued is not None else math.nan,
                "off_m": self._off_m(truth, pursued),
                "track_heading_error_rad": _heading_error_rad(truth, pursued),
                "track_size_px": math.sqrt(math.prod(pursued.result.size_px)) if pursued is not None else math.nan,
                "reinitialisations": self._pursuer.reinitialisations,
                "speed_m_s": math.hypot(*truth.ned_v_m_s[:2]),
                "target_m_s": math.hypot(*truth.target_ned_v_m_s[:2]),
            }
        )

    def _axis_error_m(self, truth: Truth) -> float:
        """Distance between the car's centre and where the tilted optical axis meets its height, m."""
        axis = quat_rotate(
            np.array(truth.ned_q_body), quat_rotate(self._camera.body_q_camera, np.array([0.0, 0.0, 1.0]))
        )
        if axis[2] <= 0.0:
            return math.inf
        eye = np.array(truth.ned_p_m) + quat_rotate(np.array(truth.ned_q_body), self._camera.body_p_camera_m)
        meets = eye[:2] + axis[:2] / axis[2] * (truth.target_ned_p_m[2] - eye[2])
        return float(np.linalg.norm(meets - truth.target_ned_p_m[:2]))

    def _off_m(self, truth: Truth, pursued: Pursued | None) -> float:
        """Distance between where the tracker has the target and where it is, m."""
        if pursued is None or pursued.view is None:
            return math.nan
        place = np.array(truth.ned_p_m[:2]) + pursued.view.relative_m
        return float(np.linalg.norm(place - truth.target_ned_p_m[:2]))

    def _through_jpeg(self, data: bytes) -> np.ndarray:
        pixels = np.frombuffer(data, np.uint8).reshape(self._camera.height, self._camera.width, 3)
        _, jpeg = cv2.imencode(".jpg", pixels, self._jpeg)
        return np.asarray(cv2.imdecode(jpeg, cv2.IMREAD_COLOR))

    def _now_ns(self) -> int:
        return round(self._vehicle.t_s * _SEC_NS)

    def _step_until(self, t_ns: int) -> None:
        while self._now_ns() < t_ns:
            self._vehicle.step()
            self._tell()

    def _motion(self, t_ns: int) -> Motion:
        t = self._vehicle.truth
        return Motion(
            t_ns, np.array(t.ned_p_m), np.array(t.ned_v_m_s), np.array(t.ned_q_body), np.array(t.body_rates_rad_s)
        )

    def _tell(self) -> None:
        """What helm tells the ground of the vehicle, at its rate; inertial sensors with their noise and a bias."""
        if round(self._vehicle.t_s / self._vehicle.dt_s) % _STATE_CYCLES:
            return
        e = self._vehicle.estimate
        errors = self._gyro_bias_rad_s + self._gyro.normal(0.0, self._gyro_noise_rad_s, 3)
        force = self._force_bias_m_s2 + self._force.normal(self._vehicle.body_acceleration(), self._force_noise_m_s2)
        state = VehicleState(
            ned_p_m=e.ned_p_m,
            ned_v_m_s=e.ned_v_m_s,
            ned_q_body=e.ned_q_body,
            body_rates_rad_s=as_vec3(np.array(e.body_rates_rad_s) + errors),
            armed=True,
            in_air=True,
            mode="OFFBOARD",
            battery_fraction=-1.0,
            body_f_m_s2=as_vec3(force),
        )
        self._states.add(state, self._now_ns() - round(self._vehicle.dt_s * _SEC_NS))  # it was true before the step

    def _telemetry(self, t_ns: int) -> Telemetry:
        e = self._vehicle.estimate
        return Telemetry(
            found=True,
            attitude=AttitudeSample(t_ns, e.ned_q_body, e.body_rates_rad_s),
            position=PositionSample(t_ns, e.ned_p_m, e.ned_v_m_s),
            home_local_m=(0.0, 0.0, 0.0),
            mode="OFFBOARD",
            armed=True,
            in_air=True,
        )


def _heading_error_rad(truth: Truth, pursued: Pursued | None) -> float:
    """Heading that the tracker has for the car, less the car's, rad."""
    if pursued is None or pursued.view is None:
        return math.nan
    return wrap_angle(pursued.view.heading_rad - truth.target_heading_rad)
