"""The pan-tilt head after a target (Echeverri 2016, 4.5.2): in which direction it is, and what to ask of the servos.

The thesis acts on the target's place in the picture alone. Here the servos' own angles make a direction of it that does
not turn with the head: the target keeps its rate while nothing sees it, and a picture is told where to expect it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from common.geometry.camera import Camera
from common.tracking.base import Box
from onboard.follow.backdrop import Backdrop
from onboard.follow.pan_tilt import PanTiltConfig, PanTiltLaw
from onboard.fusion.foreseen import Foreseen
from onboard.fusion.motion import MotionFilter

Array = NDArray[np.float64]
_DIRECTION_RAD, _START_RAD_S, _DENSITY = 0.01, 0.5, 1.5
"""Standard deviations of a measured direction, rad, and of its rate at the start, rad/s, and root of the spectral
density of its acceleration, rad/s^1.5: a person, or what one carries, a metre or two away."""
_MOST_OFF_RAD = math.pi / 3
"""Angle beside the middle from which on no picture shows a target, rad."""
_SIZE_MEMORY_S = 1.0
"""Time constant with which the size of what is expected follows the box, s."""
_REACH, _REACH_1_S = 0.5, 2.0
"""How far from where it is foreseen the one thing that is not the room may be for it to be the target: target sizes,
and more for each second since it was seen."""


class HeadFollower:
    """Keeps one target in the middle of the picture.

    Args:
        config: poles, limits and times.
        camera: calibration of the pictures that the boxes are of; with both servos at 0 it looks level.
    """

    def __init__(self, config: PanTiltConfig, camera: Camera):
        self._config, self._camera = config, camera
        self._law = PanTiltLaw(config)
        self._backdrop = Backdrop(camera, (config.pan_limit_rad, config.tilt_limit_rad))
        self._target: MotionFilter | None = None
        self._angles, self._before, self._turned_ns = np.zeros(2), np.zeros(2), 0
        self._size = np.zeros(2)
        self._stepped_ns = self._seen_ns = 0

    def turned(self, t_ns: int, pan_rad: float, tilt_rad: float) -> None:
        """Take in where the servos are at a time, ns: clockwise from above and upwards, rad.

        Raises:
            ValueError: an angle that is not finite, or a time that goes back.
        """
        if not (math.isfinite(pan_rad) and math.isfinite(tilt_rad) and t_ns >= self._turned_ns):
            raise ValueError(
                f"head: got servos at {pan_rad}, {tilt_rad} rad at {t_ns} ns, expected finite, and not before "
                f"{self._turned_ns} ns"
            )
        self._before, self._angles, self._turned_ns = self._angles, np.array([pan_rad, tilt_rad]), t_ns

    def expected(self, frame: NDArray[np.uint8]) -> Foreseen | None:
        """Where a picture of the time of the last `turned` should show the target, and what in it is not the room.

        Args:
            frame: the picture, (H, W, 3) uint8 BGR.

        Returns:
            None: unknown.
        """
        apart, off = self._backdrop.look(frame, *self._angles.tolist()), self._off()
        if off is None or np.abs(off).max() > _MOST_OFF_RAD:
            return None
        away_s = (self._turned_ns - self._seen_ns) * 1e-9
        reach_px = (_REACH + _REACH_1_S * away_s) * math.sqrt(float(self._size.prod()))
        box, before = self._box(off), self._box(off + self._angles - self._before)
        return Foreseen(box, moved_px=(box[0] - before[0], box[1] - before[1]), reach_px=reach_px, apart=apart)

    def step(self, box: Box | None) -> tuple[float, float]:
        """Pan and tilt to command, rad, for the picture of the time of the last `turned`.

        Args:
            box: x, y, width, height of the target in it, px; None while it is not seen.
        """
        dt_s = (self._turned_ns - self._stepped_ns) * 1e-9
        self._stepped_ns = self._turned_ns
        off = self._off() if box is None else self._look(box)
        if off is None:
            return self._law.pan_rad, self._law.tilt_rad
        self._backdrop.learn(self._box(off))
        return self._law.step(float(off[0]), float(off[1]), dt_s)

    def _box(self, off: Array) -> Box:
        """Where a target is in the picture that is so far to the right of and above the middle, (2,), rad, px."""
        u = self._camera.cx_px + self._camera.fx_px * math.tan(off[0])
        v = self._camera.cy_px - self._camera.fy_px * math.tan(off[1])
        width, height = self._size.tolist()
        return u - width / 2, v - height / 2, width, height

    def _off(self) -> Array | None:
        """Where the target is by now, to the right of and above the middle, (2,), rad; None once away for too long.

        Its rate is believed ever less, with a time constant.
        """
        away_s = (self._turned_ns - self._seen_ns) * 1e-9
        if self._target is None or away_s > self._config.coast_s:
            return None
        memory_s = self._config.unseen_memory_s
        return self._target.value + memory_s * -math.expm1(-away_s / memory_s) * self._target.rate - self._angles

    def _look(self, box: Box) -> Array:
        """Take in a box; where it is, to the right of and above the middle, (2,), rad."""
        camera, t_ns = self._camera, self._turned_ns
        off = np.array(
            [
                math.atan((box[0] + box[2] / 2 - camera.cx_px) / camera.fx_px),
                -math.atan((box[1] + box[3] / 2 - camera.cy_px) / camera.fy_px),
            ]
        )
        if self._target is None:
            self._target = MotionFilter(self._angles + off, t_ns, np.full(2, _DIRECTION_RAD), np.full(2, _START_RAD_S))
            self._size = np.array(box[2:])
        else:
            self._target.predict(t_ns, np.full(2, _DENSITY**2))
            self._target.update(self._angles + off, np.full(2, _DIRECTION_RAD**2))
            share = -math.expm1((self._seen_ns - t_ns) * 1e-9 / _SIZE_MEMORY_S)
            self._size = self._size + share * (np.array(box[2:]) - self._size)
        self._seen_ns = t_ns
        return off
