"""The autopilot's parameters: what they must be, what they last were, and when to look again."""

from __future__ import annotations

import math

from onboard.helm.actions import Action, Kind
from onboard.helm.config import HelmConfig
from onboard.helm.dialect.base import Dialect

_AGAIN_S = 5.0


class Parameters:
    """What helm knows of them.

    Args:
        config: what they must be.
    """

    def __init__(self, config: HelmConfig):
        self.values: dict[str, float] = {}
        """As last read back."""
        self._config = config
        self._asked_ns = 0

    def wanted(self, dialect: Dialect) -> dict[str, float | int]:
        """What an autopilot of this dialect must have."""
        return dict(self._config.parameters_of(dialect))

    def read(self, dialect: Dialect, t_ns: int, *, write: bool) -> Action:
        """The action that reads them, after writing those that differ where it may."""
        self._asked_ns = t_ns
        return Action(Kind.PARAMETERS, self.wanted(dialect), write=write)

    def due(self, dialect: Dialect, t_ns: int) -> bool:
        """Whether it is time to write again what was not as wanted; each takeoff writes its own height."""
        return (t_ns - self._asked_ns) / 1e9 > _AGAIN_S and any(
            not math.isclose(self.values.get(name, math.nan), value, rel_tol=1e-4, abs_tol=1e-4)
            for name, value in self.wanted(dialect).items()
            if name != dialect.takeoff_parameter
        )
