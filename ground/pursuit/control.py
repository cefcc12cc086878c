"""The chase law: from the target in the picture to a velocity and a heading rate (Teulière 2011, section III).

The paper regulates the target's position in the level frame to zero with a hierarchy: a proportional outer loop on the
position gives the relative velocity (eq. 9), a PI inner loop on that velocity gives an orientation. Here the autopilot
closes the velocity loop, so the inner loop's output is a velocity:

    e = target - vehicle                                     position error, NED plane, m        (eq. 7, times height)
    v* = Kp e                                                asked velocity relative to target    (eq. 9)
    e_v = v* - (v_vehicle - v_target)                        relative velocity error              (eq. 8)
    v = v_target + v* + Kv e_v + Ki integral(e_v)            command

Signs: the paper writes the error as desired minus actual position *of the target in the picture* (c* - c, with c* = 0)
and moves the camera, which moves the target the other way: hence its minus in eq. 9. With e from the vehicle to the
target the gain is positive: the vehicle flies towards what it sees. For the heading (eq. 10) likewise: a target whose
heading lies clockwise of the vehicle's asks for a clockwise turn.
"""

from __future__ import annotations

import copy
import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.geometry.camera import Camera
from common.geometry.rotation import euler_from_quat, wrap_angle
from common.tracking.base import Expectation
from ground.pursuit.config import PursuitConfig
from ground.pursuit.heading import HeadingFilter
from ground.pursuit.steering import Steering
from ground.pursuit.target import TargetEstimate, TargetFilter
from ground.pursuit.view import LEAST_HEIGHT_M, Pose, View, off_axis_rad, pixel_of

Array = NDArray[np.float64]
_GRAVITY_M_S2 = 9.80665
_LONGEST_STEP_S = 0.2
_HEIGHT_GAIN_1_S = 0.8
_HEIGHT_DEADBAND_M = 0.3
# Shares of the half field of view between which the vehicle climbs to keep its target in the picture.
_EDGE_FROM, _EDGE_TO = 0.5, 0.9
# An occluder's edge drags the last estimates of a place along; those of a heading much less, and it may be about to end
# a turn, so it is rolled back less.
_BEFORE_LOSS_NS, _HEADING_BEFORE_LOSS_NS = 300_000_000, 100_000_000


@dataclass
class _Filters:
    """What is known of the target's motion."""

    target: TargetFilter
    heading: HeadingFilter

    def copy(self) -> _Filters:
        """The same, to go on from later: the filters replace their arrays and never write into them."""
        return _Filters(copy.copy(self.target), copy.copy(self.heading))

    def predict(self, t_ns: int) -> TargetEstimate | None:
        """Target at a later time, turning as it does."""
        return self.target.predict(t_ns, self.heading.mean_rate(t_ns))


@dataclass(frozen=True)
class Wish:
    """What the law asks for."""

    ned_v_m_s: Array
    """Horizontal velocity, NED, m/s, shape (2,)."""
    yaw_rate_rad_s: float
    """Heading rate, clockwise, rad/s."""
    climb_m_s: float = 0.0
    """Upward velocity, m/s."""
    ned_a_m_s2: Array | None = None
    """Horizontal acceleration instead of the velocity, NED, m/s², shape (2,): the orientation form."""


