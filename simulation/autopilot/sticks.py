"""A pilot's sticks: the newest positions, whether they are still heard, and whether a hand moves them."""

from __future__ import annotations

import math
from typing import NamedTuple

from simulation.autopilot.parameters import Parameters

_JOYSTICK_REFUSED = (0, 4)  # COM_RC_IN_MODE: a radio alone, nobody
_MOVING_TIME_S = 0.1  # over which a movement is averaged


class Sticks(NamedTuple):
    """Positions of the sticks, −1 to 1 each; the throttle's middle is 0."""

    roll: float = 0.0
    """Right is positive."""
    pitch: float = 0.0
    """Forward is positive: the nose goes down."""
    yaw: float = 0.0
    """Clockwise is positive."""
    throttle: float = 0.0
    """Up is positive."""


class StickReader:
    """Keeps the newest sticks.

    Args:
        parameters: COM_RC_IN_MODE, COM_RC_LOSS_T and COM_RC_STICK_OV are read from it at each use.
    """

    def __init__(self, parameters: Parameters):
        self._parameters = parameters
        self.sticks = Sticks()
        """The newest positions."""
        self._heard_s = -math.inf
        self._speed = Sticks()

    def take(self, sticks: Sticks, t_s: float) -> None:
        """Receive positions from a joystick; ignored where COM_RC_IN_MODE does not let a joystick steer."""
        if self._parameters["COM_RC_IN_MODE"] in _JOYSTICK_REFUSED:
            return
        dt_s = t_s - self._heard_s
        if self.lost(t_s):
            self._speed = Sticks()
        elif dt_s > 0.0:
            share = min(dt_s / _MOVING_TIME_S, 1.0)
            self._speed = Sticks(
                *(
                    speed + ((new - old) / dt_s - speed) * share
                    for speed, new, old in zip(self._speed, sticks, self.sticks, strict=True)
                )
            )
        self.sticks, self._heard_s = sticks, t_s

    def lost(self, t_s: float) -> bool:
        """Whether nothing was heard for COM_RC_LOSS_T."""
        return t_s - self._heard_s > self._parameters["COM_RC_LOSS_T"]

    def moved(self, t_s: float) -> bool:
        """Whether a stick moves by more than COM_RC_STICK_OV percent of its half travel a second."""
        if self.lost(t_s):
            return False
        most = 0.01 * float(self._parameters["COM_RC_STICK_OV"])
        return any(abs(speed) > most for speed in self._speed)
