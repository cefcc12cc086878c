"""The ground robot after a target (Echeverri 2016, chapter 3): where it is over ground, and what to ask of the wheels.

The thesis filters the target's place in the picture, which moves with the robot. Here the wheels say how the robot has
moved: the target keeps its velocity over ground, is driven after while something hides it, and a picture is told where
to expect it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from common.geometry.camera import Camera
from common.tracking.base import Box
from onboard.follow.unicycle import Drive, UnicycleConfig, UnicycleLaw
from onboard.fusion.config import DepthConfig
from onboard.fusion.depth import DepthEstimate, DepthFusion
from onboard.fusion.foreseen import Foreseen
from onboard.fusion.lasting import Lasting
from onboard.fusion.motion import MotionFilter

Array = NDArray[np.float64]
_PLACE_M, _START_M_S, _DENSITY = 0.02, 0.3, 0.8
"""Standard deviations of a measured place, m, and of the velocity at the start, m/s, and root of the spectral density
of the target's acceleration, m/s^1.5: what is pushed or drives over a floor."""
_NEAREST_M, _REACH_M_S2 = 0.2, 0.3
"""Least distance at which a target is expected in the picture, m, and half of its acceleration, m/s²."""
_NEAREST = 0.75
"""How near a target that is seen may be, of the distance that is foreseen: what is pushed before it is nearer."""
_RIM = 0.25
"""Share of a box's side at either end that is no part of its middle."""
_FORM_MEMORY_S, _MOST_GROWN = 3.0, 1.1
"""Time constant with which what is known of the target's size over ground follows the box, s, and how many times as
large, or as small, as at the first it may become: what is rigid looks narrower or wider as it turns, no more."""
_WITHIN, _SILENT_S, _BREAK_S = 0.95, 1.0, 0.2
"""Share of the greatest distance that was measured within which a target would be; how long it must not be for it to be
farther, s: what is pushed before it has passed by then; and the longest break in that, s."""
_STANDS = Drive(0.0, 0.0, None)