class ChaseLaw:
    """The control law with its memory: target filter, integral, last command.

    Args:
        config: gains and limits.
    """

    def __init__(self, config: PursuitConfig):
        self._config = config
        self._filters = _Filters(
            TargetFilter(config.process_m_s2, config.measurement_m),
            HeadingFilter(config.turn_memory_s, config.turn_agility_rad_s2, config.turn_measurement_rad),
        )
        self._steering = Steering(config)
        self.reset()

    def reset(self) -> None:
        """Forget target and command."""
        self.retarget()
        self._steering.reset()
        self._odometry_m = np.zeros(2)
        self._height_m: float | None = None
        self._last: tuple[Pose, int] | None = None

    def delayed(self, request_s: float) -> None:
        """Reckon with a time from a picture's capture to the setpoint that comes of it, s."""
        self._steering.delayed(request_s)

    def retarget(self) -> None:
        """Forget how the target moves: it was found again, perhaps elsewhere. What is flown changes smoothly."""
        self._filters.target.reset()
        self._filters.heading.reset()
        self._steering.retarget()
        self._kept: deque[tuple[int, _Filters]] = deque()
        self._seen_since_ns = 0
        self._unseen_since_ns: int | None = None

    def follow(self, view: View, pose: Pose, t_ns: int, angle_std_rad: float) -> Wish:
        """What to fly for a target that was seen in the picture captured at `t_ns`."""
        if self._unseen_since_ns is not None or not self._kept:
            self._kept.clear()
            self._seen_since_ns, self._unseen_since_ns = t_ns, None
        f = self._filters
        f.heading.memory_s = self._config.turn_memory_s
        if angle_std_rad <= self._config.yaw_doubt_rad:
            f.heading.update(view.heading_rad, t_ns)
        f.target.update(self._place(pose, t_ns) + view.relative_m, t_ns, f.heading.predict(t_ns)[1])
        self._keep(t_ns)
        edge = off_axis_rad(view) / view.half_field_rad
        higher_m = self._config.climb_m * float(np.clip((edge - _EDGE_FROM) / (_EDGE_TO - _EDGE_FROM), 0.0, 1.0))
        # The picture is lower than wide: a turn must not carry a target at its side over its upper edge.
        calm = max(0.0, 1.0 - off_axis_rad(view) / max(view.half_field_rad - self._config.view_margin_rad, 1e-3))
        yaw_rate_rad_s = calm * self._yaw_rate(pose, t_ns) if angle_std_rad <= self._config.yaw_doubt_rad else 0.0
        std_m = self._config.picture_rad * max(self._above_m(pose), LEAST_HEIGHT_M) + self._config.picture_m
        turn_rad_s, most_m_s2 = f.heading.predict(t_ns)[1], self._allowed_acceleration(view)
        request = self._steering.follow(view.relative_m, std_m, pose, t_ns, turn_rad_s, most_m_s2)
        return self._wish(request, pose, t_ns, yaw_rate_rad_s, higher_m)

    def expected(self, camera: Camera, pose: Pose, t_ns: int) -> Expectation | None:
        """Where a picture captured at `t_ns` should show the target, and how that changed since the last picture.

        The target is carried on in the world at its last velocity, the vehicle's motion is known: None before the
        target was first seen, and while the camera looks away from it.
        """
        if self._last is None:
            return None
        last, last_ns = self._last
        now, before = self._filters.predict(t_ns), self._filters.predict(last_ns)
        if now is None or before is None:
            return None
        here = self._pixel(camera, pose, now.position_m - self._place(pose, t_ns))
        there = self._pixel(camera, last, before.position_m - self._odometry_m)
        if here is None or there is None:
            return None
        yaw_rad, last_yaw_rad = euler_from_quat(pose.ned_q_body)[2], euler_from_quat(last.ned_q_body)[2]
        (heading_rad, _), (last_heading_rad, _) = (self._filters.heading.predict(t) for t in (t_ns, last_ns))
        return Expectation(
            center_px=here,
            angle_rad=wrap_angle(heading_rad - yaw_rad),
            moved_px=(here[0] - there[0], here[1] - there[1]),
            turned_rad=wrap_angle(heading_rad - yaw_rad - last_heading_rad + last_yaw_rad),
            grown=max(self._above_m(last), LEAST_HEIGHT_M) / max(self._above_m(pose), LEAST_HEIGHT_M),
        )

    def coast(self, pose: Pose, t_ns: int) -> Wish:
        """What to fly for a target that was not seen: after its predicted place for `coast_s`, then stand.

        Meanwhile the vehicle climbs: from higher up it sees more.
        """
        if self._unseen_since_ns is None:
            self._unseen_since_ns = t_ns
            self._roll_back(t_ns)
        unseen_s = (t_ns - self._unseen_since_ns) / 1e9
        higher_m = self._config.climb_m if unseen_s >= self._config.climb_after_s else 0.0
        target = self._filters.predict(t_ns)
        if target is None or unseen_s > self._config.coast_s:
            stand = self._steering.stand(pose, t_ns)
            self._note(pose, t_ns)
            return Wish(stand, 0.0, self._climb(pose, higher_m))
        relative_m, turn_rad_s = target.position_m - self._place(pose, t_ns), self._filters.heading.predict(t_ns)[1]
        request = self._steering.coast(relative_m, target.velocity_m_s, pose, t_ns, turn_rad_s)
        return self._wish(request, pose, t_ns, self._yaw_rate(pose, t_ns), higher_m)

    def _wish(self, request: Array, pose: Pose, t_ns: int, yaw_rate_rad_s: float, higher_m: float) -> Wish:
        self._note(pose, t_ns)
        climb_m_s = self._climb(pose, higher_m)
        if self._config.output == "velocity":
            return Wish(request, yaw_rate_rad_s, climb_m_s)
        return Wish(pose.ned_v_m_s[:2].copy(), yaw_rate_rad_s, climb_m_s, request)

    def _climb(self, pose: Pose, higher_m: float) -> float:
        """Upward velocity towards the height of the chase's beginning, or that much above it, m/s."""
        height_m = -float(pose.ned_p_m[2])
        if self._height_m is None:
            self._height_m = height_m
        short_m = self._height_m + higher_m - height_m
        if abs(short_m) < _HEIGHT_DEADBAND_M or self._config.climb_m == 0.0:
            return 0.0
        return float(np.clip(_HEIGHT_GAIN_1_S * short_m, -self._config.sink_m_s, self._config.climb_m_s))

    def _pixel(self, camera: Camera, pose: Pose, relative_m: Array) -> tuple[float, float] | None:
        return pixel_of(camera, pose, np.array([*(pose.ned_p_m[:2] + relative_m), -self._config.target_height_m]))

    def _above_m(self, pose: Pose) -> float:
        return -float(pose.ned_p_m[2]) - self._config.target_height_m

    def _allowed_acceleration(self, view: View) -> float:
        """Largest change of velocity towards the target whose tilt keeps it in the picture, m/s².

        A multirotor accelerates towards a target by tilting its camera away from it: at the edge of the picture a
        hard start loses the target that it is for. The tilt for an acceleration a is atan(a / g).
        """
        c = self._config
        room_rad = view.reach_rad - c.view_margin_rad - off_axis_rad(view)
        return float(np.clip(_GRAVITY_M_S2 * math.tan(room_rad), c.acceleration_min_m_s2, c.acceleration_m_s2))

    def _yaw_rate(self, pose: Pose, t_ns: int) -> float:
        """Heading rate after the target: its own, and more the further the vehicle's heading is from it (eq. 10)."""
        c = self._config
        heading_rad, turn_rad_s = self._filters.heading.predict(t_ns)
        if not self._filters.heading.known:
            return 0.0
        rate = turn_rad_s + c.yaw_gain_1_s * wrap_angle(heading_rad - euler_from_quat(pose.ned_q_body)[2])
        return float(np.clip(rate, -c.yaw_rate_rad_s, c.yaw_rate_rad_s)) if c.yaw_gain_1_s else 0.0

    def _place(self, pose: Pose, t_ns: int) -> Array:
        """Where the vehicle is by its velocity alone, (2,), m: position fixes wander, and the target with them."""
        if self._last is None:
            return self._odometry_m
        last, last_ns = self._last
        dt_s = (t_ns - last_ns) / 1e9
        if dt_s > _LONGEST_STEP_S:
            return self._odometry_m + pose.ned_p_m[:2] - last.ned_p_m[:2]
        return self._odometry_m + max(0.0, dt_s) * (pose.ned_v_m_s[:2] + last.ned_v_m_s[:2]) / 2

    def _keep(self, t_ns: int) -> None:
        """Keep what is known of the target, for a while."""
        self._kept.append((t_ns, self._filters.copy()))
        while len(self._kept) > 1 and self._kept[1][0] <= t_ns - _BEFORE_LOSS_NS:
            self._kept.popleft()

    def _roll_back(self, t_ns: int) -> None:
        """On a loss, go on from what was known before it, turned as the heading then still was.

        Of a short sight the later half is taken back: what was known before it is older than any occluder's edge.
        """
        if not self._kept:
            return
        half_ns = (t_ns - self._seen_since_ns) // 2
        before = [kept for kept in self._kept if kept[0] <= t_ns - min(_BEFORE_LOSS_NS, half_ns)]
        start_ns, start = before[-1] if before else self._kept[0]
        target, heading = start.copy().target, start.heading
        for kept_ns, filters in self._kept:
            if start_ns < kept_ns <= t_ns - min(_HEADING_BEFORE_LOSS_NS, half_ns):
                target.carry(kept_ns, filters.heading.predict(kept_ns)[1])
                heading = filters.heading
        self._filters = _Filters(target, copy.copy(heading))
        self._filters.heading.memory_s = self._config.turn_unseen_s

    def _note(self, pose: Pose, t_ns: int) -> None:
        self._odometry_m = self._place(pose, t_ns)
        self._last = (pose, t_ns)
