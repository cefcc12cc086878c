"""How PX4 answers a step: readings of PX4 main (March 2026) in the loop with its built-in quadrotor.

The one place of these figures: the simulated autopilot is fitted to them, and conformance compares any autopilot with
them. A reading is a number, or the least and greatest of several. `default` is the drag of that quadrotor, 1 N per m/s
at 1 kg; `low` is 0.1, nearer a real one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

Reading = float | tuple[float, float]

STEPS: Mapping[str, Mapping[str, Reading]] = MappingProxyType(
    {
        "start_default": {  # 0 to 2 m/s
            "t10_s": 0.27,
            "t50_s": 0.70,
            "t63_s": 1.07,
            "t90_s": (8.0, math.inf),
            "speed_2s_m_s": 1.49,
            "speed_5s_m_s": 1.60,
            "tilt_deg": 16.6,
        },
        "stop_default": {"t10_s": 0.27, "t50_s": 0.57, "t63_s": 0.74, "t90_s": 4.0, "stop_distance_m": 2.29},
        "start_low": {
            "t10_s": 0.31,
            "t50_s": 0.63,
            "t63_s": 0.77,
            "t90_s": 1.2,
            "overshoot_percent": (7.0, 8.0),
            "tilt_deg": 17.5,
        },
        "stop_low": {"t90_s": 1.15, "stop_distance_m": (1.2, 1.5)},
        "climb": {"t10_s": 0.12, "t50_s": 0.22, "t63_s": 0.29, "t90_s": 0.45, "overshoot_percent": 20.0},  # to 1 m/s
        "yaw": {"t10_s": 0.33, "t50_s": 0.65, "t90_s": 0.93, "yaw_rate_deg_s": 141.0, "overshoot_percent": 17.0},  # 90°
        "roll": {"t10_s": 0.14, "t50_s": 0.25, "t63_s": 0.29, "t90_s": 0.46, "overshoot_percent": 3.0},  # 10°
    }
)
"""Readings by step: `tNN_s` until NN % of it, and what else was read, by name with its unit."""


def times_s(step: str) -> dict[float, float]:
    """Seconds until a share of a step, by share; without those of which only a bound is known."""
    return {
        int(name[1:3]) / 100: reading
        for name, reading in STEPS[step].items()
        if name[0] == "t" and name.endswith("_s") and name[1:3].isdigit() and isinstance(reading, float)
    }
