"""The simulated battery: charge, voltage, and PX4's levels of warning."""

from __future__ import annotations

from typing import NamedTuple

from simulation.autopilot.parameters import Parameters

CELLS = 4
WARNING_NONE, WARNING_LOW, WARNING_CRITICAL, WARNING_EMERGENCY = range(4)
_ELECTRONICS_W = 5.0


class Battery(NamedTuple):
    """Charge and load of the battery."""

    fraction: float
    """Remaining charge, 0 to 1."""
    voltage_v: float
    """Terminal voltage, V."""
    current_a: float
    """Current drawn, A."""


def full(fraction: float) -> Battery:
    """A battery with this charge and no load."""
    return Battery(fraction, _voltage_v(fraction), 0.0)


def drained(battery: Battery, capacity_wh: float, rotor_power_w: float, dt_s: float) -> Battery:
    """The battery one step later.

    Args:
        battery: before.
        capacity_wh: capacity, Wh.
        rotor_power_w: what the rotors draw, W; the electronics draw 5 W more.
        dt_s: duration, s.
    """
    power_w = _ELECTRONICS_W + rotor_power_w
    fraction = max(battery.fraction - power_w * dt_s / 3600.0 / capacity_wh, 0.0)
    voltage_v = _voltage_v(fraction)
    return Battery(fraction, voltage_v, power_w / voltage_v)


def warning(battery: Battery, parameters: Parameters) -> int:
    """Level of warning, 0 (none) to 3 (emergency), by BAT_LOW_THR, BAT_CRIT_THR and BAT_EMERGEN_THR."""
    if battery.fraction < parameters["BAT_EMERGEN_THR"]:
        return WARNING_EMERGENCY
    if battery.fraction < parameters["BAT_CRIT_THR"]:
        return WARNING_CRITICAL
    return WARNING_LOW if battery.fraction < parameters["BAT_LOW_THR"] else WARNING_NONE


def _voltage_v(fraction: float) -> float:
    return 14.0 + 2.8 * fraction  # four lithium cells, 3.5 V to 4.2 V each