class RobotFollower:
    """Drives after one target, at the distance that is measured first (3.5).

    Args:
        config: poles, limits and times.
        depth: of the distance.
        camera: calibration of the pictures that the boxes are of; it looks level, along the way of the robot.
    """

    def __init__(self, config: UnicycleConfig, depth: DepthConfig, camera: Camera):
        self._config, self._camera = config, camera
        self._depth = DepthFusion(depth, (float(camera.width), float(camera.height)))
        self._law: UnicycleLaw | None = None
        self._target: MotionFilter | None = None
        self._place, self._yaw_rad = np.zeros(2), 0.0
        self._before = self._place, self._yaw_rad
        self._own, self._rolled_ns = (0.0, 0.0), 0
        self._form = self._first_form = np.zeros(3)
        """Width, height and how far below the camera its middle is, m."""
        self._looked_at = (0.0, 0.0)
        """Speed, m/s, and turn, rad/s, of the wheels when a box was last taken in."""
        self._seen_ns = self._measured_ns = 0
        self._range_m, self._silent = 0.0, Lasting(_BREAK_S)
        self._reliable = depth.reliable  # R_ζ up to which the sensor measures; from 1 less that on it does not

    @property
    def distance_m(self) -> float:
        """Along the optical axis to where the target is by now, m; NaN before it was measured."""
        return math.nan if self._target is None else float(self._ahead(self._rolled_ns)[0])

    def roll(self, t_ns: int, speed_m_s: float, turn_rad_s: float) -> None:
        """Take in what the wheels have done until a time, ns: forward, m/s, and clockwise, rad/s.

        Raises:
            ValueError: a speed that is not finite, or a time that goes back.
        """
        if not (math.isfinite(speed_m_s) and math.isfinite(turn_rad_s) and t_ns >= self._rolled_ns):
            raise ValueError(
                f"robot: got wheels at {speed_m_s} m/s, {turn_rad_s} rad/s at {t_ns} ns, expected finite, and not "
                f"before {self._rolled_ns} ns"
            )
        self._before = self._place, self._yaw_rad
        dt_s = (t_ns - self._rolled_ns) * 1e-9
        course = self._yaw_rad + turn_rad_s * dt_s / 2
        self._place = self._place + speed_m_s * dt_s * np.array([math.cos(course), math.sin(course)])
        self._yaw_rad += turn_rad_s * dt_s
        self._own, self._rolled_ns = (speed_m_s, turn_rad_s), t_ns

    def expected(self) -> Foreseen | None:
        """Where the picture of the time of the last `roll` should show the target; None once away for too long."""
        if self._target is None or self._away_s > self._config.coast_s:
            return None
        ahead, aside = self._ahead(self._rolled_ns)
        if ahead < _NEAREST_M:
            return None
        camera, (width, height, _) = self._camera, self._form
        (u, v), before = self._pixel(ahead, aside), self._pixel(*self._ahead(self._rolled_ns, *self._before))
        width, height = camera.fx_px * width / ahead, camera.fy_px * height / ahead
        box = float(u - width / 2), float(v - height / 2), float(width), float(height)
        moved_px = u - before[0], v - before[1]
        # Where the size alone says how far it is, the distance cannot say how large it may look.
        unmeasured_s = (self._rolled_ns - self._measured_ns) * 1e-9
        return Foreseen(box, float(ahead), _REACH_M_S2 * unmeasured_s**2, moved_px=moved_px)

    def step(self, box: Box | None, depth_m: Array | None) -> Drive:
        """What to ask of the wheels for the picture of the time of the last `roll`.

        Args:
            box: x, y, width, height of the target in it, px; None while it is not seen.
            depth_m: depth inside the box, (h, w), m, 0 for none; None without a depth picture.
        """
        t_ns = self._rolled_ns
        if box is not None:
            self._look(box, depth_m)
        if self._target is None or self._law is None or self._away_s > self._config.coast_s:
            return _STANDS
        self._target.predict(t_ns, np.full(2, _DENSITY**2))
        (ahead, aside), (speed, turn) = self._ahead(t_ns), self._own
        closing, across = self._turned(-self._target.rate) + np.array([speed, 0.0])
        away_m = math.hypot(ahead, aside)
        # Rates of bearing and distance from the velocity of the target in the robot's frame, (-closing, -across).
        rate_rad_s = (aside * closing - ahead * across) / away_m**2 - turn
        closing_m_s = (ahead * closing + aside * across) / away_m
        return self._law.step(math.atan2(aside, ahead), rate_rad_s, away_m, closing_m_s, self._own)

    @property
    def _away_s(self) -> float:
        return (self._rolled_ns - self._seen_ns) * 1e-9

    def _pixel(self, ahead: float, aside: float) -> tuple[float, float]:
        """Where the picture shows the target's middle that is so far ahead and to the right, m, px."""
        camera, ahead = self._camera, max(float(ahead), _NEAREST_M)
        u = camera.cx_px + camera.fx_px * float(aside) / ahead
        return u, camera.cy_px + camera.fy_px * float(self._form[2]) / ahead

    def _turned(self, vector: Array, yaw_rad: float | None = None) -> Array:
        """A vector (2,) over ground as ahead of and to the right of the robot, (2,), now or at another yaw."""
        yaw_rad = self._yaw_rad if yaw_rad is None else yaw_rad
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        return np.array([c * vector[0] + s * vector[1], c * vector[1] - s * vector[0]])

    def _ahead(self, t_ns: int, place: Array | None = None, yaw_rad: float | None = None) -> Array:
        """How far the target is ahead and to the right, (2,), m, of the robot now, or at another place and yaw."""
        if self._target is None:
            raise ValueError("robot: no target yet")
        return self._turned(self._target.value_at(t_ns) - (self._place if place is None else place), yaw_rad)

    def _control(self) -> Array:
        """Known acceleration of u, v, px/s², and of the distance, m/s², (3,), since the last box: B·u (eqs 3.3, 3.4).

        By what the wheels have made of the commands: they lag, slip, or are held.
        """
        speed, turn = (np.array(self._own) - self._looked_at) / max(self._away_s, 1e-3)
        return np.array([-self._camera.fx_px * float(turn), 0.0, -float(speed)])

    def _own_depth(self, depth_m: Array | None) -> Array | None:
        """Depth in the middle of the box, (h, w), m, without what is nearer than the target can be: 0 there.

        What slides between covers a part of the box while trackers still see the rest. At its rim the box shows what is
        behind, the more the larger it has become.
        """
        if depth_m is None:
            return None
        rows, columns = (slice(round(_RIM * n), max(round(_RIM * n) + 1, round((1 - _RIM) * n))) for n in depth_m.shape)
        middle = depth_m[rows, columns]
        if self._target is None:
            return middle
        nearest_m = _NEAREST * self._ahead(self._rolled_ns)[0] - _REACH_M_S2 * self._away_s**2
        return np.where(middle > nearest_m, middle, 0.0)

    def _hold_against_range(self, t_ns: int, box: Box, estimate: DepthEstimate, *, with_depth: bool) -> None:
        """Where the sensor has measured a target before, and for long does not, it is farther than its size says.

        Beyond the range all trackers' boxes may grow together, and the robot would stop just there.
        """
        if estimate.reliability < self._reliable:
            self._range_m, self._measured_ns = max(self._range_m, estimate.tof_m), t_ns
        nearer = float(estimate.position[2]) < _WITHIN * self._range_m
        silent = with_depth and nearer and estimate.reliability > 1.0 - self._reliable
        if self._silent.note(silent, t_ns) >= _SILENT_S:
            self._depth.correct((box[2], box[3]), self._range_m)

    def _look(self, box: Box, depth_m: Array | None) -> None:
        camera, t_ns = self._camera, self._rolled_ns
        centre = (box[0] + box[2] / 2, box[1] + box[3] / 2)
        estimate = self._depth.update(t_ns, centre, (box[2], box[3]), self._own_depth(depth_m), self._control())
        if estimate is None:
            return
        self._hold_against_range(t_ns, box, estimate, with_depth=depth_m is not None)
        ahead = float(estimate.position[2])
        right, down = (centre[0] - camera.cx_px) / camera.fx_px, (centre[1] - camera.cy_px) / camera.fy_px
        c, s = math.cos(self._yaw_rad), math.sin(self._yaw_rad)
        found = self._place + ahead * np.array([c - s * right, s + c * right])
        form = ahead * np.array([box[2] / camera.fx_px, box[3] / camera.fy_px, down])
        if self._target is None:
            self._target = MotionFilter(found, t_ns, np.full(2, _PLACE_M), np.full(2, _START_M_S))
            half_rad = math.atan(camera.width / 2 / camera.fx_px)
            self._law = UnicycleLaw(self._config, ahead * math.hypot(1.0, right), half_rad)
            self._form = self._first_form = form
        else:
            self._target.predict(t_ns, np.full(2, _DENSITY**2))
            self._target.update(found, np.full(2, _PLACE_M**2))
            form = self._form - math.expm1(-self._away_s / _FORM_MEMORY_S) * (form - self._form)
            size = np.clip(form[:2], self._first_form[:2] / _MOST_GROWN, self._first_form[:2] * _MOST_GROWN)
            self._form = np.array([*size, form[2]])
        self._seen_ns, self._looked_at = t_ns, self._own
