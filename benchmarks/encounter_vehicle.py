"""The vehicle of the encounters: the loop that fits PX4's velocity steps, for any number of vehicles at once."""

from __future__ import annotations

import numpy as np

Array = np.ndarray
DT_S = 0.0125
_P, _I, _D, _LAG_S = 1.8, 0.4, 0.2, 0.14
_VERTICAL_LAG_S = 0.2


class Vehicles:
    """Positions and velocities under velocity setpoints.

    Horizontally: acceleration setpoint 1.8 e + 0.4 int e - 0.2 dv/dt, through two lags of 0.14 s in series, then
    dv/dt = a - drag v (PX4's steps at both drags within 2 to 4 % RMS). Vertically a lag of 0.2 s.

    Args:
        ned_p_m: positions, (..., 3), m.
        ned_v_m_s: velocities, (..., 3), m/s, flown long enough for the loop to have learnt the drag.
        drag_1_s: drag by mass, (...), 1/s.
    """

    def __init__(self, ned_p_m: Array, ned_v_m_s: Array, drag_1_s: Array):
        self.p, self.v = ned_p_m.copy(), ned_v_m_s.copy()
        self._drag = drag_1_s[..., None]
        self._integral = self._drag * self.v[..., :2]
        self._lag = [self._integral.copy(), self._integral.copy()]
        self._change = np.zeros_like(self._integral)

    def step(self, setpoint_m_s: Array) -> None:
        """One step of `DT_S` towards a velocity, (..., 3), m/s."""
        level = self.v[..., :2]
        error = setpoint_m_s[..., :2] - level
        self._integral += _I * DT_S * error
        wanted = _P * error + self._integral - _D * self._change
        self._lag[0] += (wanted - self._lag[0]) * (DT_S / _LAG_S)
        self._lag[1] += (self._lag[0] - self._lag[1]) * (DT_S / _LAG_S)
        self._change = self._lag[1] - self._drag * level
        self.v[..., :2] += self._change * DT_S
        self.v[..., 2] += (setpoint_m_s[..., 2] - self.v[..., 2]) * (DT_S / _VERTICAL_LAG_S)
        self.p += self.v * DT_S

    def of(self, which: Array | slice) -> Vehicles:
        """Copies of some of them, in the state that they have now."""
        some = Vehicles.__new__(Vehicles)
        some.p, some.v, some._integral, some._change, some._drag = (
            part[which].copy() for part in (self.p, self.v, self._integral, self._change, self._drag)
        )
        some._lag = [part[which].copy() for part in self._lag]
        return some

    @staticmethod
    def together(parts: list[Vehicles]) -> Vehicles:
        """Several groups as one."""
        all_ = Vehicles.__new__(Vehicles)
        all_.p, all_.v, all_._integral, all_._change, all_._drag = (
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("p", "v", "_integral", "_change", "_drag")
        )
        all_._lag = [np.concatenate([part._lag[k] for part in parts]) for k in (0, 1)]
        return all_
